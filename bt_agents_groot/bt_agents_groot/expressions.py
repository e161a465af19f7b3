# SPDX-License-Identifier: Apache-2.0
"""Conversion of our expressions to formulas, and of our conditions and values to scripts."""

from __future__ import annotations

from functools import partial, reduce

from bt_agents_groot.formulas import (
    Binary,
    Call,
    Constant,
    Formula,
    Name,
    Unary,
    Untranslatable,
    as_script,
    names_in_formula,
    negated,
    negative,
    script_name,
)
from bt_agents_groot.ports import REFERENCE
from bt_agents_language.expression.expression_values import Part
from bt_agents_language.expression.expressions import parse_parts
from bt_agents_language.expression.operators import BINARY
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar


def parse_formula(text: str) -> Formula:
    """Return the formula for a checked expression of our language.

    ``a between b and c`` becomes two comparisons.
    """
    return _formula_of(parse_parts(text))


def condition_script(node: Node, *, opposite: bool = False) -> str:
    """Return a condition or its negation as a script.

    Raises:
        Untranslatable: Scripts cannot express it.
    """
    assert isinstance(node, Scalar)
    formula = parse_formula(node.text)
    return as_script(negated(formula) if opposite else formula)


def set_script(entries: tuple[MappingEntry, ...]) -> str:
    """Return the script that sets names to values.

    Raises:
        Untranslatable: A value has no equivalent, or needs a name that is set together with it.
    """
    statements: list[str] = []
    names: set[str] = set()
    for entry in entries:
        if "." in entry.key.text:
            raise Untranslatable("a script sets names of its blackboard only")
        value = _formula(entry.value)
        if names & set(names_in_formula(value)):
            raise Untranslatable("the values of a script follow each other")
        names.add(entry.key.text)
        statements.append(f"{script_name(entry.key.text)} := {as_script(value)}")
    return "; ".join(statements)


def _formula_of(part: Part) -> Formula:
    match part.operator, tuple(map(_formula_of, part.operands)):
        case "", _:
            return Name(part.name) if part.constant is None else Constant(part.constant)
        case "not", (operand,):
            return Unary("not", operand)
        case "-", (operand,):
            return negative(operand)
        case "not in", (left, right):
            return Unary("not", Binary("in", left, right))
        case "between", (value, low, high):
            return Binary("and", Binary("<=", low, value), Binary("<=", value, high))
        case operator, (left, right) if operator in BINARY:
            return Binary(operator, left, right)
        case function, arguments:
            return Call(function, arguments)


def _formula(node: Node) -> Formula:
    if not isinstance(node, Scalar):
        raise Untranslatable("scripts have no lists and mappings")
    if "${" not in node.text:
        value = plain_value(node)
        if not isinstance(value, bool | int | float | str):
            raise Untranslatable("scripts have no such value")
        return Constant(value)
    plain, *rest = REFERENCE.split(node.text)
    pieces: list[Formula] = []
    for expression, following in zip(rest[::2], rest[1::2], strict=True):
        if expression is None:
            plain += "${" + following
            continue
        if plain:
            pieces.append(Constant(plain))
        pieces.append(parse_formula(expression.strip()))
        plain = following
    if plain or not pieces:
        pieces.append(Constant(plain))
    return reduce(partial(Binary, ".."), pieces)
