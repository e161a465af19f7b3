# SPDX-License-Identifier: Apache-2.0
"""Diff of a host's cards: what has changed since the card before, as text for people."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

_PLACE = re.compile(r"(.+?):(\d+)(?::\d+)?: error\b")


class AgentOnCard(Protocol):
    """Fields of ``AgentCard.msg`` that are compared."""

    name: str
    version: int
    waiting: bool
    degraded: bool
    problems: Sequence[str]


class CardContent(Protocol):
    """Fields of ``HostCard.msg`` that are compared."""

    host: str
    host_instance: str
    agents: Sequence[AgentOnCard]
    problems: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class CardDifference:
    """Difference between two cards.

    Attributes:
        text: Description for people.
        agent: Agent with a new version, of which its host knows what has changed; else empty.
        is_error: True when somebody has to fix something.
    """

    text: str
    agent: str = ""
    is_error: bool = False


class CardDiff:
    """Comparison of each card with the one before, of the same start of the same host."""

    def __init__(self) -> None:
        self._last: dict[str, CardContent] = {}

    def update(self, card: CardContent) -> list[CardDifference]:
        """Return what has changed on a card; nothing for the first one of a host's start."""
        before = self._last.get(card.host)
        self._last[card.host] = card
        if before is None or before.host_instance != card.host_instance:
            return []
        had = {agent.name: agent for agent in before.agents}
        has = {agent.name: agent for agent in card.agents}
        changed = [
            CardDifference(text=f"{name} does not bid any more") for name in had if name not in has
        ]
        if had:
            # A host that the market has just taken brings all of them.
            changed += [CardDifference(text=f"{name} bids now") for name in has if name not in had]
        for name in has:
            if name in had:
                changed += _of_agent(had[name], has[name])
        return [*changed, *_of_folder(before, card, has)]


def degraded_reason(agent: AgentOnCard) -> str:
    """Return shortly why an agent is not as its files say; empty when it is."""
    if not agent.degraded:
        return ""
    first, *more = agent.problems
    place = _PLACE.match(first)
    if place is None:
        return first.removeprefix(f"{agent.name}: ")
    others = f" (and {len(more)} more)" if more else ""
    return f"broken: {Path(place[1]).name}:{place[2]}{others}"


def _of_agent(before: AgentOnCard, now: AgentOnCard) -> list[CardDifference]:
    name = now.name
    changed = []
    if now.version != before.version:
        changed.append(CardDifference(text=f"{name}: version {now.version} in force", agent=name))
    if now.waiting and not before.waiting:
        changed.append(
            CardDifference(text=f"{name}: a newer version waits for the end of its run")
        )
    if now.degraded and list(now.problems) != list(before.problems):
        changed.append(CardDifference(text=_degraded(now), is_error=True))
    if before.degraded and not now.degraded and now.version == before.version:
        changed.append(CardDifference(text=f"{name}: its file is good again"))
    return changed


def _degraded(now: AgentOnCard) -> str:
    first, *more = now.problems
    if _PLACE.match(first) is None:
        # The file is not broken: the agent leaves, or a version could not be brought into force.
        if first.startswith(f"{now.name}: "):
            return first
        return f"{now.name}: {first}; it leaves at the end of its run"
    others = f" (and {len(more)} more)" if more else ""
    stays = f"version {now.version} stays"
    if now.waiting:
        stays = "the newer version still waits for the end of its run"
    return f"{now.name}: {stays}, as its file is broken: {first}{others}"


def _of_folder(
    before: CardContent, card: CardContent, agents: Mapping[str, AgentOnCard]
) -> list[CardDifference]:
    reported = {form for agent in agents.values() for form in _reported_forms(agent)}
    known = {*before.problems, *reported}
    changed = [
        CardDifference(text=problem, is_error=True)
        for problem in card.problems
        if problem not in known
    ]
    own = {form for agent in before.agents for form in _reported_forms(agent)}
    gone = [one for one in before.problems if one not in own and one not in card.problems]
    fixed = _files(gone) - _files([*card.problems, *own])
    over = [f"no longer: {one}" for one in gone if _PLACE.match(one) is None]
    texts = [*(f"{file} is good again" for file in sorted(fixed)), *over]
    return [*changed, *(CardDifference(text=one) for one in texts)]


def _reported_forms(agent: AgentOnCard) -> Iterator[str]:
    """Yield the problems of an agent in the forms of its own card and of its host's card."""
    for line in agent.problems:
        yield line
        yield f"{agent.name}: {line}"


def _files(problems: Iterable[str]) -> set[str]:
    places = (_PLACE.match(problem) for problem in problems)
    return {place[1] for place in places if place is not None}
