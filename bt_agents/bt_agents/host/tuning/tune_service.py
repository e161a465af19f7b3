# SPDX-License-Identifier: Apache-2.0
"""The service that tunes with a name and a reason, and the topic that says what was tuned."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Future as Job
from dataclasses import dataclass
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from bt_agents.host.tuning.history import TuningAction, TuningCause, TuningChange, TuningRevision
from bt_agents.host.tuning.parameter_store import ParameterStore, words_of
from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.errors import Refused
from bt_agents_core.text import quote
from bt_agents_interfaces.msg import Preset, Tuning, Tunings
from bt_agents_interfaces.srv import Tune
from bt_agents_ros import qos
from bt_agents_ros.future_poller import FuturePoller
from bt_agents_ros.messages import to_time

SOMEBODY = "somebody"
"""Author of a request without a name."""

_LONGEST_AUTHOR = 60

Found = tuple[TuningRevision, Mapping[str, Setting]]
"""A revision to take back or make again, and the values to set for it."""

Set = Callable[[Mapping[str, Setting], TuningCause], TuningRevision | None]


@dataclass(frozen=True, kw_only=True)
class _Done:
    """What an action has done.

    Attributes:
        words: For people.
        revision: What has come into force.
        kept: Ends when a preset is kept, or not: it counts only then.
    """

    words: str
    revision: TuningRevision | None = None
    kept: Job[Any] | None = None


class TuneServer:
    """Serves ``~/tune`` and publishes ``~/tunings``.

    Args:
        node: The host's node.
        board: Its knobs.
        set_together: Sets values, or refuses all of them.
        jobs: Says when the disk has what was tuned.
    """

    def __init__(
        self, node: Node, board: ParameterStore, set_together: Set, jobs: FuturePoller
    ) -> None:
        self._node = node
        self._board = board
        self._set_together = set_together
        self._jobs = jobs
        self._shown: dict[tuple[int, str], Tuning] = {}
        self._tunings = node.create_publisher(Tunings, "~/tunings", qos.FACT)
        # One that waits for the disk holds up no other.
        group = ReentrantCallbackGroup()
        node.create_service(
            Tune, "~/tune", self._tune, qos_profile=qos.SERVICE, callback_group=group
        )
        self._actions: dict[int, Callable[[Any, str, str], _Done]] = {
            Tune.Request.SET: self._set,
            Tune.Request.UNDO: self._undo,
            Tune.Request.REDO: self._redo,
            Tune.Request.APPLY: self._apply,
            Tune.Request.SAVE: self._save,
            Tune.Request.FORGET: self._forget,
        }

    def publish(self) -> None:
        """Tell what was tuned, what can be taken back, and the presets."""
        history = self._board.history
        shown = {(r.number, c.name): (r, c) for r, c in history.shown}
        self._shown = {
            key: self._shown.get(key) or self._message(*one) for key, one in shown.items()
        }
        self._tunings.publish(
            Tunings(
                host=self._node.get_fully_qualified_name(),
                revision=history.revision,
                tunings=list(self._shown.values()),
                undo=self._next(self._board.undo),
                redo=self._next(self._board.redo),
                presets=[
                    Preset(name=name, names=list(values), values=list(values.values()))
                    for name, values in self._board.presets.by_name.items()
                ],
            )
        )

    def _next(self, find: Callable[[tuple[str, ...]], Found]) -> str:
        try:
            revision, values = find(())
        except Refused:
            return ""
        changes = (
            TuningChange(name=name, before=self._board.values[name], after=value)
            for name, value in values.items()
        )
        return f"{self._board.words(changes)} (revision {revision.number})"

    def _message(self, revision: TuningRevision, change: TuningChange) -> Tuning:
        return Tuning(
            stamp=to_time(revision.stamp),
            revision=revision.number,
            author=revision.cause.author,
            reason=revision.cause.reason,
            name=change.name,
            before=self._board.written(change.name, change.before),
            after=self._board.written(change.name, change.after),
        )

    async def _tune(self, request: Tune.Request, response: Tune.Response) -> Tune.Response:
        try:
            done = self._act(request)
            if done.kept is not None:
                await self._kept(done.kept)
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        except Exception as error:
            self._node.get_logger().error(f"~/tune failed:\n{traceback.format_exc()}")
            response.code = "FAILED"
            response.message = f"{type(error).__name__}: {error}; the log says more"
            return response
        response.accepted = True
        response.message = done.words
        if done.revision is not None:
            response.tunings = [self._message(done.revision, o) for o in done.revision.changes]
            synced = self._board.sync()
            trouble = await self._trouble(synced) if synced is not None else ""
            if trouble:
                response.message += f"; it is in force, but a power cut may undo it: {trouble}"
        return response

    def _act(self, request: Tune.Request) -> _Done:
        act = self._actions.get(request.action)
        if act is None:
            raise Refused(
                "UNKNOWN_ACTION",
                f"action {request.action}, expected 0 (set), 1 (undo), 2 (redo), 3 (apply), "
                "4 (save) or 5 (forget)",
            )
        author = words_of(request.author, "the author", _LONGEST_AUTHOR) or SOMEBODY
        return act(request, author, words_of(request.reason, "the reason"))

    async def _trouble(self, job: Job[Any]) -> str:
        """Wait for a job; return what went wrong in words."""
        ended = Future(executor=self._node.executor)
        self._jobs.follow(job, ended.set_result)
        trouble: str = await ended
        return trouble

    async def _kept(self, job: Job[Any]) -> None:
        """Wait until a preset is kept.

        Raises:
            Refused: It is not.
        """
        trouble = await self._trouble(job)
        if not job.done():
            raise Refused("NOT_KEPT", f"the preset is {trouble}; look at the presets in a while")
        job.result()
        self.publish()

    def _set(self, request: Any, author: str, reason: str) -> _Done:
        values = self._board.read(request.names, request.values)
        revision = self._set_together(values, TuningCause(author=author, reason=reason))
        return _Done(words=self._told(revision), revision=revision)

    def _undo(self, request: Any, author: str, reason: str) -> _Done:
        return self._take_back(TuningAction.UNDO, self._board.undo(request.agents), author, reason)

    def _redo(self, request: Any, author: str, reason: str) -> _Done:
        return self._take_back(TuningAction.REDO, self._board.redo(request.agents), author, reason)

    def _take_back(self, action: TuningAction, found: Found, author: str, reason: str) -> _Done:
        old, values = found
        cause = TuningCause(
            author=author,
            reason=reason or f"{action.value} of revision {old.number}",
            action=action,
            of=old.number,
        )
        revision = self._set_together(values, cause)
        words = f"{action.value} of revision {old.number}: {self._told(revision)}"
        return _Done(words=words, revision=revision)

    def _apply(self, request: Any, author: str, reason: str) -> _Done:
        values, gone = self._board.preset(request.preset)
        words = f"preset {quote(request.preset)}"
        revision = self._set_together(values, TuningCause(author=author, reason=reason or words))
        left_out = f"; left out, as it is not here any more: {', '.join(gone)}" if gone else ""
        return _Done(words=f"{words}: {self._told(revision)}{left_out}", revision=revision)

    def _save(self, request: Any, _author: str, _reason: str) -> _Done:
        count, kept = self._board.save(request.preset, request.agents)
        return _Done(words=f"preset {quote(request.preset)} keeps {count} values", kept=kept)

    def _forget(self, request: Any, _author: str, _reason: str) -> _Done:
        kept = self._board.forget(request.preset)
        return _Done(words=f"preset {quote(request.preset)} is forgotten", kept=kept)

    def _told(self, revision: TuningRevision | None) -> str:
        if revision is None or not revision.changes:
            return "everything stands so already"
        return f"{self._board.words(revision.changes)} (revision {revision.number})"
