# SPDX-License-Identifier: Apache-2.0
"""Slips in expressions: refused at the wrong word, with a hint."""

from __future__ import annotations

import pytest

from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import ValueKind
from bt_agents_language.expression.expressions import parse_expression

KINDS = {"n": ValueKind.NUMBER, "t": ValueKind.TEXT, "b": ValueKind.BOOLEAN, "l": ValueKind.LIST}


def refusal(text: str) -> ExpressionError:
    with pytest.raises(ExpressionError) as error:
        parse_expression(text, kind_of=KINDS.get, words_of={"d": ("saturday", "sunday")})
    return error.value


def marked(error: ExpressionError, text: str) -> str:
    """Return the part of a text that an error marks."""
    return text[error.column - 1 : error.column - 1 + error.width]


@pytest.mark.parametrize(
    ("text", "column", "word", "hint"),
    [
        ("", 1, "", "write one"),
        ("   ", 1, " ", "write one"),
        ("n = 4", 3, "=", "compare with =="),
        ("n => 4", 3, "=>", "write >="),
        ("n === 4", 3, "===", "write =="),
        ("n !== 4", 3, "!==", "write !="),
        ("n <> 4", 3, "<>", "write !="),
        ("n ≥ 4", 3, "≥", "write >="),
        ("b && b", 3, "&&", "write and"),
        ("b || b", 3, "||", "write or"),
        ("!b", 1, "!", "write not"),
        ("b AND b", 3, "AND", "write and"),
        ("n Between 1 and 2", 3, "Between", "write between"),
        ("b == True", 6, "True", "write true"),
        ("${n} > 1", 1, "$", "without ${ }"),
        ("t == 'x", 6, "'", "close the text"),
        ("t == “x”", 6, "“", "straight quotation marks"),
        ("t == 'it\\'s'", 9, "\\", 'put the whole text in "…"'),
        ("(n", 1, "(", "add a ')'"),
        ("n in [1, 2", 6, "[", "add a ']'"),
        ("max(n, 2", 4, "(", "add a ')'"),
        ("n)", 2, ")", "remove it"),
        ("n]", 2, "]", "remove it"),
        ("()", 2, ")", ""),
        ("n n", 3, "n", "'and'"),
        ("t == my place", 9, "place", "texts in quotes"),
        ("n ==", 5, "", ""),
        ("and b", 1, "and", "before it"),
        ("between 1 and 2", 1, "between", "before it"),
        ("1 < n < 3", 7, "<", "2 <= x and x <= 4"),
        ("n == 1 == b", 8, "==", "2 <= x and x <= 4"),
        ("n between 1 and 3 == b", 19, "==", "between 2 and 4"),
        ("n > 010", 5, "010", "write 10"),
        ("n > 5s", 5, "5s", "write 5 (s)"),
        ("n > 5 min", 7, "min", "write 300 (s)"),
        ("n > 20cm", 5, "20cm", "write 0.2 (m)"),
        ("n > 90 deg", 8, "deg", "write 1.5708 (rad)"),
        ("n > 1.2.3", 5, "1.2.3", ""),
        ("n > 1_000", 5, "1_000", "write 1000"),
        ("n > 0x1F", 5, "0x1F", "write 31"),
        ("n > 1e999", 5, "1e999", ""),
        ("n > 1,5", 6, ",", "1.5"),
        ("n > 1:30", 6, ":", "1:30 is 90"),
        ("n > +5", 5, "+", "remove the +"),
        ("t in 'a', 'b'", 9, ",", "['a', 'b']"),
        ("l[0] > 1", 2, "[", "'word' in l"),
        ("msg.data[0] > 1", 9, "[", "msg.data.0"),
        ("b or 5", 6, "5", "x == 4 or x == 5"),
        ("b == 1", 6, "1", "write only the name"),
        ("t == 10", 6, "10", "in quotation marks, such as '10'"),
        ("n; b", 2, ";", "'and'"),
        ("n.m.", 4, ".", ""),
        (".n", 1, ".", ""),
        ("n ** 2 > 1", 3, "**", "a * a"),
        ("n // 2 > 1", 3, "//", "round(a / b)"),
        ("n += 1", 3, "+=", "'set'"),
        ("lambda: 0", 7, ":", ""),
        ("1 if b else 2", 3, "if", "two nodes with 'when'"),
        ("b ? 1 : 2", 3, "?", "two nodes with 'when'"),
        ("n is 3", 3, "is", "write =="),
        ("t contains 'a'", 3, "contains", "contains(the_text, 'word')"),
        ("n mod 2 == 0", 3, "mod", "write %"),
        ("t == null", 6, "null", "known(x)"),
        ("t != None", 6, "None", "x else 1"),
        ("n > 3 else b", 5, "3", "(x > 1) else false"),
        ("t > 3", 1, "t", "number(…)"),
        ("number(n)", 8, "n", "leave 'number' out"),
        ("known(4)", 7, "4", "known(scene.age)"),
        ("contains(l, 'a')", 10, "l", "with 'in'"),
        ("contains(t, '')", 13, "''", "what to look for"),
        ("n Else 1", 3, "Else", "write else"),
        ("d == 'Sontag'", 6, "'Sontag'", "write one of saturday, sunday"),
        ("'sun' != d", 1, "'sun'", "write one of saturday, sunday"),
        ("d in ['saturday', 'sun']", 19, "'sun'", "write one of saturday, sunday"),
    ],
)
def test_slip_is_rejected_at_the_wrong_word(text, column, word, hint):
    error = refusal(text)
    assert error.column == column
    assert marked(error, text) == word
    assert hint in error.hint


