# SPDX-License-Identifier: Apache-2.0
"""Import of scripts of BehaviorTree.CPP as nodes and conditions of our language."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.formulas import (
    ARITHMETIC,
    Binary,
    Conditional,
    Constant,
    Formula,
    Name,
    Untranslatable,
    as_expression,
    names_in_formula,
)
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.scripts import Assignment, Statement
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, decorated, sequence


def as_condition(statements: list[Statement]) -> Formula:
    """Return a script as a condition.

    Raises:
        Untranslatable: It has an assignment.
    """
    if len(statements) != 1 or isinstance(statements[0], Assignment):
        raise Untranslatable("a condition cannot give names values")
    formula = statements[0]
    if isinstance(formula, Binary) and formula.operator in ARITHMETIC:
        return Binary("!=", formula, Constant(0))
    if isinstance(formula, Constant) and not isinstance(formula.value, bool | str):
        return Constant(formula.value != 0)
    return formula


def condition_text(formula: Formula, names: TreeNames) -> Raw:
    """Return a condition as text of our language; record its names as read.

    Raises:
        Untranslatable: Our language has no such condition.
    """
    text = as_expression(formula)
    names.read_formula(formula, FieldType.BOOLEAN)
    return Raw(text)


def as_node(statements: list[Statement], names: TreeNames) -> YamlNode:
    """Return the node for a script: ``set``, ``check``, or a sequence of them.

    Raises:
        Untranslatable: Our language has no equivalent of a statement.
    """
    nodes = list(_nodes(statements, names))
    return nodes[0] if len(nodes) == 1 else sequence(*nodes)


def _nodes(statements: list[Statement], names: TreeNames) -> Iterator[YamlNode]:
    values: dict[str, Data] = {}
    for statement in statements:
        if isinstance(statement, Assignment) and not isinstance(statement.value, Conditional):
            # The values of one 'set' cannot refer to each other.
            if {statement.name, *names_in_formula(statement.value)} & set(values):
                yield YamlNode(key="set", value=values)
                values = {}
            values[statement.name] = _assigned(statement, names)
            continue
        if values:
            yield YamlNode(key="set", value=values)
            values = {}
        if isinstance(statement, Assignment):
            yield _chosen(statement, names)
        else:
            formula = as_condition([statement])
            yield YamlNode(key="check", value=condition_text(formula, names))
    if values:
        yield YamlNode(key="set", value=values)


def _assigned(statement: Assignment, names: TreeNames) -> Data:
    if "." in statement.name:
        raise Untranslatable(f"'{statement.name}' cannot be given a value")
    formula = _with_joins(statement.value, names)
    value = _value(formula)
    names.assign(statement.name, formula)
    return value


def _with_joins(formula: Formula, names: TreeNames) -> Formula:
    """Return a formula with the operator that joins texts in place of their ``+``."""
    match formula:
        case Binary("+" | ".." as sign, left, right):
            sign = ".." if names.is_text(formula) else sign
            return Binary(sign, _with_joins(left, names), _with_joins(right, names))
    return formula


def _chosen(statement: Assignment, names: TreeNames) -> YamlNode:
    """Return ``name := condition ? yes : no`` as a ``choose``."""
    choice = statement.value
    assert isinstance(choice, Conditional)
    condition = condition_text(choice.condition, names)
    names.read_formula(choice.no)
    yes = as_node([Assignment(statement.name, choice.yes)], names)
    no = as_node([Assignment(statement.name, choice.no)], names)
    case = decorated(replace(yes, name="then"), "when", condition)
    return YamlNode(key="choose", value={"otherwise": no}, children=(case,))


def _value(formula: Formula) -> Data:
    match formula:
        case Constant(value):
            return value.replace("${", "$${") if isinstance(value, str) else value
        case Name(name):
            return Raw(f"${{{name}}}")
        case Binary("..", _, _):
            return _joined(formula)
    return Raw(_embedded(formula))


def _embedded(formula: Formula) -> str:
    text = as_expression(formula)
    if any(sign in text for sign in "{}$"):
        raise Untranslatable("a text with {, } or $ in it cannot stand inside of ${…}")
    return f"${{{text}}}"


def _joined(formula: Formula) -> str:
    """Return a joined text, with values in ``${…}``."""
    match formula:
        case Binary("..", left, right):
            return _joined(left) + _joined(right)
        case Constant(str() as value):
            return value.replace("${", "$${")
        case Constant():
            return as_expression(formula)
    return _embedded(formula)
