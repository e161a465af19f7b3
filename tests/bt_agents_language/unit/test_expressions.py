# SPDX-License-Identifier: Apache-2.0
"""Expressions: their meaning and their size limits."""

from __future__ import annotations

import re

import pytest

from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import EvaluationError, ValueKind
from bt_agents_language.expression.expressions import MissingValue, parse_expression

VALUES = {
    "scene.age": 4.0,
    "scene.person": True,
    "count": 3,
    "place": "gate 12",
    "items": ("a", "b"),
    "nothing": (),
    "message": {"data": 1},
    "huge": 10**400,
    "endless": float("inf"),
    "undefined_reading": float("nan"),
    "many": ["x"] * 1_000_000,
    "told": "About 4, I think.",
    "digits": "9" * 400,
}


def lookup(name: str) -> object:
    if name not in VALUES:
        raise MissingValue(name)
    return VALUES[name]


def value(text: str) -> object:
    return parse_expression(text).evaluate(lookup)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1, count]", (1, 3)),
        (".5 < 1e0", True),
        ("endless > 5", True),
        # in and between
        ("'c' in nothing", False),
        ("1 not  in\n [2]", True),
        ("'x' in many", True),
        # numbers of functions
        ("min(1, endless)", 1),
        ("round(2.675, 2)", 2.68),
        ("round(1e300, 2)", 1e300),
        ("round(1.5, 15)", 1.5),
        ("len(nothing)", 0),
        # texts
        ("number(told) > 3", True),
        ("number(count)", 3),
        ("lower(told)", "about 4, i think."),
        ("contains(told, 'no', 'think')", True),
        ("contains(told, 'about')", True),
        ("contains(told, 'abou')", False),
        ("contains('Un CAFÉ, merci', 'cafe\u0301')", True),
        ("contains('I often feel like four', 'ten')", False),
        ("contains('no way', 'no way', 'never')", True),
        # missing values
        ("known(count)", True),
        ("known(live.mood)", False),
        ("known(count + live.mood)", False),
        ("live.mood else 2", 2),
        ("count else 2", 3),
        ("live.mood else live.age else 1", 1),
        ("live.mood else count > 2", True),
        ("count + live.mood else 2", 5),
        ("count - live.mood else -2 * 2", 7),
        ("(live.mood > 2) else false", False),
        ("count else (1 / 0)", 3),
        ("number(place) else 0", 12),
        ("'x' in live.items else ['x']", True),
    ],
)
def test_expression_evaluates_to_expected_value(text, expected):
    found = value(text)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scene.age < place", "'<' needs numbers, found the text 'gate 12'"),
        ("scene.person > 1", "'>' needs numbers, found true"),
        ("place == 3", "cannot compare the text 'gate 12' with the number 3"),
        ("scene.person == count", "cannot compare true with the number 3"),
        ("items == items", "cannot compare a list with a list"),
        ("message == 1", "cannot compare a mapping with the number 1"),
        ("count and scene.person", "'and' needs true or false, found the number 3"),
        ("not place", "'not' needs true or false"),
        ("-place < 1", "'-' needs numbers"),
        ("count / 0 > 1", "'/' by zero"),
        ("1e308 * 10 > 1", "too large"),
        ("huge / 3 > 1", "too large"),
        ("huge == place", "a very large number with the text"),
        ("endless - endless > 1", "not a number"),
        ("count in count", "list or a text after it, found the number 3"),
        ("count in place", "looks for a text in a text, found the number 3"),
        ("count in items", "cannot compare the number 3 with the text 'a'"),
        ("1 in [scene.person]", "cannot compare the number 1 with true"),
        ("items in items", "looks for one value, found a list"),
        ("place between 1 and 2", "'between' needs numbers, found the text"),
        ("count between place and 2", "'between' needs numbers, found the text"),
        ("max(nothing)", "'max' of an empty list"),
        ("max(items)", "'max' needs numbers, found the text 'a'"),
        ("max(count)", "two numbers or more, or one list, found the number 3"),
        ("min(undefined_reading, 1)", "one that is not a number"),
        ("round(undefined_reading)", "not a number"),
        ("max(1, endless) > 3", "too large"),
        ("round(1.5, count / 2)", "keeps 0 to 15 digits, found the number 1.5"),
        ("len(count)", "'len' needs a text or a list, found the number 3"),
        ("abs(scene.person)", "'abs' needs numbers, found true"),
        ("number(scene.person)", "'number' needs numbers, found true"),
        ("number(digits) > 1", "too large"),
        ("lower(count)", "'lower' needs texts, found the number 3"),
        ("contains(items, 'a')", "'contains' needs texts, found a list"),
        ("contains(place, count)", "'contains' needs texts, found the number 3"),
        ("(scene.person > 1) else true", "'>' needs numbers, found true"),
    ],
)
def test_mismatched_values_are_readable_errors(text, words):
    expression = parse_expression(text)
    with pytest.raises(EvaluationError, match=re.escape(words)):
        expression.evaluate(lookup)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("4", 4),
        ("About 4, I think.", 4),
        ("37.5 °C", 37.5),
        ("37,5 °C", 37.5),
        ("-3", -3),
        ("gate-7", 7),
        ("It is 5.", 5),
        (".5", 0.5),
        ("um...5", 5),
        ("0.125", 0.125),
        ("٤", 4),
        ("one moment, 7", 7),
    ],
)
def test_number_is_extracted_from_text(text, expected):
    found = parse_expression("number(answer)").evaluate(lambda _: text)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("no idea", "needs one number, found none in digits in the text 'no idea'"),
        ("", "found none in digits in the text ''"),
        ("4 or 5", "found several in the text '4 or 5'"),
        ("3-4", "found several"),
        ("1e5", "found several"),
        ("1,000", "found '1,000', which may be read in two ways, in the text '1,000'"),
        ("1.000", "may be read in two ways"),
        ("1.2.3", "may be read in two ways"),
    ],
)
def test_text_without_one_clear_number_is_an_error(text, words):
    with pytest.raises(EvaluationError, match=re.escape(words)):
        parse_expression("number(answer)").evaluate(lambda _: text)
    assert parse_expression("number(answer) else 0").evaluate(lambda _: text) == 0
    assert parse_expression("known(number(answer))").evaluate(lambda _: text) is False