@pytest.mark.parametrize(
    ("text", "word", "message"),
    [
        ("n < 'b'", "'b'", "'<' needs a number on each side, found a text"),
        ("'b' < n", "'b'", "'<' needs a number on each side, found a text"),
        ("n == t", "t", "'==' cannot compare a number with a text"),
        ("n == (t)", "t", "'==' cannot compare a number with a text"),
        ("not 3", "3", "'not' needs true or false, found a number"),
        ("true > 1", "true", "'>' needs a number"),
        ("1 and b", "1", "'and' needs true or false on each side, found a number"),
        ("b and n + 1", "n", "'and' needs true or false on each side, found a number"),
        ("-t", "t", "'-' needs a number, found a text"),
        ("n == l", "l", "'==' cannot compare with a list"),
        ("[1] != n", "[", "'!=' cannot compare with a list"),
        ("n in 4", "4", "'in' needs a list or a text after it, found a number"),
        ("n in t", "n", "'in' looks for a text in a text, found a number"),
        ("n not in ['a']", "n", "the list after 'not in' holds texts, found a number"),
        ("[1] in [1]", "[", "'in' looks for one value, found a list"),
        ("n in [1, 'a']", "'a'", "this list holds numbers, found a text"),
        ("n in [[1]]", "[", "a list cannot stand in a list"),
        ("n in []", "[", "this list is empty"),
        ("n between 'a' and 4", "'a'", "'between' needs numbers, found a text"),
        ("t between 1 and 4", "t", "'between' needs numbers, found a text"),
        ("n between 4 and 2", "4", "nothing lies between 4 and 2"),
        ("n between 4 and -5", "4", "nothing lies between 4 and -5"),
        ("max(n, t)", "t", "'max' needs numbers, found a text"),
        ("max(['a'])", "[", "'max' needs numbers, found a list of texts"),
        ("max(n, [1])", "[", "'max' needs numbers, found a list"),
        ("max(3)", "3", "'max' needs two numbers or more, or one list, found a number"),
        ("max()", "max", "'max' is given nothing"),
        ("abs(1, 2)", "abs", "'abs' is given 2 values"),
        ("abs(t)", "t", "'abs' needs a number, found a text"),
        ("round()", "round", "'round' is given nothing"),
        ("round(n, 1.5)", "1.5", "'round' keeps 0 to 15 digits, found the number 1.5"),
        ("round(n, 16)", "16", "'round' keeps 0 to 15 digits, found the number 16"),
        ("round(n, -1)", "-", "'round' keeps 0 to 15 digits, found the number -1"),
        ("len(n)", "n", "'len' needs a text or a list, found a number"),
        ("len(t, t)", "len", "'len' is given 2 values"),
        ("number(b)", "b", "'number' needs a text, found true or false"),
        ("lower(n)", "n", "'lower' needs a text, found a number"),
        ("contains(t)", "contains", "'contains' is given one value"),
        ("contains(t, n)", "n", "'contains' looks for texts, found a number"),
        ("known()", "known", "'known' is given nothing"),
        ("n else 'a'", "'a'", "'else' needs a number in place of a missing one, found a text"),
    ],
)
def test_mismatched_kinds_are_rejected_at_wrong_value(text, word, message):
    error = refusal(text)
    assert marked(error, text) == word
    assert message in error.message


@pytest.mark.parametrize(
    ("text", "column", "hint"),
    [
        ("n between 2, 4", 12, "write between 2 and 4"),
        ("n between 2", 12, "write between 2 and 4"),
        ("n between 2 to 4", 13, "write between 2 and 4"),
        ("n between (2, 4)", 11, "write between 2 and 4"),
        ("n between [2, 4]", 11, "write between 2 and 4"),
        ("n not between 2 and 4", 3, "not x between 2 and 4"),
        ("n in (1, 2)", 6, "write [ … ]"),
        ("n in {1, 2}", 6, "square brackets"),
        ("n in 1, 2", 6, "between 2 and 4"),
        ("n in [1, 2,]", 12, "remove the comma"),
        ("n == [1, 2]", 6, "write in instead of =="),
        ("n == '4'", 6, "remove the quotation marks: 4"),
        ("'true' != b", 11, "remove the quotation marks: true"),
        ("t + ' there'", 1, '"${a} ${b}"'),
        ("max > 3", 1, "write max(a, b)"),
        ("len", 1, "write len(x)"),
    ],
)
def test_common_range_list_and_function_slips_have_hints(text, column, hint):
    error = refusal(text)
    assert error.column == column
    assert hint in error.hint


@pytest.mark.parametrize(
    ("text", "word", "hint"),
    [
        ("Max(1, 2)", "Max", "did you mean 'max'?"),
        ("maxx(1, 2)", "maxx", "did you mean 'max'?"),
        ("minimum(1, 2)", "minimum", "did you mean 'min'?"),
        ("int(n)", "int", "the number in a text is number(text)"),
        ("lowercase(t)", "lowercase", "did you mean 'lower'?"),
        ("exists(n)", "exists", "did you mean 'known'?"),
        ("default(n, 1)", "default", "write x else 1"),
        ("length(t)", "length", "did you mean 'len'?"),
        ("sum(1, 2)", "sum", "add with +"),
        ("str(n)", "str", "fit into a text as they are"),
        ("any(b, b)", "any", "'or'"),
        ("eval('1')", "eval", "possible are min, max, abs, round, len"),
        ("exec(n)", "exec", "possible are"),
        ("t.lower() == 'a'", "t.lower", "write lower(t)"),
        ("t.startswith('a')", "t.startswith", "'word' in t"),
        ("l.__class__()", "l.__class__", "possible are"),
        ("scene.age.round()", "scene.age.round", "write round(scene.age)"),
    ],
)
def test_unknown_functions_and_methods_are_rejected_with_alternatives(text, word, hint):
    error = refusal(text)
    assert marked(error, text) == word
    assert hint in error.hint
