# SPDX-License-Identifier: Apache-2.0
"""Formulas: common form of our expressions and BehaviorTree.CPP's scripts, and both texts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial, reduce

from bt_agents_core.errors import BtAgentsError


class Untranslatable(BtAgentsError):
    """Raised for constructs without an equivalent in the other language."""


@dataclass(frozen=True)
class Constant:
    """Number, text, true or false."""

    value: bool | int | float | str


@dataclass(frozen=True)
class Name:
    """Name in the form of our language, for example ``scene.age``."""

    name: str


@dataclass(frozen=True)
class Unary:
    """``not`` or ``-`` before an operand; ``~`` occurs only in scripts."""

    operator: str
    operand: Formula


@dataclass(frozen=True)
class Binary:
    """Operator between two operands, in the form of our language; ``..`` concatenates texts."""

    operator: str
    left: Formula
    right: Formula


@dataclass(frozen=True)
class Conditional:
    """``condition ? yes : no``."""

    condition: Formula
    yes: Formula
    no: Formula


@dataclass(frozen=True)
class Call:
    """Call of a function of our language; a list is a call of ``[``."""

    function: str
    arguments: tuple[Formula, ...]


Formula = Constant | Name | Unary | Binary | Conditional | Call

COMPARISONS = ("==", "!=", "<", "<=", ">", ">=")
ARITHMETIC = ("+", "-", "*", "/", "%")

_OURS = {
    "or": 1, "and": 2, **dict.fromkeys(COMPARISONS, 4), "+": 5, "-": 5, "*": 6, "/": 6, "%": 6,
}  # fmt: skip
_SCRIPT = {
    "or": 6, "and": 8, **dict.fromkeys(COMPARISONS, 10), "+": 16, "-": 16, "..": 16,
    "*": 18, "/": 18,
}  # fmt: skip
_SCRIPT_WORDS = {"or": "||", "and": "&&"}
_SCRIPT_PREFIX = 20
_NOT, _MINUS, _OPERAND = 3, 7, 99

GROUPS = ("scene", "live", "profile", "mood", "clock", "person", "cancel")
"""Prefixes of dotted names, as in ``scene.age``."""

_GROUPED = re.compile(rf"({'|'.join(GROUPS)})__(\w+)")


def negated(formula: Formula) -> Formula:
    """Return the negation of a formula."""
    match formula:
        case Unary("not", operand):
            return operand
        case Constant(bool() as value):
            return Constant(not value)
    return Unary("not", formula)


def negative(formula: Formula) -> Formula:
    """Return a formula with a preceding minus sign."""
    match formula:
        case Constant(int() | float() as value) if not isinstance(value, bool):
            return Constant(-value)
    return Unary("-", formula)


def names_in_formula(formula: Formula) -> Iterator[str]:
    """Return the names in a formula, in order."""
    match formula:
        case Name(name):
            yield name
        case Unary(_, operand):
            yield from names_in_formula(operand)
        case Binary(_, left, right):
            yield from names_in_formula(left)
            yield from names_in_formula(right)
        case Conditional(condition, yes, no):
            for part in (condition, yes, no):
                yield from names_in_formula(part)
        case Call(_, arguments):
            for part in arguments:
                yield from names_in_formula(part)


def as_expression(formula: Formula) -> str:
    """Return a formula as an expression of our language.

    Raises:
        Untranslatable: It has bit operators, or concatenates texts.
    """
    return _expression(formula)[0]


def _expression(formula: Formula) -> tuple[str, int]:
    """Return the text of a formula and the strength of its outermost operator."""
    match formula:
        case Constant(value):
            return _constant(value), _MINUS if _is_negative(value) else _OPERAND
        case Name(name):
            return name, _OPERAND
        case Unary("not", operand):
            return f"not {_enclosed(_expression(operand), _NOT)}", _NOT
        case Unary("-", operand):
            return f"-{_enclosed(_expression(operand), _MINUS)}", _MINUS
        case Binary(operator, left, right) if operator in _OURS:
            strength = _OURS[operator]
            # Comparisons do not chain; '-' and '/' are left-associative.
            first = _enclosed(_expression(left), strength + (operator in COMPARISONS))
            return f"{first} {operator} {_enclosed(_expression(right), strength + 1)}", strength
        case Conditional(condition, yes, no):
            either = Binary("and", condition, yes)
            return _expression(Binary("or", either, Binary("and", negated(condition), no)))
        case Call("[", arguments):
            return f"[{', '.join(map(as_expression, arguments))}]", _OPERAND
        case Call(function, arguments):
            return f"{function}({', '.join(map(as_expression, arguments))})", _OPERAND
    raise Untranslatable(f"our language has no operator '{formula.operator}' in a condition")


def _enclosed(operand: tuple[str, int], strength: int) -> str:
    """Return an operand in parentheses, unless its operator is strong enough."""
    text, own = operand
    return text if own >= strength else f"({text})"


def _constant(value: bool | int | float | str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, str):
        return repr(value)
    if "'" not in value:
        return f"'{value}'"
    if '"' in value:
        raise Untranslatable("a text with both kinds of quotation marks cannot stand here")
    return f'"{value}"'


def _is_negative(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value < 0


def as_script(formula: Formula) -> str:
    """Return a formula in the script language of BehaviorTree.CPP.

    Raises:
        Untranslatable: It uses a function, a list, ``%`` or a text with both quotation marks.
    """
    return _script(formula)[0]


def _script(formula: Formula) -> tuple[str, int]:
    match formula:
        case Constant(value):
            return _constant(value), _SCRIPT_PREFIX if _is_negative(value) else _OPERAND
        case Name(name):
            return script_name(name), _OPERAND
        case Unary(operator, operand) if operator in ("not", "-"):
            sign = "!" if operator == "not" else "-"
            return f"{sign}{_enclosed(_script(operand), _SCRIPT_PREFIX)}", _SCRIPT_PREFIX
        case Binary(operator, left, right) if operator in _SCRIPT:
            strength = _SCRIPT[operator]
            first = _enclosed(_script(left), strength + (operator in COMPARISONS))
            word = _SCRIPT_WORDS.get(operator, operator)
            return f"{first} {word} {_enclosed(_script(right), strength + 1)}", strength
        case Binary("in", operand, Call("[", arguments)):
            equal = (Binary("==", operand, argument) for argument in arguments)
            return _script(reduce(partial(Binary, "or"), equal))
        case Binary(operator, _, _):
            raise Untranslatable(f"scripts have no operator '{operator}'")
        case Call(function, _):
            raise Untranslatable(
                "scripts have no lists" if function == "[" else f"scripts have no {function}()"
            )
    raise Untranslatable("this cannot be written as a script")


def script_name(name: str) -> str:
    """Return a name in the form of scripts: ``scene.age`` becomes ``scene__age``.

    Raises:
        Untranslatable: It is a message field, or has letters that scripts do not allow.
    """
    head, point, _ = name.partition(".")
    text = name.replace(".", "__", 1)
    if (point and head not in GROUPS) or not re.fullmatch(r"[A-Za-z_]\w*", text, re.ASCII):
        raise Untranslatable(f"scripts cannot name '{name}'")
    return text


def dotted_name(name: str) -> str | None:
    """Return the dotted name for a name made by :func:`script_name`; None for any other."""
    match = _GROUPED.fullmatch(name)
    return f"{match[1]}.{match[2]}" if match else None
