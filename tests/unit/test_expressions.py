# SPDX-License-Identifier: Apache-2.0
"""Conditions: what they mean, what they refuse, and where."""

from __future__ import annotations

import pytest

from bt_agents.language.expressions import (
    MAX_LENGTH,
    EvaluationError,
    ExpressionError,
    MissingValue,
    ValueKind,
    parse_expression,
)

VALUES = {
    "scene.age": 4.0,
    "scene.person": True,
    "count": 3,
    "place": "gate 12",
    "items": ("a",),
    "huge": 10**400,
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
        ("scene.age >= 4", True),
        ("scene.age > 4", False),
        ("scene.age != 4.0", False),
        ("scene.age == count + 1", True),
        ("count < 4 and scene.person", True),
        ("count > 4 or not scene.person", False),
        ("not count == 4", True),
        ("not scene.person == true", False),
        ("place == 'gate 12'", True),
        ('place != "gate 12"', False),
        ("1 + 2 * 3 == 7", True),
        ("(1 + 2) * 3 == 9", True),
        ("10 - 4 - 3 == 3", True),
        ("7 % 4 == 3", True),
        ("9 / 2 == 4.5", True),
        ("-count == -3", True),
        ("2 - -1 == 3", True),
        ("true or false and false", True),
        ("not false and false", False),
        ("count", 3),
        ("count * 2", 6),
        ("'a'", "a"),
        (".5 < 1e0", True),
    ],
)
def test_a_condition_means_what_it_says(text, expected):
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
        ("items == items", "a list or mapping"),
        ("count and scene.person", "'and' needs true or false, found the number 3"),
        ("not place", "'not' needs true or false"),
        ("-place < 1", "'-' needs numbers"),
        ("count / 0 > 1", "'/' by zero"),
        ("count % 0 == 1", "'%' by zero"),
        ("1e308 * 10 > 1", "too large"),
        ("huge / 3 > 1", "too large"),
    ],
)
def test_values_that_do_not_fit_are_an_error_in_words(text, words):
    expression = parse_expression(text)
    with pytest.raises(EvaluationError) as error:
        expression.evaluate(lookup)
    assert words in str(error.value)


def test_a_missing_value_is_passed_on_unless_it_does_not_matter():
    with pytest.raises(MissingValue) as missing:
        value("live.mood > 2 or scene.person")
    assert missing.value.name == "live.mood"
    assert value("scene.person or live.mood > 2") is True
    assert value("not scene.person and live.mood > 2") is False


@pytest.mark.parametrize(
    ("text", "column", "hint"),
    [
        ("", 1, "write one"),
        ("   ", 1, "write one"),
        ("scene.age = 4", 11, "compare with =="),
        ("scene.age => 4", 11, "write >="),
        ("scene.age === 4", 11, "write =="),
        ("scene.age <> 4", 11, "write !="),
        ("scene.age ≥ 4", 11, "write >="),
        ("a && b", 3, "write and"),
        ("a || b", 3, "write or"),
        ("!a", 1, "write not"),
        ("a AND b", 3, "write and"),
        ("a == True", 6, "write true"),
        ("${a} > 1", 1, "without ${ }"),
        ("a == 'x", 6, "close the text"),
        ("a == “x”", 6, "straight quotes"),
        ("(a", 1, "add a ')'"),
        ("a)", 2, "remove it"),
        ("()", 2, ""),
        ("a b", 3, "and"),
        ("a ==", 5, ""),
        ("and a", 1, ""),
        ("1 < a < 3", 7, "2 <= x and x <= 4"),
        ("a == b == c", 8, "2 <= x and x <= 4"),
        ("a > 010", 5, "write 10"),
        ("a > 5s", 5, "without a unit"),
        ("a > 1.2.3", 5, ""),
        ("a > 1e999", 5, ""),
        ("a[0] > 1", 2, ""),
        ("a; b", 2, ""),
        ("a.b.", 4, ""),
        (".a", 1, ""),
        ("a ** 2 > 1", 4, ""),
        ("f(a)", 2, "and"),
        ("lambda: 0", 7, ""),
        ("a < 'b'", 3, ""),
        ("1 == 'b'", 3, ""),
        ("not 3", 1, ""),
        ("true > 1", 6, ""),
        ("1 and a", 3, ""),
    ],
)
def test_what_is_no_condition_is_refused_at_the_wrong_word(text, column, hint):
    with pytest.raises(ExpressionError) as error:
        parse_expression(text)
    assert (error.value.column, hint in error.value.hint) == (column, True)


@pytest.mark.parametrize(
    "text",
    ["(" * 400, "not " * 200 + "a", "-" * 900 + "1", "a" * (MAX_LENGTH + 1)],
    ids=["(", "not", "-", "long"],
)
def test_size_and_depth_are_bounded(text):
    with pytest.raises(ExpressionError):
        parse_expression(text)


def test_a_long_flat_condition_is_possible():
    text = " or ".join(["count > 5"] * 70)
    assert value(text) is False


def test_names_are_known_with_their_columns():
    expression = parse_expression("  scene.age > 2 and (place == 'x.y' or not scene.age > 3)")
    assert expression.names == {"scene.age", "place"}
    assert [(m.name, m.column) for m in expression.mentions] == [
        ("scene.age", 3),
        ("place", 22),
        ("scene.age", 44),
    ]
    assert expression.text == "scene.age > 2 and (place == 'x.y' or not scene.age > 3)"


def test_an_unknown_name_is_refused_where_it_stands():
    with pytest.raises(ExpressionError, match="no name 'b'") as error:
        parse_expression("a > 1 and b > 1", known=lambda name: name == "a")
    assert error.value.column == 11


def test_kinds_of_names_are_checked_before_a_run():
    kinds = {"a": ValueKind.NUMBER, "t": ValueKind.TEXT}
    with pytest.raises(ExpressionError, match="cannot compare a number with a text"):
        parse_expression("a == t", kind_of=kinds.get)
    assert parse_expression("a == unknown", kind_of=kinds.get).kind is ValueKind.BOOLEAN
    assert parse_expression("a + 1", kind_of=kinds.get).kind is ValueKind.NUMBER
    assert parse_expression("unknown", kind_of=kinds.get).kind is None


def test_two_expressions_of_the_same_text_are_equal():
    assert parse_expression("a > 1") == parse_expression(" a > 1 ")
    assert hash(parse_expression("a > 1")) == hash(parse_expression("a > 1"))
