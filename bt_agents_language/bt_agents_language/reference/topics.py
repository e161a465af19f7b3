# SPDX-License-Identifier: Apache-2.0
"""Topics of the reference other than keys: units, expressions and names, from their tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bt_agents_core.local_time import WEEKDAYS
from bt_agents_core.scene import SceneSpace
from bt_agents_core.stop_cause import STOPPERS
from bt_agents_language.expression.functions import FUNCTIONS
from bt_agents_language.expression.operators import BINARY, COMPARISON, PREFIXES
from bt_agents_language.expression.units import DIMENSIONS
from bt_agents_language.fields.scope import (
    CANCEL_NAMES,
    CLOCK_NAMES,
    RESERVED,
    mood_names,
    person_names,
    scene_names,
)

Rows = tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True)
class ReferenceTopic:
    """Page about a part of the language that is not a key of a file.

    Attributes:
        tables: Heading → allowed forms and their meanings.
        example: Part of an agent file, YAML.
    """

    key: str
    description: str
    tables: Mapping[str, Rows]
    note: str
    example: str


MEANINGS: Mapping[int, str] = {
    1: "at least one is true",
    2: "both are true",
    3: "the opposite",
    COMPARISON: "comparisons; 'in' checks whether a list contains a value, or a text a text",
    5: "addition and subtraction",
    6: "multiplication, division and remainder",
    7: "the minus sign of a number",
    8: "the value after it, if the value before it is missing",
}
"""Strength of operators → their meaning."""


def topic(key: str, space: SceneSpace) -> ReferenceTopic | None:
    """Return the page of a topic, one of ``TOPICS``; None for any other word."""
    return TOPICS[key](space) if key in TOPICS else None


def _units(_: SceneSpace) -> ReferenceTopic:
    rows = tuple(
        (one.name, f"{one.listed}, for example {one.example}; a bare number is in {one.si}")
        for one in DIMENSIONS.values()
    )
    return ReferenceTopic(
        key="units",
        description="A time, length or angle is one number with one unit.",
        tables={"": rows},
        note="In an expression, their values are in "
        f"{', '.join(one.si for one in DIMENSIONS.values())}.",
        example="""\
tunables:
  patience: {default: 8 s, min: 500 ms, max: 1 min}
tree:
  sequence:
    - wait: ${patience}
    - say: ${round(patience)} seconds are over.
""",
    )


def _expressions(_: SceneSpace) -> ReferenceTopic:
    written: dict[int, list[str]] = {one.strength: [] for one in PREFIXES.values()}
    for operator in BINARY.values():
        written.setdefault(operator.strength, []).append(operator.word)
    written[COMPARISON].append("between … and …")
    for prefix in PREFIXES.values():
        written[prefix.strength].append(prefix.word)
    operators = tuple(
        ("  ".join(words), MEANINGS[strength]) for strength, words in sorted(written.items())
    )
    functions = tuple((one.usage, one.means) for one in FUNCTIONS.values())
    return ReferenceTopic(
        key="expressions",
        description="A condition is an expression; any other value takes one in ${ }.",
        tables={
            "Operators, from the weakest to the strongest": operators,
            "Functions": functions,
            "Operands": (
                ("scene.age", "a name; 'bt-agents explain names' lists them"),
                ("4  0.5", "a number, without a unit"),
                ("'yes'", "a text in quotes"),
                ("true  false", "as words"),
                ("['yes', 'ok']", "a list, after 'in' or in a function"),
            ),
        },
        note="If a value is missing, a condition is not true, unless it uses 'known' or 'else'. "
        "Parentheses are allowed.",
        example="""\
tree:
  sequence:
    - ask: {text: "Coffee or tea?"}
    - when: contains(answer, 'coffee', 'tea') and scene.age between 2 and 5
      say: ${answer} comes in ${max(1, round(scene.age / 2))} minutes.
    - when: known(scene.mood) and scene.familiarity else 1 > 3
      say: As always.
""",
    )


def _names(space: SceneSpace) -> ReferenceTopic:
    def of(group: str) -> str:
        return "  ".join(scene_names(space, (group,)))

    mood = tuple((name, "the mood now minus the mood at the start") for name in mood_names(space))
    rows = (
        ("patience", "a tunable of the file, or an input of the subtree"),
        ("answer", "an output of an earlier node, or what 'set' wrote"),
        (of("scene"), "the scene as awarded"),
        (of("live"), "the same now; live.stale: nothing comes, the others have no value"),
        *mood,
        (of("profile"), "the agent's own profile"),
        (
            "  ".join(person_names(space)),
            "a person known by name: who, how often here, and what 'remember' has stored",
        ),
        (
            "  ".join(CLOCK_NAMES),
            f"the hour of the day, 0 to 23, and the day of the week: {', '.join(WEEKDAYS)}",
        ),
        (
            "  ".join(CANCEL_NAMES),
            f"in 'on_cancel', who stopped the run ({', '.join(STOPPERS)}), and why",
        ),
        ("msg.data", "a field of the message that 'wait_for' waits for"),
        ("result.answer", "a field of the result that 'succeed_when' is about"),
    )
    return ReferenceTopic(
        key="names",
        description="A value that may be different each time has a name: ${name}.",
        tables={"": tuple((name, means) for name, means in rows if name)},
        note="Your own names have small letters, digits and '_', start with a letter, and are "
        f"none of the words {', '.join(RESERVED)}.",
        example="""\
tree:
  sequence:
    - ask: Where to?
      outputs: {place: answer}
    - set: {tries: 3}
    - drive: ${place}
      retry: ${tries}
""",
    )


TOPICS: Mapping[str, Callable[[SceneSpace], ReferenceTopic]] = {
    "units": _units,
    "expressions": _expressions,
    "names": _names,
}
"""Topic → function that makes its page."""
