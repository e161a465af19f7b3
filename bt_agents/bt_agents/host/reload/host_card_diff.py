# SPDX-License-Identifier: Apache-2.0
"""Diff of a host's cards: changes since the previous card, as text for people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bt_agents_language.diagnostics.renderers import visible

if TYPE_CHECKING:
    # The command line, which formats problems, starts without ROS.
    from bt_agents_interfaces.msg import AgentCard, FileProblem, HostCard


@dataclass(frozen=True, kw_only=True)
class CardDifference:
    """Difference between two cards.

    Attributes:
        text: Description for people.
        is_error: True if it needs a fix by a person.
    """

    text: str
    is_error: bool = False


class CardDiff:
    """Compares each card with the previous one of the same start of the same host."""

    def __init__(self) -> None:
        self._last: dict[str, HostCard] = {}

    def update(self, card: HostCard) -> list[CardDifference]:
        """Return the changes of a card; after a restart of its host, only new problems."""
        before = self._last.get(card.host)
        self._last[card.host] = card
        if before is None:
            return []
        if before.host_instance != card.host_instance:
            return [
                CardDifference(text=problem_text(problem), is_error=True)
                for problem in card.problems
                if problem not in before.problems
            ]
        had = {agent.name: agent for agent in before.agents}
        has = {agent.name: agent for agent in card.agents}
        changed = [
            CardDifference(text=f"{name} does not bid any more") for name in had if name not in has
        ]
        if had:
            # A host that has just registered adds all of its agents.
            changed += [CardDifference(text=f"{name} bids now") for name in has if name not in had]
        for name in has:
            if name in had:
                changed += _of_agent(had[name], has[name])
        return [*changed, *_of_folder(before, card, has)]

    def forget(self, host: str) -> None:
        """Forget the card of a host."""
        self._last.pop(host, None)


def degraded_reason(agent: AgentCard) -> str:
    """Return briefly why an agent is not as its files say; empty if it is."""
    if not agent.degraded:
        return ""
    first, *more = agent.problems
    if not first.file:
        return str(first.message)
    others = f" (and {len(more)} more)" if more else ""
    return f"broken: {visible(Path(first.file).name)}:{first.line}{others}"


def problem_text(problem: FileProblem) -> str:
    """Return a problem as text, with the agent unless the place of the error says more."""
    if problem.agent and not problem.file:
        return f"{problem.agent}: {problem.message}"
    return str(problem.message)


def _of_agent(before: AgentCard, now: AgentCard) -> list[CardDifference]:
    name = now.name
    changed = []
    if now.version != before.version:
        change = f" ({visible(now.change)})" if now.change else ""
        changed.append(CardDifference(text=f"{name}: version {now.version} in force{change}"))
    if now.waiting and not before.waiting:
        changed.append(
            CardDifference(text=f"{name}: a newer version waits for the end of its run")
        )
    if now.degraded and list(now.problems) != list(before.problems):
        changed.append(CardDifference(text=_degraded(now), is_error=True))
    if before.degraded and not now.degraded and now.version == before.version:
        changed.append(CardDifference(text=f"{name}: its file is good again"))
    return changed


def _degraded(now: AgentCard) -> str:
    if now.removal_reason:
        return f"{now.name}: {now.removal_reason}; it leaves at the end of its run"
    first, *more = now.problems
    if not first.file:
        return problem_text(first)
    others = f" (and {len(more)} more)" if more else ""
    stays = f"version {now.version} stays"
    if now.waiting:
        stays = "the newer version still waits for the end of its run"
    return f"{now.name}: {stays}, as its file is broken: {first.message}{others}"


def _of_folder(
    before: HostCard, card: HostCard, agents: Mapping[str, AgentCard]
) -> list[CardDifference]:
    reported = [problem for agent in agents.values() for problem in agent.problems]
    changed = [
        CardDifference(text=problem_text(problem), is_error=True)
        for problem in card.problems
        if problem not in before.problems and problem not in reported
    ]
    own = [problem for agent in before.agents for problem in agent.problems]
    gone = [one for one in before.problems if one not in own and one not in card.problems]
    fixed = {one.file for one in gone} - {one.file for one in (*card.problems, *own)} - {""}
    texts = [f"{visible(file)}: its problems are gone" for file in sorted(fixed)]
    texts += [f"no longer: {problem_text(one)}" for one in gone if not one.file]
    return [*changed, *(CardDifference(text=one) for one in texts)]
