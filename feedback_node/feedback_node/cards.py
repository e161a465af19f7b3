# SPDX-License-Identifier: Apache-2.0
"""What a host says of its agents, checked before anything is learned for them."""

from __future__ import annotations

from dataclasses import dataclass

from bt_agents.errors import Refused
from bt_agents.rules import Rule, read_rule
from bt_agents.scene import SceneSpace, Vector
from feedback_node.learning import checked_rate


@dataclass(frozen=True, kw_only=True)
class RuleEntry:
    """One mood rule as a card has it; see ``MoodRule.msg``."""

    when: str
    hold_s: float
    give: int
    cancel: bool


@dataclass(frozen=True, kw_only=True)
class AgentEntry:
    """One agent as a card has it, unchecked; see ``AgentCard.msg``."""

    name: str
    profile: tuple[float, ...]
    revision: int
    learning_rate: float
    rules: tuple[RuleEntry, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Card:
    """One host's card as received, unchecked; see ``HostCard.msg``."""

    host: str
    instance: str
    parameters: tuple[str, ...]
    agents: tuple[AgentEntry, ...]


@dataclass(frozen=True, kw_only=True)
class Agent:
    """A checked agent of a card.

    Attributes:
        name: Unique name.
        host: Fully qualified name of its host.
        authored: Profile of its file.
        held: Ledger revision that its host bids with.
        rate: Learning rate, 0..1.
        rules: Mood rules that could be read.
    """

    name: str
    host: str
    authored: Vector
    held: int
    rate: float
    rules: tuple[Rule, ...]


def read_card(card: Card, space: SceneSpace) -> tuple[tuple[Agent, ...], tuple[str, ...]]:
    """Check a card; one bad agent or rule does not spoil the others.

    Returns:
        The agents that can learn, and the problems of the others in words.

    Raises:
        Refused: ``BAD_NAME`` without a host's full name, ``FOREIGN_PARAMETERS`` when its profiles
            are made of other parameters than ours.
    """
    if not card.host.startswith("/"):
        raise Refused(
            "BAD_NAME",
            f"card of '{card.host}': expected the fully qualified name of the host, like /agents",
        )
    if card.parameters != space.names:
        raise Refused(
            "FOREIGN_PARAMETERS",
            f"card of {card.host}: its profiles are made of {_list(card.parameters)}, here they "
            f"are {_list(space.names)}; start both from the same scene.yaml",
        )
    agents: dict[str, Agent] = {}
    problems: list[str] = []
    for entry in card.agents:
        what = f"card of {card.host}: agent '{entry.name}'"
        try:
            if not entry.name or entry.name in agents:
                raise Refused(
                    "BAD_NAME", f"{what}: expected a name that no other agent of the host has"
                )
            agents[entry.name] = Agent(
                name=entry.name,
                host=card.host,
                authored=space.vector(entry.profile, what=what),
                held=entry.revision,
                rate=checked_rate(entry.learning_rate, what=what),
                rules=_rules(entry, what, space, problems),
            )
        except Refused as refusal:
            problems.append(str(refusal))
    return tuple(agents.values()), tuple(problems)


def _rules(
    entry: AgentEntry, what: str, space: SceneSpace, problems: list[str]
) -> tuple[Rule, ...]:
    rules = []
    for rule in entry.rules:
        try:
            rules.append(read_rule(rule.when, rule.hold_s, rule.give, rule.cancel, space))
        except Refused as refusal:
            problems.append(f"{refusal.code}: {what}: {refusal.reason}; the rule is skipped")
    return tuple(rules)


def _list(names: tuple[str, ...]) -> str:
    return f"[{', '.join(names)}]"
