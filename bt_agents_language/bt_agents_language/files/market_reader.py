# SPDX-License-Identifier: Apache-2.0
"""Reader of ``market.yaml``: the rules of the strategy ``rules``."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from bt_agents_core.diagnostic import Diagnostic, Position
from bt_agents_core.scene import SceneSpace
from bt_agents_language.diagnostics.collection import did_you_mean, warning
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.fields.scope import NameScope, scene_names, scene_scope
from bt_agents_language.fields.values import read_condition
from bt_agents_language.yaml.field_tables import (
    CONDITION,
    NAME,
    FieldDecl,
    FileKind,
    Items,
    KeyTable,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Node

MARKET_FILE = "market.yaml"
"""Name of the market file, which is optional in a trees folder."""

_RULE = KeyTable(
    what="a rule",
    fields=(
        FieldDecl("when", CONDITION, "Condition over scene.* that must be true.", required=True),
        FieldDecl(
            "agents",
            Items(NAME, empty="a rule names no agent", add="name one or more", unique=True),
            "Agents; the first of them that bids wins.",
            required=True,
        ),
    ),
)
MARKET = FileKind(
    name="market",
    what=MARKET_FILE,
    title="Market",
    description="Rules by which the market chooses an agent.",
    fields=(
        FieldDecl(
            "rules",
            Items(_RULE),
            "For the strategy 'rules': the first one that holds counts.",
            required=True,
        ),
    ),
)


@dataclass(frozen=True, kw_only=True)
class MarketRule:
    """Rule of the market: if its condition holds, the first of its agents that bids wins.

    Attributes:
        position: Place of the condition.
        positions: Places of the agents.
        warnings: Warnings about legal but rarely intended content.
    """

    condition: Expression
    agents: tuple[str, ...]
    position: Position = field(compare=False)
    positions: tuple[Position, ...] = field(compare=False)
    warnings: tuple[Diagnostic, ...] = field(compare=False, default=())


def market_of(folder: Path, space: SceneSpace) -> tuple[MarketRule, ...]:
    """Return the rules of a folder's market file, if any, like :func:`read_market`."""
    file = folder / MARKET_FILE
    return read_market(file, space) if file.exists() else ()


def read_market(file: Path | Source, space: SceneSpace) -> tuple[MarketRule, ...]:
    """Return the rules of a market file, or raise a ``ReadError`` with all problems."""
    with TypedReader.of(file) as reading:
        fields = reading.file(MARKET)
        names = scene_scope(space, scene_names(space, ("scene",)))
        rules = readable(_rule(reading, node, names) for node in fields.items("rules"))
        reading.problems.raise_if_any()
        return rules


def unknown_agents(rules: Iterable[MarketRule], known: Collection[str]) -> Iterator[Diagnostic]:
    """Yield a warning for each unknown agent in a rule."""
    for rule in rules:
        for agent, position in zip(rule.agents, rule.positions, strict=True):
            if agent not in known:
                yield warning(
                    "unknown-agent-in-rule",
                    position,
                    1,
                    f"there is no agent '{agent}' in this folder; the rule passes over it",
                    did_you_mean(agent, known),
                )


def _rule(reading: TypedReader, node: Node, names: NameScope) -> MarketRule | None:
    fields = reading.keys(node, _RULE)
    if fields is None:
        return None
    condition = None
    before = len(reading.problems.warnings)
    if (when := fields.get("when")) is not None:
        condition = read_condition(reading, when, names, "'when'")
    agents: dict[str, Position] = {}
    for item in fields.items("agents"):
        agent = reading.name(item, "the name of an agent")
        if agent in agents:
            reading.error("duplicate-key", item, f"'{agent}' stands here twice", "name it once")
        elif agent is not None:
            agents[agent] = item.position
    if when is None or condition is None or not agents:
        return None
    return MarketRule(
        condition=condition,
        agents=tuple(agents),
        position=when.position,
        positions=tuple(agents.values()),
        warnings=reading.problems.warnings[before:],
    )
