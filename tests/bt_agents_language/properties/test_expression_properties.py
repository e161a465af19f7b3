# SPDX-License-Identifier: Apache-2.0
"""Laws of expressions: they mean the same as their tree, and never crash."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from fractions import Fraction

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import EvaluationError, ValueKind
from bt_agents_language.expression.expressions import MissingValue, parse_expression
from bt_agents_language.expression.ranges import Range

VALUES: dict[str, object] = {
    "n": 4, "scene.age": 2.5, "zero": 0, "big": 1e300, "numbers": (3, 1.5, -2),
    "t": "red", "u": "a red ball", "texts": ["red", "green"],
    "b": True, "c": False,
}  # fmt: skip
KINDS = {
    name: ValueKind.of(value) for name, value in VALUES.items() if not isinstance(value, tuple)
}


@dataclass(frozen=True)
class Leaf:
    """A name or a value, with its text."""

    text: str
    value: object


@dataclass(frozen=True)
class Tree:
    """An operator or function with its operands."""

    word: str
    operands: tuple[Leaf | Tree, ...]


Node = Leaf | Tree


class Undefined(Exception):
    """The tree has no value."""


STRENGTH = {
    "or": 1, "and": 2, "not": 3,
    "==": 4, "!=": 4, "<": 4, "<=": 4, ">": 4, ">=": 4, "in": 4, "not in": 4, "between": 4,
    "+": 5, "-": 5, "*": 6, "/": 6, "%": 6, "minus": 7,
}  # fmt: skip
ARITHMETIC = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "%": operator.mod,
}  # fmt: skip
ORDER = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
CALLS = ("min", "max", "abs", "round", "len")


def names(*wanted: type) -> st.SearchStrategy[Node]:
    fitting = [
        Leaf(name, value)
        for name, value in VALUES.items()
        if isinstance(value, wanted) and isinstance(value, bool) == (bool in wanted)
    ]
    return st.sampled_from(fitting)


def trees(word: str, *operands: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    return st.tuples(*operands).map(lambda found: Tree(word, found))


def lists(items: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    return st.lists(items, min_size=1, max_size=3).map(lambda found: Tree("list", tuple(found)))


number_leaves = names(int, float) | (
    st.integers(0, 9) | st.sampled_from([0.5, 2.25, 10.0, 1e3])
).map(lambda value: Leaf(repr(value), value))
texts = names(str) | st.sampled_from(["", "red", "e", "Ä b"]).map(
    lambda value: Leaf(f"'{value}'", value)
)
numbers = st.recursive(
    number_leaves,
    lambda inner: st.one_of(
        *(trees(word, inner, inner) for word in ARITHMETIC),
        trees("minus", inner),
        trees("min", inner, inner),
        trees("max", inner, inner, inner),
        trees("max", lists(inner) | names(tuple)),
        trees("abs", inner),
        trees("round", inner),
        trees("round", inner, st.integers(0, 3).map(lambda digits: Leaf(str(digits), digits))),
        trees("len", texts | lists(inner) | names(tuple, list)),
    ),
    max_leaves=6,
)
booleans = st.recursive(
    st.one_of(
        names(bool),
        st.sampled_from([Leaf("true", True), Leaf("false", False)]),
        *(trees(word, numbers, numbers) for word in (*ORDER, "==", "!=")),
        *(trees(word, texts, texts) for word in ("==", "!=", "in", "not in")),
        *(trees(word, numbers, lists(numbers) | names(tuple)) for word in ("in", "not in")),
        *(trees(word, texts, lists(texts) | names(list)) for word in ("in", "not in")),
        trees("between", numbers, numbers, numbers),
    ),
    lambda inner: st.one_of(
        trees("and", inner, inner),
        trees("or", inner, inner),
        trees("not", inner),
        trees("==", inner, inner),
        trees("!=", inner, inner),
        trees("in", inner, lists(inner)),
    ),
    max_leaves=5,
)


def written(node: Node, at_least: int = 0) -> str:
    """Return a tree as text, with the fewest parentheses."""
    if isinstance(node, Leaf):
        return node.text
    word, operands = node.word, node.operands
    if word == "list":
        return f"[{', '.join(map(written, operands))}]"
    if word in CALLS:
        return f"{word}({', '.join(map(written, operands))})"
    strength = STRENGTH[word]
    # Comparisons do not chain; with others, only the left operand may have equal precedence.
    left = strength + (strength == STRENGTH["=="])
    match operands:
        case (only,):
            text = f"{'-' if word == 'minus' else 'not '}{written(only, strength)}"
        case (first, second):
            text = f"{written(first, left)} {word} {written(second, strength + 1)}"
        case (first, low, high):
            text = f"{written(first, left)} between {written(low, 5)} and {written(high, 5)}"
    return f"({text})" if strength < at_least else text


def meaning(node: Node) -> object:
    """Return the value of a tree by the definition, node by node.

    Raises:
        Undefined: The tree has no value.
    """
    if isinstance(node, Leaf):
        return node.value
    word, operands = node.word, node.operands
    if word in ("and", "or"):
        first = meaning(operands[0])
        return first if first is (word == "or") else meaning(operands[1])
    if word == "between":
        value, low = meaning(operands[0]), meaning(operands[1])
        return low <= value and value <= meaning(operands[2])
    values = [meaning(operand) for operand in operands]
    match word:
        case "list":
            return values
        case "not":
            return not values[0]
        case "==" | "!=":
            return (values[0] == values[1]) is (word == "==")
        case "in" | "not in":
            return (values[0] in values[1]) is (word == "in")
        case "len":
            return len(values[0])
        case _ if word in ORDER:
            return ORDER[word](*values)
    return finite(number(word, values))


def number(word: str, values: list) -> float:
    if word in ("min", "max"):
        several = values[0] if len(values) == 1 else values
        return sorted(several)[0 if word == "min" else -1]
    try:
        return NUMERIC[word](*values)
    except (ZeroDivisionError, OverflowError):
        raise Undefined from None


def finite(value: float) -> float:
    if not math.isfinite(value):
        raise Undefined
    return value


def school(value: float, digits: int = 0) -> float:
    """Return a number rounded as a fraction, halves away from zero, by its decimal digits."""
    if isinstance(value, int) or abs(value) >= 2**53:
        return value if digits else int(value)
    scaled = abs(Fraction(repr(value))) * 10**digits
    whole = Fraction(math.floor(scaled + Fraction(1, 2)), 10**digits)
    signed = whole if value > 0 else -whole
    return float(signed) if digits else int(signed)


NUMERIC = {**ARITHMETIC, "minus": operator.neg, "abs": abs, "round": school}


def is_refused_by_design(node: Node) -> bool:
    """Return whether there is a range of two literal numbers, the larger one first."""
    if isinstance(node, Leaf):
        return False
    if node.word == "between":
        ends = [constant(end) for end in node.operands[1:]]
        if None not in ends and ends[0] > ends[1]:
            return True
    return any(map(is_refused_by_design, node.operands))


def constant(node: Node) -> float | None:
    if isinstance(node, Leaf):
        return None if node.text in VALUES else node.value
    value = constant(node.operands[0]) if node.word == "minus" else None
    return None if value is None else -value


RANGES = {
    name: Range(value - 1, value + 1)
    for name, value in VALUES.items()
    if isinstance(value, int | float) and not isinstance(value, bool)
}


@settings(max_examples=400, deadline=None)
@given(booleans | numbers)
def test_expression_means_the_same_as_its_tree(tree):
    assume(not is_refused_by_design(tree))
    text = written(tree)
    assume(len(text) <= 1000)
    expression = parse_expression(text, kind_of=KINDS.get, range_of=RANGES.get)
    try:
        expected = meaning(tree)
    except Undefined:
        expected = None
    try:
        value = expression.evaluate(VALUES.__getitem__)
    except EvaluationError:
        value = None
    assert value == expected
    assert isinstance(value, bool) == isinstance(expected, bool)
    if value is not None and expression.kind is not None:
        assert ValueKind.of(value) is expression.kind
    lies_in = expression.range
    assert value is None or lies_in is None or lies_in.low <= value <= lies_in.high


PIECES = [
    "n", "t", "b", "l", "any.x", "1", "0", "2.5", "1e308", "'x'", '"', "'", "true", "null",
    "(", ")", "[", "]", ",", "-", "+", "*", "/", "%", "not", "and", "or", "in", "not in",
    "between", "<", "<=", "==", "!=", "=", "&&", "$", "${", ".", "min", "max", "abs(", "round(",
    "len(", "max(", "x.y(", "if", "is", "\\", "\n", "é", "\uff15", "\u2028", "\0",
]  # fmt: skip
plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([10**400, -(10**400)])
    | st.floats()
    | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner),
    max_leaves=4,
)


@settings(max_examples=600, deadline=None)
@given(
    st.text() | st.lists(st.sampled_from(PIECES), max_size=20).map(" ".join),
    st.sampled_from([{}, {"n": ValueKind.NUMBER, "t": ValueKind.TEXT, "b": ValueKind.BOOLEAN}]),
)
def test_any_text_parses_or_is_rejected_with_position(text, kinds):
    refusal = None
    try:
        parse_expression(text, kind_of=kinds.get)
    except ExpressionError as error:
        refusal = error
    if refusal is not None:
        assert 1 <= refusal.column <= len(text) + 1
        assert refusal.width >= 1
        assert 0 < len(refusal.message) < 150


@settings(max_examples=300, deadline=None)
@given(booleans | numbers, st.dictionaries(st.sampled_from([*VALUES]), plain))
def test_any_values_give_result_or_readable_error(tree, values):
    assume(not is_refused_by_design(tree))
    expression = parse_expression(written(tree))

    def lookup(name: str) -> object:
        if name not in values:
            raise MissingValue(name)
        return values[name]

    value, problem = None, None
    try:
        value = expression.evaluate(lookup)
    except (MissingValue, EvaluationError) as error:
        problem = error
    match problem:
        case MissingValue():
            assert problem.name in expression.names
        case EvaluationError():
            assert 1 <= problem.column <= len(expression.text)
            assert len(problem.message) < 150
        case None if isinstance(tree, Tree):
            assert ValueKind.of(value) is expression.kind
            assert expression.kind is not ValueKind.NUMBER or math.isfinite(value)


@settings(deadline=None)
@given(text=st.text(alphabet=st.characters(codec="utf-8") | st.sampled_from("0123456789.,- ")))
def test_number_from_any_text_is_finite_or_missing(text):
    expression = parse_expression("number(text) else none_there")
    found = expression.evaluate({"text": text, "none_there": None}.__getitem__)
    assert found is None or math.isfinite(found)
    assert found is None or any(sign.isdecimal() for sign in text)