def test_missing_value_propagates_unless_irrelevant():
    with pytest.raises(MissingValue) as missing:
        value("live.mood > 2 or scene.person")
    assert missing.value.name == "live.mood"
    assert value("scene.person or live.mood > 2") is True
    assert value("not scene.person and live.mood > 2") is False
    assert value("count between 4 and live.mood") is False


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 400, "nested"),
        ("abs(" * 200, "nested"),
        ("not " * 200 + "a", "nested"),
        ("-" * 300 + "1", "nested"),
        ("[" + "1," * 250, "more than 400 words"),
    ],
    ids=["[", "abs", "not", "-", "list"],
)
def test_size_and_depth_are_bounded(text, words):
    with pytest.raises(ExpressionError, match=words):
        parse_expression(text)


def test_long_flat_expression_is_accepted():
    assert value(" or ".join(["count > 5"] * 70)) is False
    assert value("+".join(["1"] * 200)) == 200


def test_expression_knows_names_with_columns():
    expression = parse_expression(
        "  scene.age > 2 and (place in ['x.y', other] or not max(scene.age, 3) between low and 9)"
    )
    assert expression.names == {"scene.age", "place", "other", "low"}
    assert [(m.name, m.column) for m in expression.mentions] == [
        ("scene.age", 3),
        ("place", 22),
        ("other", 39),
        ("scene.age", 57),
        ("low", 79),
    ]
    assert expression.text.startswith("scene.age > 2 and")


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("a == unknown", ValueKind.BOOLEAN),
        ("unknown", None),
        ("t in unknown", ValueKind.BOOLEAN),
        ("a between 1 and unknown", ValueKind.BOOLEAN),
        ("[a]", ValueKind.LIST),
        ("max(unknown)", ValueKind.NUMBER),
        ("known(unknown)", ValueKind.BOOLEAN),
        ("lower(unknown)", ValueKind.TEXT),
        ("contains(t, unknown)", ValueKind.BOOLEAN),
        ("a else 1", ValueKind.NUMBER),
        ("unknown else 1", None),
    ],
)
def test_expression_kind_is_known_before_a_run(text, kind):
    kinds = {"a": ValueKind.NUMBER, "t": ValueKind.TEXT}
    assert parse_expression(text, kind_of=kinds.get).kind is kind


def test_expressions_with_same_text_are_equal():
    assert parse_expression("a > 1") == parse_expression(" a > 1 ")
    assert hash(parse_expression("a > 1")) == hash(parse_expression("a > 1"))


@pytest.mark.parametrize(
    "text",
    [
        "answer == 'CAF\u00c9'",
        "answer in ['bar', 'caf\u00e9']",
        "'F\u00c9' in answer",
        "not answer != 'Caf\u00e9'",
        "answer == other",
    ],
)
def test_text_comparison_ignores_case_and_accent_encoding(text):
    names = {"answer": "Cafe\u0301", "other": "caf\u00e9"}
    assert parse_expression(text).evaluate(names.__getitem__) is True
