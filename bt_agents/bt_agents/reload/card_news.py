# SPDX-License-Identifier: Apache-2.0
"""What is new on the card of a host since the one before, for people who watch it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol


class AgentOnCard(Protocol):
    """One agent, as ``AgentCard.msg`` has it."""

    name: str
    version: int
    waiting: bool
    degraded: bool
    problems: Sequence[str]


class Card(Protocol):
    """A host's card, as ``HostCard.msg`` has it."""

    host: str
    host_instance: str
    agents: Sequence[AgentOnCard]
    problems: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class News:
    """One thing that is new.

    Attributes:
        words: For people.
        agent: Whose version is new, so that its host can be asked what has changed; else empty.
        bad: True when somebody has to mend something.
    """

    words: str
    agent: str = ""
    bad: bool = False


class CardNews:
    """Compares each card with the one before of the same start of the same host."""

    def __init__(self) -> None:
        self._last: dict[str, Card] = {}

    def take(self, card: Card) -> list[News]:
        """Return what is new on a card; nothing on the first one of a host's start."""
        before = self._last.get(card.host)
        self._last[card.host] = card
        if before is None or before.host_instance != card.host_instance:
            return []
        had = {agent.name: agent for agent in before.agents}
        has = {agent.name: agent for agent in card.agents}
        news = [News(words=f"{name} does not bid any more") for name in had if name not in has]
        if had:
            # A host that the market has just taken brings all of them.
            news += [News(words=f"{name} bids now") for name in has if name not in had]
        for name in has:
            if name in had:
                news += _of_agent(had[name], has[name])
        return [*news, *_of_folder(before, card, has)]


def _of_agent(before: AgentOnCard, now: AgentOnCard) -> list[News]:
    name = now.name
    news = []
    if now.version != before.version:
        news.append(News(words=f"{name}: version {now.version} in force", agent=name))
    if now.waiting and not before.waiting:
        news.append(News(words=f"{name}: a newer version waits for the end of its run"))
    if now.degraded and list(now.problems) != list(before.problems):
        first, *more = now.problems
        others = f" (and {len(more)} more)" if more else ""
        words = f"{name}: version {now.version} stays, as its file is broken: {first}{others}"
        news.append(News(words=words, bad=True))
    if before.degraded and not now.degraded and now.version == before.version:
        news.append(News(words=f"{name}: its file is good again"))
    return news


def _of_folder(before: Card, card: Card, agents: Mapping[str, AgentOnCard]) -> list[News]:
    told = {line for agent in agents.values() for line in agent.problems}
    known = {*before.problems, *told}
    return [News(words=problem, bad=True) for problem in card.problems if problem not in known]
