# SPDX-License-Identifier: Apache-2.0
"""Validates host cards: profiles, learning rules and mood rules of agents."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import LearningRule, Update
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import MAX_WEIGHT, SceneSpace, Vector
from bt_agents_language.files.learning_reader import LAYERS, MAX_ANNEAL, MAX_WINDOW
from bt_agents_language.model.mood_rule import MoodRule
from feedback_node.learning.learning_step import PLAIN, check_rate


@dataclass(frozen=True, kw_only=True)
class LearningEntry:
    """Unchecked learning rule of a card, in the order of its parameters; see ``Learning.msg``.

    An empty ``update`` means the paper's formula.
    """

    update: str = ""
    rates: tuple[float, ...] = ()
    width: tuple[float, ...] = ()
    window: int = 0
    anneal: float = 0.0
    drift: tuple[float, ...] = ()
    retreat: tuple[float, ...] = ()
    sources: tuple[str, ...] = ()
    weights: tuple[float, ...] = ()
    layers: tuple[str, ...] = ()
    general: float = 1.0


@dataclass(frozen=True, kw_only=True)
class AgentEntry:
    """Agent of a card, unchecked except for its mood rules; see ``AgentCard.msg``.

    Attributes:
        current: Profile that it bids with; empty if the card does not contain it.
        rules: Valid mood rules.
        invalid_rules: Problems of the invalid ones.
    """

    name: str
    profile: tuple[float, ...]
    revision: int
    learning_rate: float
    current: tuple[float, ...] = ()
    learning: LearningEntry = LearningEntry()
    rules: tuple[MoodRule, ...] = ()
    invalid_rules: tuple[Refused, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LearningCard:
    """Unchecked card of a host; see ``HostCard.msg``."""

    host: str
    instance: str
    parameters: tuple[str, ...]
    agents: tuple[AgentEntry, ...]


@dataclass(frozen=True, kw_only=True)
class Agent:
    """Checked agent of a card.

    Attributes:
        host: Fully qualified name of its host.
        authored: Profile in its file.
        entry: The entry it was read from; its learning rate is in 0..1.
    """

    name: str
    host: str
    authored: Vector
    learning: LearningRule
    entry: AgentEntry

    def matches(self, entry: AgentEntry, host: str) -> bool:
        """Return whether an entry leads to the same agent, except for the revision."""
        known = self.entry
        return (
            host == self.host
            and not entry.invalid_rules
            and not known.invalid_rules
            and entry.profile == known.profile
            and entry.learning_rate == known.learning_rate
            # Compared as text, in which NaN (no value) equals itself.
            and repr(entry.learning) == repr(known.learning)
            and entry.rules == known.rules
        )


def read_card(
    card: LearningCard, space: SceneSpace, known: Mapping[str, Agent] = MappingProxyType({})
) -> tuple[tuple[Agent, ...], tuple[str, ...]]:
    """Check a card; an invalid agent or rule does not affect the others.

    Unchanged agents of ``known``, from earlier cards, are not read again.

    Returns:
        The agents that can learn, and the problems of the others in words.

    Raises:
        Refused: ``BAD_NAME`` without the full name of a host, ``OTHER_PARAMETERS`` if its
            profiles have other parameters.
    """
    if not card.host.startswith("/"):
        raise Refused(
            RefusalCode.BAD_NAME,
            f"card of '{card.host}': expected the fully qualified name of the host, like /agents",
        )
    if card.parameters != space.names:
        raise Refused(
            RefusalCode.OTHER_PARAMETERS,
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
                    RefusalCode.BAD_NAME,
                    f"{what}: expected a name that no other agent of the host has",
                )
            if entry.name in known and known[entry.name].matches(entry, card.host):
                agents[entry.name] = replace(known[entry.name], entry=entry)
                continue
            authored = space.vector(entry.profile, what=what)
            check_rate(entry.learning_rate, what=what)
            agents[entry.name] = Agent(
                name=entry.name,
                host=card.host,
                authored=authored,
                learning=read_learning(entry.learning, space, what=what),
                entry=entry,
            )
            problems += [
                f"{refusal.code}: {what}: {refusal.reason}; the rule is skipped"
                for refusal in entry.invalid_rules
            ]
        except Refused as refusal:
            problems.append(str(refusal))
    return tuple(agents.values()), tuple(problems)


def read_learning(entry: LearningEntry, space: SceneSpace, *, what: str) -> LearningRule:
    """Return the learning rule of an entry.

    Raises:
        Refused: ``BAD_LEARNING``.
    """
    if not entry.update:
        return PLAIN
    if entry.update not in {*Update}:
        raise _invalid_learning(what, f"update '{entry.update}', expected {', '.join(Update)}")
    ranges = {p.name: (0.0, p.maximum - p.minimum) for p in space.parameters}
    if len(entry.sources) != len(entry.weights):
        raise _invalid_learning(
            what,
            f"{len(entry.sources)} sources and {len(entry.weights)} weights, expected as many",
        )
    if entry.update == Update.MEDIAN and not 1 <= entry.window <= MAX_WINDOW:
        raise _invalid_learning(what, f"window {entry.window}, expected 1 to {MAX_WINDOW}")
    if not set(entry.layers) <= set(LAYERS):
        raise _invalid_learning(
            what, f"layers {_list(entry.layers)}, expected {' or '.join(LAYERS)}"
        )
    for weight in entry.weights:
        _within(weight, 0.0, MAX_WEIGHT, "weight", what)
    return LearningRule(
        rates=_by_name(entry.rates, dict.fromkeys(ranges, (0.0, 1.0)), "learning rate", what),
        update=Update(entry.update),
        width=_by_name(entry.width, ranges, "width", what),
        window=entry.window or PLAIN.window,
        anneal=_within(entry.anneal, 0.0, MAX_ANNEAL, "anneal", what),
        drift=_by_name(entry.drift, ranges, "drift", what),
        retreat=_by_name(
            entry.retreat,
            {p.name: (p.minimum, p.maximum) for p in space.parameters},
            "retreat",
            what,
        ),
        weights=dict(zip(entry.sources, entry.weights, strict=True)),
        layers=entry.layers,
        general=_within(entry.general, 0.0, 1.0, "general", what),
    )


def _by_name(
    values: Sequence[float], limits: Mapping[str, tuple[float, float]], of: str, what: str
) -> dict[str, float]:
    """Return values by name, each within its limits; NaN means no value."""
    if len(values) not in (0, len(limits)):
        raise _invalid_learning(
            what, f"{len(values)} times a {of}, expected {len(limits)} or none"
        )
    return {
        name: _within(value, *limits[name], f"{of} of {name}", what)
        for name, value in zip(limits, values, strict=False)
        if not math.isnan(value)
    }


def _within(value: float, low: float, high: float, of: str, what: str) -> float:
    if not low <= value <= high:
        raise _invalid_learning(what, f"{of} {value:g}, expected {low:g} to {high:g}")
    return value


def _invalid_learning(what: str, text: str) -> Refused:
    return Refused(RefusalCode.BAD_LEARNING, f"{what}: {text}")


def _list(names: tuple[str, ...]) -> str:
    return f"[{', '.join(names)}]"
