# SPDX-License-Identifier: Apache-2.0
"""Scripts of BehaviorTree.CPP as expressions, and expressions as scripts."""

from __future__ import annotations

import pytest

from bt_agents_groot.expressions import parse_formula
from bt_agents_groot.formulas import Untranslatable, as_expression, as_script
from bt_agents_groot.script_nodes import as_condition
from bt_agents_groot.scripts import ScriptError, parse_script


def condition(script: str) -> str:
    return as_expression(as_condition(parse_script(script, str)))


@pytest.mark.parametrize(
    ("script", "expression"),
    [
        ("a && b || !c", "a and b or not c"),
        ("!a == b", "(not a) == b"),
        ("1 < x < 5", "1 < x and x < 5"),
        ("""x == 'say "hi"'""", """x == 'say "hi"'"""),
        ("""x == "it's" """, """x == "it's\""""),
        ("-x + 2 * (y - 1) / 4 >= 0.5", "-x + 2 * (y - 1) / 4 >= 0.5"),
        ("a ? b : c", "a and b or not a and c"),
        ("x", "x"),
        ("x - 3", "x - 3 != 0"),
        ("1", "true"),
        ("0x1F == n", "31 == n"),
    ],
)  # fmt: skip
def test_query_script_becomes_condition(script, expression):
    assert condition(script) == expression


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("flags & 4", "no operator '&'"),
        ("~x > 1", "no operator '~'"),
        ("'a' .. b == 'ab'", "no operator '..'"),
        ("x := 1", "cannot give names values"),
    ],
)
def test_untranslatable_script_is_reported_with_reason(script, reason):
    with pytest.raises(Untranslatable, match=reason.replace("..", r"\.\.")):
        condition(script)


@pytest.mark.parametrize(
    ("script", "offset", "message"),
    [
        ("", 0, "there is no script"),
        ("x :=", 4, "ends where a value is expected"),
        ("x == 'a", 5, "quotation mark is not closed"),
        ("(a", 0, "is not closed"),
        ("a b", 2, "an operator is expected before 'b'"),
        ("3 := 4", 0, "only a name can stand before ':='"),
        ("65.43foo", 0, "means nothing"),
        ("a ? b", 5, "a ':' is expected"),
        ("a == ;", 5, "a value or name is expected, found ';'"),
        ("a # b", 2, "means nothing"),
        ("(" * 40 + "1", 32, "nested more than 32 deep"),
        ("1+" * 300 + "1", 400, "more than 400 words"),
    ],
)
def test_invalid_script_is_rejected_at_error_offset(script, offset, message):
    with pytest.raises(ScriptError) as error:
        parse_script(script, str)
    assert message in error.value.message
    assert error.value.offset == offset


def test_semicolons_between_assignments_are_optional():
    assert [one.name for one in parse_script("a := 1 b := 2", str)] == ["a", "b"]


@pytest.mark.parametrize(
    ("expression", "script"),
    [
        ("clock.hour >= 22", "clock__hour >= 22"),
        ("a between 1 and 2", "1 <= a && a <= 2"),
        ("a in ['y', 'x']", "a == 'y' || a == 'x'"),
        ("a not in [1]", "!(a == 1)"),
        ("""a == "it's" """, """a == "it's\""""),
    ],
)
def test_expression_is_exported_as_script(expression, script):
    assert as_script(parse_formula(expression)) == script


@pytest.mark.parametrize(
    "expression", ["max(a, b) > 1", "a % 2 == 0", "msg.data", "a else 1 > 2", "known(a)"]
)
def test_expression_without_script_equivalent_is_rejected(expression):
    with pytest.raises(Untranslatable):
        as_script(parse_formula(expression))
