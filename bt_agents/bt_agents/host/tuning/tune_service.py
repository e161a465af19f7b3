# SPDX-License-Identifier: Apache-2.0
"""Service ``~/tune``, with author and reason, and the topics ``~/tunings`` and ``~/tunables``."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future as Job
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

from bt_agents.host.tuning.history import TuningAction, TuningCause, TuningChange, TuningRevision
from bt_agents.host.tuning.parameter_store import ParameterStore, checked_line
from bt_agents.host.tuning.tunable import Setting, TunableKind, TunableParameter
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import FieldType
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import quote
from bt_agents_interfaces.msg import Preset, TunableInfo, Tunables, Tuning, Tunings
from bt_agents_interfaces.srv import Tune
from bt_agents_ros import qos
from bt_agents_ros.messages import answering, to_time
from bt_agents_ros.timers import FuturePoller

SOMEBODY = "somebody"
"""Author of a request without a name."""

_LONGEST_AUTHOR = 60
_MOST_SHOWN = 100
_KINDS = {
    getattr(TunableInfo, one.name): one for one in TunableKind if hasattr(TunableInfo, one.name)
}
_TYPES = {
    getattr(TunableInfo, one.name): one for one in FieldType if hasattr(TunableInfo, one.name)
}


@dataclass(frozen=True, kw_only=True)
class _ActionResult:
    """What came into force, with a text for people; a preset counts once its job has ended."""

    message: str
    revision: TuningRevision | None = None
    job: Job[Any] | None = None


class TuneServer:
    """Serves ``~/tune`` and publishes ``~/tunings`` and ``~/tunables``.

    Values are set together, all or none; ``show`` is called with each change. Disk jobs are
    polled.
    """

    def __init__(
        self,
        node: Node,
        store: ParameterStore,
        show: Callable[[TuningRevision], None],
        poller: FuturePoller,
    ) -> None:
        self._node = node
        self._store = store
        self._show = show
        self._poller = poller
        self._shown: dict[tuple[int, str], Tuning] = {}
        self._tunings = node.create_publisher(Tunings, "~/tunings", qos.FACT)
        self._tunables = node.create_publisher(Tunables, "~/tunables", qos.FACT)
        # A request that waits for the disk blocks no other.
        group = ReentrantCallbackGroup()
        node.create_service(
            Tune, "~/tune", self._tune, qos_profile=qos.SERVICE, callback_group=group
        )
        self._actions: dict[int, Callable[[Any, str, str], _ActionResult]] = {
            Tune.Request.SET: self._set,
            Tune.Request.UNDO: partial(self._step, TuningAction.UNDO),
            Tune.Request.REDO: partial(self._step, TuningAction.REDO),
            Tune.Request.APPLY: self._apply,
            Tune.Request.SAVE: self._save,
            Tune.Request.FORGET: self._forget,
        }

    def publish_infos(self, agents: Iterable[str]) -> None:
        """Publish the tunables of agents; the empty name means the whole host."""
        self._tunables.publish(
            Tunables(
                host=self._node.get_fully_qualified_name(),
                tunables=[info_to_msg(one) for agent in agents for one in self._store.of(agent)],
            )
        )

    def publish_tunings(self) -> None:
        """Publish the last changes, the next undo and redo, and the presets."""
        history = self._store.history
        changes = [(one, change) for one in history.shown for change in one.changes]
        shown = {(r.number, c.name): (r, c) for r, c in changes[-_MOST_SHOWN:]}
        self._shown = {
            key: self._shown.get(key) or self._message(*one) for key, one in shown.items()
        }
        undoable = {revision.number for revision in history.undoable}
        for (number, _), message in self._shown.items():
            message.undoable = number in undoable
        self._tunings.publish(
            Tunings(
                host=self._node.get_fully_qualified_name(),
                revision=history.revision,
                tunings=list(self._shown.values()),
                undo=self._format_next(TuningAction.UNDO),
                redo=self._format_next(TuningAction.REDO),
                presets=[
                    Preset(name=one.name, names=list(one.values), values=list(one.values.values()))
                    for one in self._store.presets.by_name.values()
                ],
            )
        )

    def _format_next(self, action: TuningAction) -> str:
        try:
            revision, values = self._store.find(action, ())
        except Refused:
            return ""
        changes = (
            TuningChange(name=name, before=self._store.value(name), after=value)
            for name, value in values.items()
        )
        return f"{self._store.format_changes(changes)} (revision {revision.number})"

    def _message(self, revision: TuningRevision, change: TuningChange) -> Tuning:
        return Tuning(
            stamp=to_time(revision.stamp),
            revision=revision.number,
            author=revision.cause.author,
            reason=revision.cause.reason,
            name=change.name,
            before=self._store.format_value(change.name, change.before),
            after=self._store.format_value(change.name, change.after),
        )

    async def _tune(self, request: Tune.Request, response: Tune.Response) -> Tune.Response:
        await self._answer(request, response)
        response.revision = self._store.history.revision
        return response

    async def _answer(self, request: Tune.Request, response: Tune.Response) -> None:
        try:
            with answering(response):
                done = self._act(request)
                if done.job is not None:
                    await self._wait_until_saved(done.job)
        except Exception as error:
            self._node.get_logger().error(f"~/tune failed:\n{traceback.format_exc()}")
            response.code = RefusalCode.FAILED
            response.message = f"{type(error).__name__}: {error}; the log says more"
        if not response.accepted:
            return
        response.message = done.message
        if done.revision is not None:
            revision = done.revision
            response.tunings = [self._message(revision, one) for one in revision.changes]
            flushed = self._store.flush()
            failure = await self._poller.error_of(flushed) if flushed is not None else ""
            if failure:
                response.message += f"; it is in force, but a power cut may undo it: {failure}"

    def _act(self, request: Tune.Request) -> _ActionResult:
        act = self._actions.get(request.action)
        if act is None:
            raise Refused(
                RefusalCode.UNKNOWN_ACTION,
                f"action {request.action}, expected 0 (set), 1 (undo), 2 (redo), 3 (apply), "
                "4 (save) or 5 (forget)",
            )
        author = checked_line(request.author, "the author", _LONGEST_AUTHOR) or SOMEBODY
        return act(request, author, checked_line(request.reason, "the reason"))

    async def _wait_until_saved(self, job: Job[Any]) -> None:
        """Wait until a preset is saved.

        Raises:
            Refused: It was not saved.
        """
        error = await self._poller.error_of(job)
        if not job.done():
            raise Refused(
                RefusalCode.CANNOT_WRITE, f"the preset is {error}; look at the presets in a while"
            )
        job.result()
        self.publish_tunings()

    def _set(self, request: Any, author: str, reason: str) -> _ActionResult:
        values = self._store.read(request.names, request.values)
        if request.compare:
            self._store.check_unchanged(values.keys(), request.seen)
        revision = self._set_values(values, TuningCause(author=author, reason=reason))
        return _ActionResult(message=self._summary(revision), revision=revision)

    def _set_values(
        self, values: Mapping[str, Setting], cause: TuningCause
    ) -> TuningRevision | None:
        revision = self._store.set(values, cause)
        if revision is not None:
            self._show(revision)
        return revision

    def _step(self, action: TuningAction, request: Any, author: str, reason: str) -> _ActionResult:
        old, values = self._store.find(action, request.agents)
        cause = TuningCause(
            author=author,
            reason=reason or f"{action.value} of revision {old.number}",
            action=action,
            of=old.number,
        )
        revision = self._set_values(values, cause)
        message = f"{action.value} of revision {old.number}: {self._summary(revision)}"
        return _ActionResult(message=message, revision=revision)

    def _apply(self, request: Any, author: str, reason: str) -> _ActionResult:
        values, gone = self._store.preset(request.preset)
        name = f"preset {quote(request.preset)}"
        revision = self._set_values(values, TuningCause(author=author, reason=reason or name))
        left_out = f"; left out, as it is not here any more: {', '.join(gone)}" if gone else ""
        return _ActionResult(
            message=f"{name}: {self._summary(revision)}{left_out}", revision=revision
        )

    def _save(self, request: Any, _author: str, _reason: str) -> _ActionResult:
        count, job = self._store.save(request.preset, request.agents)
        return _ActionResult(
            message=f"preset {quote(request.preset)} keeps {count} values", job=job
        )

    def _forget(self, request: Any, _author: str, _reason: str) -> _ActionResult:
        job = self._store.forget(request.preset)
        return _ActionResult(message=f"preset {quote(request.preset)} is forgotten", job=job)

    def _summary(self, revision: TuningRevision | None) -> str:
        if revision is None or not revision.changes:
            return "everything stands so already"
        return f"{self._store.format_changes(revision.changes)} (revision {revision.number})"


def info_to_msg(parameter: TunableParameter) -> TunableInfo:
    """Return the message that describes a parameter."""
    message = TunableInfo(
        name=parameter.name,
        agent=parameter.agent,
        key=parameter.key,
        kind=getattr(TunableInfo, parameter.kind.name),
        type=getattr(TunableInfo, parameter.type.name),
        unit=parameter.unit,
        default_value=Parameter(parameter.name, value=parameter.default).get_parameter_value(),
        step=float(parameter.step),
        description=parameter.description,
    )
    if parameter.minimum is not None and parameter.maximum is not None:
        message.has_range = True
        message.minimum, message.maximum = float(parameter.minimum), float(parameter.maximum)
    return message


def info_from_msg(message: Any) -> TunableParameter:
    """Return the parameter that a message describes."""
    return TunableParameter(
        name=message.name,
        agent=message.agent,
        key=message.key,
        kind=_KINDS[message.kind],
        type=_TYPES[message.type],
        default=parameter_value_to_python(message.default_value),
        minimum=message.minimum if message.has_range else None,
        maximum=message.maximum if message.has_range else None,
        step=message.step,
        description=message.description,
    )
