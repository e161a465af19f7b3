# SPDX-License-Identifier: Apache-2.0
"""Tunable parameters of a host as ROS parameters: declared, set, and shown as they change."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterEvent, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents.host.agent_registry import AgentRegistry, HostedAgent
from bt_agents.host.tuning.change_log import ChangeLog
from bt_agents.host.tuning.history import TuningCause, TuningRevision
from bt_agents.host.tuning.parameter_store import FILE, ParameterStore
from bt_agents.host.tuning.presets import Presets
from bt_agents.host.tuning.tunable import (
    TICK_RATE,
    Setting,
    TunableKind,
    TunableParameter,
    parameters_of,
)
from bt_agents.host.tuning.tune_service import TuneServer
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.field_types import FieldType
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_language.model.specs import AgentSpec
from bt_agents_ros.parameters import declare, describe
from bt_agents_ros.timers import FuturePoller, steady_timer

ROS_PARAMETER = "ros parameter"
"""Author of a change without a name."""

_PUBLISHED_AFTER_S = 0.05

_PRESETS_S = 2.0  # a person edits a preset, and no tree waits for it


class TunableParameters:
    """Shows all tunables as ROS parameters, a view of the :class:`ParameterStore`.

    ``ros2 param``, the service ``~/tune`` and reloaded files all set values in the store, where
    they take effect together between two ticks.

    Args:
        presets: Folder of the presets.
        changed: Called shortly after a change of learning rates, or of :attr:`preset_problems`.
        set_rate: Sets the ticks per second.
        tunings: File that keeps tuned values across restarts; an empty name keeps them in memory.

    Attributes:
        left_out: Name of a parameter → why the value given at the start is ignored.
    """

    def __init__(
        self,
        node: Node,
        registry: AgentRegistry,
        presets: Path,
        changed: Callable[[], None],
        *,
        set_rate: Callable[[float], None] = lambda _hertz: None,
        tunings: str = "",
    ) -> None:
        self._node = node
        self._registry = registry
        self._changed = changed
        self._set_rate = set_rate
        self._disk = WorkerThread("tunings")
        self._poller = FuturePoller(node)
        self._presets = Presets(presets)
        self._shown_presets = self._presets.by_name
        self._preset_job = self._disk.submit(self._presets.refresh)
        self._store = self._open(tunings)
        self.left_out: dict[str, str] = {}
        self._cards_due = False
        self._infos_due = True
        self._flush_due = False
        self._publish_timer = steady_timer(node, _PUBLISHED_AFTER_S, self._publish)
        self._report_presets({})
        steady_timer(node, _PRESETS_S, self._poll_presets)
        self._declare_together((TICK_RATE,))
        self._set_rate(float(self._store.value(TICK_RATE.name)))
        for member in registry.members.values():
            self.add(member)
        node.add_on_set_parameters_callback(self._set)
        self._server = TuneServer(node, self._store, self._show, self._poller)

    def _open(self, tunings: str) -> ParameterStore:
        log = self._node.get_logger()
        changes: ChangeLog | None = None
        if tunings:
            try:
                changes = ChangeLog(Path(tunings), self._disk)
            except BtAgentsError as error:
                log.error(f"changes from now on are lost when this host ends: {error}")
            else:
                if changes.problem:
                    log.warning(changes.problem)
        return ParameterStore(
            self._registry.members,
            changes,
            self._presets,
            self._disk,
            time.time,
            log.error,
            self._on_change,
        )

    def __contains__(self, name: str) -> bool:
        """Return whether a parameter of the node is a tunable."""
        return self._store.has(name)

    @property
    def preset_problems(self) -> Iterable[str]:
        """Problems of the files of presets, in words of one line."""
        return (problem.splitlines()[0] for problem in self._presets.problems.values())

    def _poll_presets(self) -> None:
        if self._preset_job.done():
            self._preset_job = self._disk.submit(self._presets.refresh)
        presets, problems = self._presets.by_name, self._presets.problems
        if presets is self._shown_presets and problems is self._shown_problems:
            return
        known, self._shown_presets = self._shown_problems, presets
        self._report_presets(known)
        self._publish_soon()

    def _report_presets(self, known: Mapping[Path, str]) -> None:
        self._shown_problems = self._presets.problems
        for path, problem in self._shown_problems.items():
            if known.get(path) != problem:
                self._node.get_logger().error(f"preset left out:\n{problem}")
        self._cards_due = self._cards_due or known != self._shown_problems

    def add(self, member: HostedAgent) -> None:
        """Declare the parameters of an agent, with previously tuned values."""
        self._declare_together(parameters_of(member.spec))
        self._infos_due = True
        self._publish_soon()

    def remove(self, name: str) -> None:
        """Undeclare the parameters of an agent."""
        for parameter in self._store.of(name):
            self._undeclare(parameter)
        self._infos_due = True
        self._publish_soon()

    def replace(self, member: HostedAgent, spec: AgentSpec) -> None:
        """Replace the file of an agent by another version; its tunables stay the same mapping.

        A changed default becomes the value, as a revision by "file". Other values stay if the new
        file allows them. The profile follows the file until something has been learned.
        """
        old = {parameter.name: parameter for parameter in self._store.of(spec.name)}
        new = {parameter.name: parameter for parameter in parameters_of(spec)}
        for name, parameter in old.items():
            if name not in new or new[name].type is not parameter.type:
                self._undeclare(parameter)
        self._declare_together([one for name, one in new.items() if not self._store.has(name)])
        changed = [
            one
            for name, one in new.items()
            if name in old and old[name].type is one.type and old[name] != one
        ]
        values = {parameter.name: self._store.replace(parameter) for parameter in changed}
        cause = TuningCause(author=FILE, reason=f"{spec.file} has changed")
        revision = self._store.set(values, cause, must_be_stored=False)
        for parameter in changed:
            value = Parameter(parameter.name, value=values[parameter.name])
            self._node.set_descriptor(
                parameter.name, _descriptor(parameter), value.get_parameter_value()
            )
        if revision is not None:
            self._show(revision)
        member.spec = spec
        if member.revision == 0 and spec.profile != member.profile:
            member.profile = spec.profile
        self._infos_due = True
        self._publish_soon()

    def close(self) -> None:
        """Release the file."""
        self._store.close()
        self._disk.shutdown()

    def _declare_together(self, parameters: Iterable[TunableParameter]) -> None:
        reasons = {}
        for parameter in parameters:
            start, why = self._store.start(parameter)
            value = self._declare(parameter, start)
            self._store.add(parameter, value)
            if why and value == start:
                reasons[parameter.name] = why
        revision = self._store.overrule(reasons)
        if revision is not None:
            self._node.get_logger().warning(
                f"tuned before, but not in force: {self._store.format_changes(revision.changes)}: "
                f"{revision.cause.reason}"
            )

    def _declare(self, parameter: TunableParameter, value: Setting) -> Setting:
        """Declare a parameter; return its value, which a parameter file may have set."""
        node, descriptor = self._node, _descriptor(parameter)
        self.left_out.pop(parameter.name, None)
        try:
            return parameter.check(declare(node, parameter.name, value, descriptor))
        except Refused as error:
            self.left_out[parameter.name] = (
                f"{parameter.name} as it was given at the start is left out, it is "
                f"{parameter.format(value)}: {error}"
            )
            node.get_logger().error(self.left_out[parameter.name])
            if node.has_parameter(parameter.name):
                node.undeclare_parameter(parameter.name)
        node.declare_parameter(parameter.name, value, descriptor, ignore_override=True)
        return value

    def _undeclare(self, parameter: TunableParameter) -> None:
        self.left_out.pop(parameter.name, None)
        self._node.undeclare_parameter(parameter.name)
        self._store.remove(parameter.name)

    def _set(self, parameters: list[Parameter[Any]]) -> SetParametersResult:
        """Set values that come as ROS parameters."""
        values = {p.name: p.value for p in parameters if self._store.has(p.name)}
        if not values:
            return SetParametersResult(successful=True)
        try:
            if len(values) < len(parameters):
                # Another callback may still refuse the others.
                raise Refused(
                    RefusalCode.NOT_TOGETHER,
                    f"{next(iter(values))} is tuned with one that is not a tunable; set them "
                    "one after the other",
                )
            self._store.set(values, TuningCause(author=ROS_PARAMETER))
        except Refused as refused:
            return SetParametersResult(successful=False, reason=str(refused))
        return SetParametersResult(successful=True)

    def _show(self, revision: TuningRevision) -> None:
        """Show changed values as ROS parameters, which rclpy would check again."""
        node = self._node
        parameters = [Parameter(one.name, value=one.after) for one in revision.changes]
        node._parameters |= {one.name: one for one in parameters}
        node._parameter_event_publisher.publish(
            ParameterEvent(
                stamp=node.get_clock().now().to_msg(),
                node=node.get_fully_qualified_name(),
                changed_parameters=[one.to_parameter_msg() for one in parameters],
            )
        )

    def _on_change(self, parameters: Collection[TunableParameter]) -> None:
        kinds = {parameter.kind for parameter in parameters}
        if TunableKind.TICK_RATE in kinds:
            self._set_rate(float(self._store.value(TICK_RATE.name)))
        self._cards_due = self._cards_due or TunableKind.LEARNING_RATE in kinds
        self._flush_due = True
        self._publish_soon()

    def _publish_soon(self) -> None:
        if self._publish_timer.is_canceled():
            self._publish_timer.reset()

    def _publish(self) -> None:
        self._publish_timer.cancel()
        job = self._store.flush() if self._flush_due else None
        self._flush_due = False
        if job is not None:
            self._poller.watch(job, self._report_flush)
        if self._infos_due:
            self._infos_due = False
            self._server.publish_infos(["", *self._registry.members])
        self._server.publish_tunings()
        if self._cards_due:
            self._cards_due = False
            self._changed()

    def _report_flush(self, error: str) -> None:
        if error:
            self._node.get_logger().error(
                f"the change is in force, but a power cut may undo it: {error}"
            )


def _descriptor(parameter: TunableParameter) -> ParameterDescriptor:
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    # rclpy compares steps relative to the value, so none matches at zero.
    around_zero = parameter.minimum is not None and parameter.minimum < 0
    descriptor = describe(
        parameter.description + unit,
        minimum=parameter.minimum,
        maximum=parameter.maximum,
        step=0.0 if around_zero and parameter.type is not FieldType.INTEGER else parameter.step,
        integer=parameter.type is FieldType.INTEGER,
    )
    descriptor.type = Parameter.Type.from_parameter_value(parameter.default).value
    descriptor.additional_constraints = f"default: {parameter.format(parameter.default)}"
    return descriptor
