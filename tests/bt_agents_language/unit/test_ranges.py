# SPDX-License-Identifier: Apache-2.0
"""Ranges of names: what they show about a condition before any run."""

from __future__ import annotations

import pytest

from agent_texts import agent_of
from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.expression.ranges import Range
from bt_agents_language.tools.lint import lint

RANGES = {"age": Range(1, 5), "gain": Range(-2, 2)}


def decided(text: str) -> list[tuple[str, bool]]:
    """Return the comparisons that the ranges decide, each with whether it is always true."""
    found = parse_expression(text, range_of=RANGES.get).foregone
    return [(text[one.column - 1 : one.column - 1 + one.width], one.always) for one in found]


@pytest.mark.parametrize(
    ("text", "always"),
    [
        ("age > 5", False),
        ("age < 1", False),
        ("age == 6", False),
        ("age between 6 and 9", False),
        ("age in [6, 7]", False),
        ("age + gain > 7", False),
        ("age * gain < -10", False),
        ("-age > -1", False),
        ("age / 2 > 2.5", False),
        ("abs(gain) > 2", False),
        ("max(age, 3) < 3", False),
        ("min(age, gain, 0) > 0", False),
        ("age >= 1", True),
        ("age <= 5", True),
        ("age != 0", True),
        ("age not in [6, 7]", True),
        ("gain between -2 and 2", True),
        ("age > gain - 2", True),
    ],
)
def test_comparison_outside_or_covering_range_is_decided(text, always):
    assert decided(text) == [(text, always)]


@pytest.mark.parametrize(
    "text",
    [
        "age >= 5",
        "age < gain",
        "age + other > 100",
        "1 / gain > 100",
        "age % 2 > 100",
        "round(age) > 100",
        "1 < 2",
        "age > 2 and age < 4",
        "age > 4 or age < 2",
        "age >= 2 and age <= 2",
        "answer != 'A' and answer != 'B'",
        "age > 3 and gain < 1 and here",
        "abs(age) > 3 and abs(age) < 2",
    ],
)
def test_condition_that_depends_on_values_stays_undecided(text):
    assert decided(text) == []


def test_warning_names_decided_comparison_not_whole_condition():
    assert decided("other and not age > 7 or gain < 3") == [("age > 7", False), ("gain < 3", True)]


def test_one_side_of_and_decides_whole_condition():
    assert parse_expression("age > 7 and other", range_of=RANGES.get).range == Range(0, 0)
    assert parse_expression("age < 7 or other", range_of=RANGES.get).range == Range(1, 1)


def told(text: str) -> list[str]:
    return [one.message for one in lint(agent_of(text))]


def test_warning_states_the_range():
    (message,) = told("tree: {say: Hello., when: live.person and scene.age > 7}")
    assert message == "'scene.age > 7' is never true: scene.age is 1 to 5"
    (message,) = told("requires: scene.age >= 1\ntree: {say: Hello.}")
    assert message == "'scene.age >= 1' is always true: scene.age is 1 to 5"
    (message,) = told("feedback: [{when: mood.change <= -5, give: negative}]\ntree: {wait: 1 s}")
    assert message == "'mood.change <= -5' is never true: mood.change is -4 to 4"


@pytest.mark.parametrize(
    ("when", "hasty"),
    [
        ("mood.change > 0", True),
        ("mood.change != 0", True),
        ("mood.change >= 0", True),
        ("mood.change <= 0.5", True),
        ("live.person and mood.change > 0", True),
        ("mood.change >= 0.5", False),
        ("mood.change <= -1 or live.mood < 2", False),
        ("not mood.change < 1", False),
        ("mood.change between 1 and 3", False),
    ],
)
def test_mood_rule_on_smallest_change_needs_duration(when, hasty):
    rule = "feedback: [{{when: {}{}, give: positive}}]\ntree: {{wait: 1 s}}"
    warning = "this fires at the smallest change of the mood, even where it is only measured anew"
    assert told(rule.format(when, "")) == [warning] * hasty
    assert told(rule.format(when, ", for: 2 s")) == []


@pytest.mark.parametrize(
    ("text", "always"),
    [
        ("age > 4 and age < 2", False),
        ("age != 1 or age != 2", True),
        ("not (age > 4 and age < 2)", False),
        ("age in [1, 2] and age between 3 and 4", False),
        ("2 > age and age >= 2", False),
        ("answer == 'A' and answer == 'B'", False),
        ("answer != 'A' or answer != 'B'", True),
        ("answer in ['A', 'B'] and answer not in ['A', 'B', 'C']", False),
        ("here and not here", False),
        ("(age > 3 or here) and age <= 3 and not here", False),
        ("age > 4 and age < 2 and age + gain > 3", False),
    ],
)
def test_contradictory_condition_has_constant_value(text, always):
    assert [one for _, one in decided(text)] == [always]


def test_smallest_constant_condition_is_reported():
    assert decided("here or age > 4 and age < 2") == [("age > 4 and age < 2", False)]
    assert decided("here and (age > 6 or age < 0)") == [("age > 6", False), ("age < 0", False)]


TREE = """
tree:
  sequence:
    - ask: {text: "Which?", choices: [A, B]}
    - say: It is night.
      when: CONDITION
"""


@pytest.mark.parametrize(
    ("condition", "message", "hint"),
    [
        (
            "clock.hour >= 22 and clock.hour < 6",
            "is never true: clock.hour is 0 to 23",
            "did you mean 'or'?",
        ),
        ("clock.hour == 24", "is never true: clock.hour is 0 to 23", "compare with another value"),
        ("answer == 'D'", "is never true: answer is 'A', 'B'", "compare with another value"),
        (
            "answer != 'A' or answer != 'B'",
            "is always true: answer is 'A', 'B'",
            "did you mean 'and'?",
        ),
    ],
)
def test_constant_condition_on_hours_or_choices_is_reported(condition, message, hint):
    [warning] = lint(agent_of(TREE.replace("CONDITION", condition)))
    assert (warning.code, warning.message) == ("constant-condition", f"'{condition}' {message}")
    assert warning.hint == hint


def test_name_also_written_elsewhere_can_be_any_text():
    tree = TREE.replace("CONDITION", "answer == 'D'")
    more = tree.replace("    - say", "    - ask: Or which?\n    - say")
    assert told(more) == []


def test_hours_across_midnight_need_two_comparisons():
    with pytest.raises(ExpressionError) as error:
        parse_expression("clock.hour between 22 and 6")
    assert error.value.hint == "write clock.hour >= 22 or clock.hour < 6"
