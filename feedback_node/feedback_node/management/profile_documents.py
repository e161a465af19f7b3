# SPDX-License-Identifier: Apache-2.0
"""Documents about the profiles of a ledger, whether or not a feedback node has it open."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace, finite_or_none
from bt_agents_core.text import join_first
from feedback_node.learning import learning_step
from feedback_node.learning.layers import past_targets
from feedback_node.ledger.file import connect, inspect
from feedback_node.ledger.reading import LedgerReader
from feedback_node.ledger.rows import ProfileRevision
from feedback_node.management.documents import to_document

MOST_REVISIONS = 5000
"""Most revisions in one document; the newest are kept."""


@dataclass(frozen=True, kw_only=True)
class ProfileDocument:
    """JSON document about a number of profiles."""

    count: int
    text: str


class ProfileDocuments:
    """Creates documents about the profiles of a ledger.

    Args:
        ledger: The ledger.
        false_rate: Returns the estimated share of wrong feedback of an agent and layer.
        new_id: Returns a new document id.
    """

    def __init__(
        self,
        ledger: LedgerReader,
        false_rate: Callable[[str, str], float],
        *,
        new_id: Callable[[], str],
    ) -> None:
        self._ledger = ledger
        self._false_rate = false_rate
        self._new_id = new_id

    def history(self, agent: str, layer: str = "") -> ProfileDocument:
        """Return one profile with its revisions, or all profiles without if none is named.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``UNKNOWN_LAYER``.
        """
        if not agent:
            return self._document(self._selected(agent, layer), ())
        one = self.known(agent, layer)
        revisions = self._ledger.history(agent, layer, newest=MOST_REVISIONS)
        return self._document([one], revisions)

    def export(self, agent: str, layer: str = "") -> ProfileDocument:
        """Return profiles with their revisions: of one agent or all, one layer or all.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``UNKNOWN_LAYER``.
        """
        selected = self._selected(agent, layer)
        if not selected:
            raise self.unknown(agent, layer)
        revisions: list[ProfileRevision] = []
        for one in selected:
            room = MOST_REVISIONS - len(revisions)
            revisions += self._ledger.history(one.agent, one.layer, newest=room)
        return self._document(selected, revisions)

    def layers_of(self, agent: str) -> list[ProfileRevision]:
        """Return the layers of an agent, or of all agents."""
        names = [agent] if agent else self._ledger.agents()
        return [one for name in names for one in self._ledger.layers(name)]

    def known(self, agent: str, layer: str) -> ProfileRevision:
        """Return the current revision of a profile.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``UNKNOWN_LAYER``.
        """
        if not agent:
            raise Refused(RefusalCode.UNKNOWN_AGENT, "no agent is named; name one")
        current = self._ledger.current(agent, layer)
        if current is None:
            raise self.unknown(agent, layer)
        return current

    def unknown(self, agent: str, layer: str) -> Refused:
        """Return the refusal for an unknown profile."""
        agents = self._ledger.agents()
        if agent and agent not in agents:
            known = ", ".join(agents) or "none yet"
            return Refused(RefusalCode.UNKNOWN_AGENT, f"no agent '{agent}'; known are: {known}")
        known = join_first(sorted({one.layer for one in self.layers_of(agent)})) or "none"
        return Refused(RefusalCode.UNKNOWN_LAYER, f"no layer '{layer}'; there are: {known}")

    def _selected(self, agent: str, layer: str) -> list[ProfileRevision]:
        names = [agent] if agent else self._ledger.agents()
        own = (self._ledger.current(name) for name in names) if not layer else ()
        found = [one for one in own if one is not None]
        layers = self.layers_of(agent)
        found += [one for one in layers if layer in ("", one.layer)]
        return sorted(found, key=lambda one: (one.agent, one.layer))

    def _document(
        self, selected: Sequence[ProfileRevision], revisions: Iterable[ProfileRevision]
    ) -> ProfileDocument:
        profiles = [self._summary(one) for one in selected]
        text = to_document(profiles, revisions, document_id=self._new_id())
        return ProfileDocument(count=len(profiles), text=text)

    def _summary(self, one: ProfileRevision) -> dict[str, Any]:
        return {
            "agent": one.agent,
            "layer": one.layer,
            "revision": one.revision,
            "changes": one.cause.changes,
            "stamp": one.stamp,
            "false_rate": finite_or_none(self._false_rate(one.agent, one.layer)),
            "values": dict(one.profile),
        }


def read_profiles(
    path: Path, space: SceneSpace, agent: str, layer: str = "", *, revisions: bool
) -> ProfileDocument:
    """Return a document about the profiles of a ledger file, opened read-only.

    Args:
        path: The file; a feedback node may write it meanwhile.
        space: The scene parameters.
        agent: Agent of the profiles; empty for all.
        layer: Layer; empty for all in an export, and for the profile for everybody in a history.
        revisions: True for the history of one profile instead of an export.

    Raises:
        LedgerError: As in :func:`inspect`.
        Refused: As in :meth:`ProfileDocuments.history` and :meth:`ProfileDocuments.export`.
    """
    inspect(str(path))
    with closing(connect(str(path), "ro")) as database:
        ledger = LedgerReader(database, str(path))

        def false_rate(agent: str, layer: str) -> float:
            return learning_step.false_rate(past_targets(ledger, agent, layer, space, 0), space)

        documents = ProfileDocuments(ledger, false_rate, new_id=lambda: str(uuid.uuid4()))
        return (documents.history if revisions else documents.export)(agent, layer)
