# SPDX-License-Identifier: Apache-2.0
"""Export of values: conditions, times and numbers in the notation of BehaviorTree.CPP."""

from __future__ import annotations

from contextlib import suppress

from bt_agents_groot.expressions import parse_formula
from bt_agents_groot.formulas import (
    Binary,
    Constant,
    Formula,
    Untranslatable,
    as_script,
    names_in_formula,
    negated,
    script_name,
)
from bt_agents_groot.ports import REFERENCE, only_name
from bt_agents_language.expression.quantities import QuantityError, duration
from bt_agents_language.nodes.node_type import FOREVER
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar

_LONGEST_MS = 999_999_999


def condition_script(node: Node, *, negative: bool = False) -> str:
    """Return a condition as a script, or the opposite of it.

    Raises:
        Untranslatable: Scripts cannot express it.
    """
    assert isinstance(node, Scalar)
    formula = parse_formula(node.text)
    return as_script(negated(formula) if negative else formula)


def set_script(entries: tuple[MappingEntry, ...]) -> str:
    """Return the script that sets names to values.

    Raises:
        Untranslatable: A value has no equivalent, or needs a name that is set with it.
    """
    statements: list[str] = []
    names: set[str] = set()
    for entry in entries:
        value = _formula(entry.value)
        if names & set(names_in_formula(value)):
            raise Untranslatable("the values of a script follow each other")
        names.add(entry.key.text)
        statements.append(f"{script_name(entry.key.text)} := {as_script(value)}")
    return "; ".join(statements)


def milliseconds(node: Node) -> str:
    """Return a time as whole milliseconds.

    Raises:
        Untranslatable: It is not a constant time.
    """
    if isinstance(node, Scalar) and "${" not in node.text:
        with suppress(QuantityError):
            amount = duration(node.text) * 1000
            whole = round(amount)
            if 0 < whole <= _LONGEST_MS and abs(amount - whole) < 1e-6:
                return str(whole)
    raise Untranslatable("a port takes whole milliseconds")


def number_port(node: Node) -> str:
    """Return a number of attempts for a port.

    Raises:
        Untranslatable: It is not a number or a single name.
    """
    if isinstance(node, Scalar):
        if node.text == FOREVER:
            return "-1"
        name = only_name(node.text)
        if name is not None:
            return f"{{{name.replace('.', '__')}}}"
        if node.text.isdigit():
            return node.text
    raise Untranslatable("a port takes a number or a single name")


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
    whole = pieces[0]
    for piece in pieces[1:]:
        whole = Binary("..", whole, piece)
    return whole
