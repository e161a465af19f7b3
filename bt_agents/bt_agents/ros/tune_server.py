# SPDX-License-Identifier: Apache-2.0
"""The service that tunes with a name and a reason, and the topic that says what was tuned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from bt_agents.errors import Refused
from bt_agents.language.diagnostics import shown
from bt_agents.ros import qos
from bt_agents.ros.messages import to_time
from bt_agents.tuning.board import Board, words_of
from bt_agents.tuning.history import Action, Cause, Change, Revision
from bt_agents.tuning.knobs import Setting
from bt_agents_interfaces.msg import Preset, Tuning, Tunings
from bt_agents_interfaces.srv import Tune

SOMEBODY = "somebody"
"""Author of a request without a name."""

_LONGEST_AUTHOR = 60

Found = tuple[Revision, Mapping[str, Setting]]
"""A revision to take back or make again, and the values to set for it."""

Set = Callable[[Mapping[str, Setting], Cause], Revision | None]


class TuneServer:
    """Serves ``~/tune`` and publishes ``~/tunings``.

    Args:
        node: The host's node.
        board: Its knobs.
        set_together: Sets values, or refuses all of them.
    """

    def __init__(self, node: Node, board: Board, set_together: Set) -> None:
        self._node = node
        self._board = board
        self._set_together = set_together
        self._shown: dict[tuple[int, str], Tuning] = {}
        self._tunings = node.create_publisher(Tunings, "~/tunings", qos.FACT)
        node.create_service(Tune, "~/tune", self._tune, qos_profile=qos.SERVICE)
        self._actions: dict[int, Callable[[Any, str, str], tuple[str, Revision | None]]] = {
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
            Change(name=name, before=self._board.values[name], after=value)
            for name, value in values.items()
        )
        return f"{self._board.words(changes)} (revision {revision.number})"

    def _message(self, revision: Revision, change: Change) -> Tuning:
        return Tuning(
            stamp=to_time(revision.stamp),
            revision=revision.number,
            author=revision.cause.author,
            reason=revision.cause.reason,
            name=change.name,
            before=self._board.written(change.name, change.before),
            after=self._board.written(change.name, change.after),
        )

    def _tune(self, request: Tune.Request, response: Tune.Response) -> Tune.Response:
        try:
            act = self._actions.get(request.action)
            if act is None:
                raise Refused(
                    "UNKNOWN_ACTION",
                    f"action {request.action}, expected 0 (set), 1 (undo), 2 (redo), 3 (apply), "
                    "4 (save) or 5 (forget)",
                )
            author = words_of(request.author, "the author", _LONGEST_AUTHOR) or SOMEBODY
            message, revision = act(request, author, words_of(request.reason, "the reason"))
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        response.accepted = True
        response.message = message
        if revision is not None:
            response.tunings = [self._message(revision, one) for one in revision.changes]
        return response

    def _set(self, request: Any, author: str, reason: str) -> tuple[str, Revision | None]:
        values = self._board.read(request.names, request.values)
        revision = self._set_together(values, Cause(author=author, reason=reason))
        return self._told(revision), revision

    def _undo(self, request: Any, author: str, reason: str) -> tuple[str, Revision | None]:
        return self._take_back(Action.UNDO, self._board.undo(request.agents), author, reason)

    def _redo(self, request: Any, author: str, reason: str) -> tuple[str, Revision | None]:
        return self._take_back(Action.REDO, self._board.redo(request.agents), author, reason)

    def _take_back(
        self,
        action: Action,
        found: Found,
        author: str,
        reason: str,
    ) -> tuple[str, Revision | None]:
        old, values = found
        cause = Cause(
            author=author,
            reason=reason or f"{action.value} of revision {old.number}",
            action=action,
            of=old.number,
        )
        revision = self._set_together(values, cause)
        return f"{action.value} of revision {old.number}: {self._told(revision)}", revision

    def _apply(self, request: Any, author: str, reason: str) -> tuple[str, Revision | None]:
        values, gone = self._board.preset(request.preset)
        words = f"preset {shown(request.preset)}"
        revision = self._set_together(values, Cause(author=author, reason=reason or words))
        left_out = f"; left out, as it is not here any more: {', '.join(gone)}" if gone else ""
        return f"{words}: {self._told(revision)}{left_out}", revision

    def _save(self, request: Any, _author: str, _reason: str) -> tuple[str, Revision | None]:
        count = self._board.save(request.preset, request.agents)
        self.publish()
        return f"preset {shown(request.preset)} keeps {count} values", None

    def _forget(self, request: Any, _author: str, _reason: str) -> tuple[str, Revision | None]:
        self._board.presets.forget(request.preset)
        self.publish()
        return f"preset {shown(request.preset)} is forgotten", None

    def _told(self, revision: Revision | None) -> str:
        if revision is None or not revision.changes:
            return "everything stands so already"
        return f"{self._board.words(revision.changes)} (revision {revision.number})"
