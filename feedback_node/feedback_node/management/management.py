# SPDX-License-Identifier: Apache-2.0
"""Management of learned profiles: history, undo, reset, export, import, expiry and erasure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.profile_layers import MOST_LAYERS, PERSON, PLACE, checked_layer
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import folded
from feedback_node.learning.profiles import Delivery, ProfileChange, Profiles
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.rows import FLEET, IMPORT, ProfileRevision, check_texts
from feedback_node.management.documents import from_document, read_json
from feedback_node.management.fleet_documents import KIND, FleetDocuments
from feedback_node.management.profile_documents import ProfileDocument, ProfileDocuments

_MOST_NAMED = 3
"""Most changes that a message names one by one."""


class ManagementAction(IntEnum):
    """Kind of a request; the numbers match ``ManageProfiles.srv``."""

    HISTORY = 0
    UNDO = 1
    RESET = 2
    EXPORT = 3
    IMPORT = 4
    EXPIRE = 5
    FORGET = 6


@dataclass(frozen=True, kw_only=True)
class ManagementCommand:
    """Unchecked request; see ``ManageProfiles.srv``."""

    action: int
    agent: str = ""
    layer: str = ""
    author: str = ""
    reason: str = ""
    expected: tuple[float, ...] = ()
    older_s: float = 0.0
    document: str = ""


@dataclass(frozen=True, kw_only=True)
class ManagementResult:
    """Result of a request; its message is for people.

    Attributes:
        document: JSON, for actions that return a document.
        deliveries: Profiles for the hosts, in addition to the changes.
        forgets: True if something was forgotten.
    """

    message: str
    document: str = ""
    changes: tuple[ProfileChange, ...] = ()
    deliveries: tuple[Delivery, ...] = ()
    forgets: bool = False


class Management:
    """Executes requests, each completely or not at all."""

    def __init__(
        self,
        profiles: Profiles,
        ledger: Ledger,
        *,
        wall: Callable[[], float],
        new_id: Callable[[], str],
    ) -> None:
        self._profiles = profiles
        self._ledger = ledger
        self._wall = wall
        self._documents = ProfileDocuments(ledger, profiles.false_rate, new_id=new_id)
        self._fleet = FleetDocuments(profiles, ledger, wall=wall)

    def execute(self, command: ManagementCommand) -> ManagementResult:
        """Execute a request.

        Raises:
            Refused: ``UNKNOWN_ACTION``, ``TOO_LONG``, ``BAD_LAYER``, ``UNKNOWN_AGENT``,
                ``UNKNOWN_LAYER``, ``NOTHING_TO_UNDO``, ``BAD_AGE``, ``TOO_MANY_LAYERS``, or as in
                :meth:`Profiles.check_expected`, :func:`read_json`, :func:`from_document` and
                :class:`Ledger`; nothing has changed.
        """
        try:
            action = ManagementAction(command.action)
        except ValueError:
            raise Refused(
                RefusalCode.UNKNOWN_ACTION,
                f"action {command.action}, expected 0 to {max(ManagementAction)}",
            ) from None
        check_texts(agent=command.agent, author=command.author, reason=command.reason)
        if command.layer and action is not ManagementAction.EXPIRE:
            checked_layer(command.layer)
        actions: dict[ManagementAction, Callable[[ManagementCommand], ManagementResult]] = {
            ManagementAction.HISTORY: self._read(self._documents.history),
            ManagementAction.UNDO: partial(self._restore, self._ledger.undo),
            ManagementAction.RESET: partial(self._restore, self._ledger.reset),
            ManagementAction.EXPORT: self._read(self._documents.export),
            ManagementAction.IMPORT: self._import,
            ManagementAction.EXPIRE: self._expire,
            ManagementAction.FORGET: self._forget,
        }
        return actions[action](command)

    def _read(
        self, document: Callable[[str, str], ProfileDocument]
    ) -> Callable[[ManagementCommand], ManagementResult]:
        def read(command: ManagementCommand) -> ManagementResult:
            found = document(command.agent, command.layer)
            message = f"{found.count} profile{'s' if found.count != 1 else ''}"
            return ManagementResult(message=message, document=found.text)

        return read

    def _restore(
        self, restore: Callable[..., ProfileRevision], command: ManagementCommand
    ) -> ManagementResult:
        self._documents.known(command.agent, command.layer)
        self._profiles.check_expected(command.agent, command.layer, command.expected)
        revision = restore(
            command.agent, command.layer, source=command.author, reason=command.reason
        )
        return self._changed((revision,))

    def _import(self, command: ManagementCommand) -> ManagementResult:
        document = read_json(command.document)
        if isinstance(document, dict) and document.get("kind") == KIND:
            return self._take_steps(document)
        reason = command.reason or "taken in from a document"
        found = from_document(document, self._profiles.space, source=command.author, reason=reason)
        unknown = sorted({one.agent for one in found} - set(self._ledger.agents()))
        if unknown:
            raise Refused(
                RefusalCode.UNKNOWN_AGENT,
                f"document: no agent {', '.join(unknown)} here; nothing was taken in. Let the "
                "host introduce its agents first, or take them out of the document",
            )
        self._check_room(found)
        known = {(one.agent, one.layer) for one in self._documents.layers_of("")}
        begun = [
            self._profiles.first_layer_entry(one.agent, one.layer)
            for one in found
            if one.layer and (one.agent, one.layer) not in known
        ]
        if any(self._ledger.find_all(one.cause.feedback_id or "") for one in found):
            return ManagementResult(
                message="this document was taken in before; nothing has changed"
            )
        recorded = self._ledger.record([*begun, *found])
        return self._changed([one for one in recorded if one.cause.cause == IMPORT])

    def _take_steps(self, document: Mapping[str, Any]) -> ManagementResult:
        taken = self._fleet.take(document)
        deliveries = self._profiles.on_erased(taken.erased)
        newest = {
            (one.agent, one.layer): one for one in taken.recorded if one.cause.cause == FLEET
        }
        steps = sum(bool(one.cause.step) for one in taken.recorded)
        changes = tuple(self._profiles.on_recorded([one]) for one in newest.values())
        # A host must drop a forgotten layer before it gets the layer's later profile.
        again = [key for key in taken.erased if key in newest]
        deliveries += tuple(self._profiles.delivery(name, layer) for name, layer in again)
        message = f"{steps} step{'s' if steps != 1 else ''} of other robots taken in"
        return ManagementResult(
            message=_with_traces(message, taken.delayed),
            document=taken.answer,
            changes=changes,
            deliveries=deliveries,
            forgets=bool(taken.erased),
        )

    def _check_room(self, found: Iterable[LedgerEntry]) -> None:
        layers: dict[str, set[str]] = {}
        for one in found:
            if one.layer:
                layers.setdefault(one.agent, set()).add(one.layer)
        for agent, new in layers.items():
            count = len(new | {row.layer for row in self._ledger.layers(agent)})
            if count > MOST_LAYERS:
                raise Refused(
                    RefusalCode.TOO_MANY_LAYERS,
                    f"document: {agent} would have {count} layers, expected {MOST_LAYERS} at most",
                )

    def _expire(self, command: ManagementCommand) -> ManagementResult:
        if not command.older_s > 0.0:
            raise Refused(
                RefusalCode.BAD_AGE, f"older than {command.older_s:g} s, expected more than 0"
            )
        if command.layer not in ("", PERSON, PLACE):
            raise Refused(
                RefusalCode.BAD_LAYER, f"'{command.layer[:80]}', expected person, place or nothing"
            )
        before = self._wall() - command.older_s
        old = [
            one
            for one in self._documents.layers_of(command.agent)
            if one.stamp < before and one.layer.startswith(command.layer)
        ]
        return self._erase(old, command.author)

    def _forget(self, command: ManagementCommand) -> ManagementResult:
        if not command.layer:
            raise Refused(
                RefusalCode.BAD_LAYER,
                "name the person or the place, such as person/anna; the profile for everybody is "
                "not forgotten, 'bt-agents profile reset' brings back the profile of the file",
            )
        layers = self._documents.layers_of(command.agent)
        found = [one for one in layers if folded(one.layer) == folded(command.layer)]
        if not found:
            raise self._documents.unknown(command.agent, command.layer)
        return self._erase(found, command.author)

    def _erase(self, found: Sequence[ProfileRevision], author: str) -> ManagementResult:
        if not found:
            return ManagementResult(message="nothing to forget")
        keys = [(one.agent, one.layer) for one in found]
        delayed = self._ledger.forget(keys, source=author)
        self._fleet.clear()
        message = f"{len(keys)} profile{'s' if len(keys) != 1 else ''} forgotten"
        return ManagementResult(
            message=_with_traces(message, delayed),
            deliveries=self._profiles.on_erased(keys),
            forgets=True,
        )

    def _changed(self, revisions: Sequence[ProfileRevision]) -> ManagementResult:
        changes = tuple(self._profiles.on_recorded([one]) for one in revisions)
        message = "; ".join(
            f"{one.revision.agent}: {one.text} (revision {one.revision.revision})"
            for one in changes[:_MOST_NAMED]
        )
        if len(changes) > _MOST_NAMED:
            message += f"; and {len(changes) - _MOST_NAMED} more"
        return ManagementResult(message=message, changes=changes)


def _with_traces(message: str, delayed: str) -> str:
    """Return a message that also says why traces of forgotten content stay for now, if so."""
    if not delayed:
        return message
    return (
        f"{message}; traces stay in free parts of the file until it can be rewritten, which is "
        f"tried again and again: {delayed}"
    )
