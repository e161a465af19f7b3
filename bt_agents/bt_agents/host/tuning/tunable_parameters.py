# SPDX-License-Identifier: Apache-2.0
"""Everything that may be tuned as ROS parameters that act between two ticks, all or none."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents.host.agent_registry import AgentRegistry, HostedAgent
from bt_agents.host.tuning.change_log import Journal
from bt_agents.host.tuning.history import TuningCause, TuningRevision
from bt_agents.host.tuning.parameter_store import FILE, ParameterStore, Start
from bt_agents.host.tuning.presets import Presets
from bt_agents.host.tuning.profile_requests import ProfileRequests
from bt_agents.host.tuning.tunable import (
    TICK_RATE,
    Setting,
    TunableKind,
    TunableParameter,
    tunables_of,
)
from bt_agents.host.tuning.tune_service import TuneServer
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.field_types import FieldType
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_language.model.specs import AgentSpec
from bt_agents_ros.future_poller import FuturePoller
from bt_agents_ros.parameters import describe
from bt_agents_ros.timers import steady_timer

ROS_PARAMETER = "ros parameter"
"""Author of what is set without a name."""

PRESETS = "presets.yaml"
"""Beside the file of the tunings."""

DEFAULT = "default: "
"""Start of the additional constraints of a parameter, before what the file says."""

_TOLD_AFTER_S = 0.05


class TunableParameters:
    """Declares every knob of a host as a parameter; whatever sets one comes through here.

    ``ros2 param``, the service ``~/tune`` and reloaded files all end in
    ``set_parameters_atomically``: the values are checked and written to the journal before they
    count, and act together between two ticks.

    Args:
        node: The host's node.
        roster: Its agents; their values are changed between two ticks.
        changed: Called a moment after learning rates or profiles were tuned.
        set_rate: Called with the ticks a second.
        tunings: File in which tunings outlive the host; empty keeps them in memory.
    """

    def __init__(
        self,
        node: Node,
        roster: AgentRegistry,
        changed: Callable[[], None],
        *,
        set_rate: Callable[[float], None] = lambda _hertz: None,
        tunings: str = "",
    ) -> None:
        self._node = node
        self._roster = roster
        self._changed = changed
        self._set_rate = set_rate
        self._disk = WorkerThread("tunings")
        self._jobs = FuturePoller(node)
        self._board = self._open(tunings)
        self._cause = TuningCause(author=ROS_PARAMETER)
        self._recorded: TuningRevision | None = None
        self._quiet = False
        self._cards_due = False
        self._sync_due = False
        self._profiles = ProfileRequests(node, roster, self._recorded_profile)
        self._tell_timer = steady_timer(node, _TOLD_AFTER_S, self._tell)
        self._declare_together((TICK_RATE,))
        self._set_rate(float(self._board.values[TICK_RATE.name]))
        for member in roster.members.values():
            self.add(member)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)
        self._server = TuneServer(node, self._board, self.set, self._jobs)

    def _open(self, tunings: str) -> ParameterStore:
        log = self._node.get_logger()
        journal: Journal | None = None
        presets = Presets(None)
        if tunings:
            path = Path(tunings)
            try:
                journal = Journal(path, self._disk, log.error)
            except BtAgentsError as error:
                log.error(f"what is tuned now is lost with this host: {error}")
            else:
                for problem in journal.problems:
                    log.warning(problem)
                presets = Presets(path.with_name(PRESETS))
                if presets.problem:
                    log.error(f"there are no presets, their file is broken:\n{presets.problem}")
        return ParameterStore(journal, presets, self._disk, time.time, log.error)

    def add(self, member: HostedAgent) -> None:
        """Declare the parameters of an agent; what was tuned before stands where it stood."""
        self._declare_together(tunables_of(member.spec, self._roster.space))
        self._fill(member)
        self._tell_soon()

    def remove(self, name: str) -> None:
        """Undeclare the parameters of an agent."""
        for knob in self._board.of(name):
            self._undeclare(knob)
        self._profiles.forget(name)
        self._tell_soon()

    def replace(self, member: HostedAgent, spec: AgentSpec) -> None:
        """Take in another version of an agent's file.

        A changed default is the new value, and a revision by "file". Other values stay as far as
        the new file allows them. The profile follows the file until something was learned.

        Args:
            member: The agent; its mapping of tunables is changed in place.
            spec: The new file.
        """
        old = {knob.name: knob for knob in self._board.of(spec.name)}
        new = {knob.name: knob for knob in tunables_of(spec, self._roster.space)}
        for name, knob in old.items():
            if name not in new or new[name].type is not knob.type:
                self._undeclare(knob)
        self._declare_together([k for name, k in new.items() if not self._board.has(name)])
        wanted: dict[str, Setting] = {}
        for name, knob in new.items():
            if name not in old or old[name].type is not knob.type or old[name] == knob:
                continue
            value = self._board.replace(knob)
            if knob.kind is TunableKind.PROFILE:
                self._node.set_descriptor(name, _descriptor(knob))
                continue
            self._node.set_descriptor(
                name, _descriptor(knob), Parameter(name, value=value).get_parameter_value()
            )
            wanted[name] = value
        if wanted:
            try:
                self.set(wanted, TuningCause(author=FILE, reason=f"{spec.file} has changed"))
            except Refused as refused:
                self._node.get_logger().error(
                    f"{spec.file} has changed, but its defaults are not in force: {refused}"
                )
        member.spec = spec
        if member.revision == 0 and spec.profile != member.profile:
            member.profile = self._profiles.over(spec.name, spec.profile)
        self._show_profile(member)
        self._fill(member)
        self._tell_soon()

    def take_profile(self, name: str, values: list[float], revision: int) -> HostedAgent:
        """Give an agent the profile that the feedback node has recorded; return the agent.

        Values that were tuned and are not recorded yet stay.

        Raises:
            Refused: As in :meth:`AgentRegistry.set_profile`.
        """
        member = self._roster.set_profile(name, values, revision)
        member.profile = self._profiles.over(name, member.profile)
        self._show_profile(member)
        return member

    def set(self, values: Mapping[str, Setting], cause: TuningCause) -> TuningRevision | None:
        """Set values together, or not at all; return the revision, None when nothing changes.

        Raises:
            Refused: With the reason why nothing is set.
        """
        self._board.check(values)
        self._cause, self._recorded = cause, None
        try:
            result = self._node.set_parameters_atomically(
                [Parameter(name, value=value) for name, value in values.items()]
            )
        finally:
            self._cause = TuningCause(author=ROS_PARAMETER)
        if not result.successful:
            code, colon, reason = result.reason.partition(": ")
            named = bool(colon) and code.replace("_", "").isupper()
            raise Refused(code if named else "REFUSED", reason if named else result.reason)
        return self._recorded

    def close(self) -> None:
        """Let others have the file; say what the feedback node never got."""
        self._profiles.close()
        self._board.close()
        self._disk.shutdown()

    def _declare_together(
        self, knobs: tuple[TunableParameter, ...] | list[TunableParameter]
    ) -> None:
        overruled: dict[str, Start] = {}
        for knob in knobs:
            start = self._board.start(knob)
            value = self._declare(knob, start.value)
            self._board.add(knob, value)
            if start.overruled is not None and value == start.value:
                overruled[knob.name] = start
        revision = self._board.overrule(overruled)
        if revision is not None:
            self._sync_due = True
            self._node.get_logger().warning(
                f"tuned before, but not in force: {self._board.words(revision.changes)}: "
                f"{revision.cause.reason}"
            )

    def _declare(self, knob: TunableParameter, value: Setting) -> Setting:
        """Declare a parameter; return its value, which a launch file may have set."""
        node, descriptor = self._node, _descriptor(knob)
        if knob.kind is not TunableKind.PROFILE:
            try:
                return knob.check(node.declare_parameter(knob.name, value, descriptor).value)
            except (
                InvalidParameterTypeException,
                InvalidParameterValueException,
                Refused,
            ) as error:
                node.get_logger().error(
                    f"{knob.name} as it was given at the start is left out, it is "
                    f"{knob.written(value)}: {error}"
                )
                if node.has_parameter(knob.name):
                    node.undeclare_parameter(knob.name)
        node.declare_parameter(knob.name, value, descriptor, ignore_override=True)
        return value

    def _undeclare(self, knob: TunableParameter) -> None:
        self._node.undeclare_parameter(knob.name)
        self._board.remove(knob.name)

    def _fill(self, member: HostedAgent) -> None:
        """Let a member have the values of its knobs; the mapping stays the same object."""
        own = self._board.of(member.spec.name)
        values = {k.key: self._board.values[k.name] for k in own if k.kind is TunableKind.TUNABLE}
        for key in [*member.tunables]:
            if key not in values:
                del member.tunables[key]
        member.tunables.update(values)
        rate = self._board.values[f"{member.spec.name}.learning_rate"]
        member.learning_rate = float(rate)

    def _check(self, parameters: list[Parameter[Any]]) -> SetParametersResult:
        """Check and record what is to be set."""
        values = {p.name: p.value for p in parameters if self._board.has(p.name)}
        if self._quiet or not values:
            return SetParametersResult(successful=True)
        try:
            self._board.check(values)
            self._recorded = self._board.record(
                values, self._cause, kept_or_refused=self._cause.author != FILE
            )
        except Refused as refused:
            return SetParametersResult(successful=False, reason=str(refused))
        self._sync_due = True
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter[Any]]) -> None:
        if self._quiet:
            return
        moved: dict[str, dict[str, float]] = {}
        for parameter in parameters:
            if not self._board.has(parameter.name):
                continue
            knob = self._board.knob(parameter.name)
            value = parameter.value
            member = self._roster.members.get(knob.agent)
            if knob.kind is TunableKind.TICK_RATE:
                self._set_rate(float(value))
            elif member is None:
                continue
            elif knob.kind is TunableKind.TUNABLE:
                member.tunables[knob.key] = value
            elif knob.kind is TunableKind.LEARNING_RATE:
                self._cards_due = self._cards_due or member.learning_rate != value
                member.learning_rate = float(value)
            else:
                moved.setdefault(knob.agent, {})[knob.key] = float(value)
        for agent, values in moved.items():
            self._move(self._roster.members[agent], values)
        self._tell_soon()

    def _move(self, member: HostedAgent, values: Mapping[str, float]) -> None:
        """Bid with a tuned profile at once, and have it recorded."""
        names = self._roster.space.names
        before = dict(zip(names, member.profile, strict=True))
        values = {name: value for name, value in values.items() if before[name] != value}
        if not values:
            return
        agent = member.spec.name
        reason = f"tuned by {self._cause.author}"
        if self._cause.reason:
            reason += f": {self._cause.reason}"
        self._profiles.want(agent, values, reason)
        member.profile = self._profiles.over(agent, member.profile)
        self._cards_due = True
        self._profiles.send(agent)

    def _recorded_profile(self, agent: str, feedback: Any | None) -> None:
        if feedback is not None:
            with suppress(Refused):
                self.take_profile(agent, list(feedback.after), feedback.revision)
        self._cards_due = True
        self._tell_soon()

    def _show_profile(self, member: HostedAgent) -> None:
        """Let the parameters follow a profile that nobody has tuned."""
        shown = []
        for key, value in zip(self._roster.space.names, member.profile, strict=True):
            name = f"{member.spec.name}.profile.{key}"
            if self._board.values[name] != value:
                self._board.follow(name, value)
                shown.append(Parameter(name, value=float(value)))
        if shown:
            self._quiet = True
            try:
                self._node.set_parameters_atomically(shown)
            finally:
                self._quiet = False

    def _tell_soon(self) -> None:
        if self._tell_timer.is_canceled():
            self._tell_timer.reset()

    def _tell(self) -> None:
        self._tell_timer.cancel()
        self._sync()
        self._server.publish()
        if self._cards_due:
            self._cards_due = False
            self._changed()

    def _sync(self) -> None:
        job = self._board.sync() if self._sync_due else None
        self._sync_due = False
        if job is not None:
            self._jobs.follow(job, self._synced)

    def _synced(self, trouble: str) -> None:
        if trouble:
            self._node.get_logger().error(
                f"what was tuned is in force, but a power cut may undo it: {trouble}"
            )


def _descriptor(knob: TunableParameter) -> ParameterDescriptor:
    unit = f" [{knob.unit}]" if knob.unit else ""
    # rclpy compares steps relative to the value, so that none fits at zero.
    around_zero = knob.minimum is not None and knob.minimum < 0
    descriptor = describe(
        knob.description + unit,
        minimum=knob.minimum,
        maximum=knob.maximum,
        step=0.0 if around_zero and knob.type is not FieldType.INTEGER else knob.step,
        integer=knob.type is FieldType.INTEGER,
    )
    descriptor.type = Parameter.Type.from_parameter_value(knob.default).value
    descriptor.additional_constraints = f"{DEFAULT}{knob.written(knob.default)}"
    return descriptor
