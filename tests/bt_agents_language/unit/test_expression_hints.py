# SPDX-License-Identifier: Apache-2.0
"""Slips in expressions: refused at the wrong word, with a hint."""

from __future__ import annotations

import pytest

from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import ValueKind
from bt_agents_language.expression.expressions import parse_expression

KINDS = {"n": ValueKind.NUMBER, "t": ValueKind.TEXT, "b": ValueKind.BOOLEAN, "l": ValueKind.LIST}


def refusal(marked: str) -> ExpressionError:
    """Return why a text is refused, after a check that the error is about the part in «…»."""
    text = marked.replace("«", "").replace("»", "")
    with pytest.raises(ExpressionError) as error:
        parse_expression(text, kind_of=KINDS.get, words_of={"d": ("saturday", "sunday")})
    begin = error.value.column - 1
    end = begin + error.value.width
    assert f"{text[:begin]}«{text[begin:end]}»{text[end:]}" == marked
    return error.value


@pytest.mark.parametrize(
    ("marked", "hint"),
    [
        ("«»", "write one"),
        ("« »  ", "write one"),
        ("n «=» 4", "compare with =="),
        ("n «=>» 4", "write >="),
        ("b «&&» b", "write and"),
        ("b «AND» b", "write and"),
        ("b == «True»", "write true"),
        ("«$»{n} > 1", "without ${ }"),
        ("t == «'»x", "close the text"),
        ("t == «“»x”", "straight quotation marks"),
        ("t == 'it«\\»'s'", 'put the whole text in "…"'),
        ("«(»n", "add a ')'"),
        ("n in «[»1, 2", "add a ']'"),
        ("max«(»n, 2", "add a ')'"),
        ("n«)»", "remove it"),
        ("n«]»", "remove it"),
        ("(«)»", ""),
        ("n «n»", "'and'"),
        ("t == my «place»", "texts in quotes"),
        ("«and» b", "before it"),
        ("1 < n «<» 3", "2 <= x and x <= 4"),
        ("n between 1 and 3 «==» b", "between 2 and 4"),
        ("n > «010»", "write 10"),
        ("n > «5s»", "write 5 (s)"),
        ("n > 5 «min»", "write 300 (s)"),
        ("n > «1.2.3»", ""),
        ("n > «1_000»", "write 1000"),
        ("n > «0x1F»", "write 31"),
        ("n > 1«,»5", "1.5"),
        ("n > 1«:»30", "1:30 is 90"),
        ("n > «+»5", "remove the +"),
        ("t in 'a'«,» 'b'", "['a', 'b']"),
        ("l«[»0] > 1", "'word' in l"),
        ("msg.data«[»0] > 1", "msg.data.0"),
        ("b or «5»", "x == 4 or x == 5"),
        ("b == «1»", "write only the name"),
        ("t == «10»", "in quotation marks, such as '10'"),
        ("n«;» b", "'and'"),
        ("n.m«.»", ""),
        ("n «**» 2 > 1", "a * a"),
        ("1 «if» b else 2", "two nodes with 'when'"),
        ("n «is» 3", "write =="),
        ("t == «null»", "known(x)"),
        ("n > «3» else b", "(x > 1) else false"),
        ("«t» > 3", "number(…)"),
        ("number(«n»)", "leave 'number' out"),
        ("known(«4»)", "known(scene.age)"),
        ("contains(«l», 'a')", "with 'in'"),
        ("contains(t, «''»)", "what to look for"),
        ("d == «'Sontag'»", "write one of saturday, sunday"),
        ("«'sun'» != d", "write one of saturday, sunday"),
        ("d in ['saturday', «'sun'»]", "write one of saturday, sunday"),
        # ranges, lists and functions
        ("n between 2«,» 4", "write between 2 and 4"),
        ("n between 2«»", "write between 2 and 4"),
        ("n between «(»2, 4)", "write between 2 and 4"),
        ("n between «[»2, 4]", "write between 2 and 4"),
        ("n «not» between 2 and 4", "not x between 2 and 4"),
        ("n in «(»1, 2)", "write [ … ]"),
        ("n in «{»1, 2}", "square brackets"),
        ("n in «1», 2", "between 2 and 4"),
        ("n in [1, 2,«]»", "remove the comma"),
        ("n == «[»1, 2]", "write in instead of =="),
        ("n == «'4'»", "remove the quotation marks: 4"),
        ("'true' != «b»", "remove the quotation marks: true"),
        ("«t» + ' there'", '"${a} ${b}"'),
        ("«max» > 3", "write max(a, b)"),
        # unknown functions and methods
        ("«Max»(1, 2)", "did you mean 'max'?"),
        ("«maxx»(1, 2)", "did you mean 'max'?"),
        ("«minimum»(1, 2)", "did you mean 'min'?"),
        ("«int»(n)", "the number in a text is number(text)"),
        ("«eval»('1')", "possible are min, max, abs, round, len"),
        ("«t.lower»() == 'a'", "write lower(t)"),
        ("«l.__class__»()", "possible are"),
        ("«scene.age.round»()", "write round(scene.age)"),
    ],
)
def test_slip_is_rejected_at_the_wrong_word(marked, hint):
    assert hint in refusal(marked).hint


@pytest.mark.parametrize(
    ("marked", "message"),
    [
        ("n < «'b'»", "'<' needs a number on each side, found a text"),
        ("n == «t»", "'==' cannot compare a number with a text"),
        ("-«t»", "'-' needs a number, found a text"),
        ("«n» in t", "'in' looks for a text in a text, found a number"),
        ("«[»1] in [1]", "'in' looks for one value, found a list"),
        ("n in [«[»1]]", "a list cannot stand in a list"),
        ("n between «4» and -5", "nothing lies between 4 and -5"),
        ("max(n, «t»)", "'max' needs numbers, found a text"),
        ("max(«[»'a'])", "'max' needs numbers, found a list of texts"),
        ("«max»()", "'max' is given nothing"),
        ("round(n, «-»1)", "'round' keeps 0 to 15 digits, found the number -1"),
        ("number(«b»)", "'number' needs a text, found true or false"),
        ("lower(«n»)", "'lower' needs a text, found a number"),
        ("«contains»(t)", "'contains' is given one value"),
        ("contains(t, «n»)", "'contains' looks for texts, found a number"),
    ],
)
def test_mismatched_kinds_are_rejected_at_wrong_value(marked, message):
    assert message in refusal(marked).message
