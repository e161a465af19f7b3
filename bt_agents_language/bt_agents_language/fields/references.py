# SPDX-License-Identifier: Apache-2.0
"""References ``${…}`` in texts: names and expressions, split from plain text and checked."""

from __future__ import annotations

import re
from functools import lru_cache

from bt_agents_core.field_types import FieldType
from bt_agents_core.text import quote
from bt_agents_language.expression.expression_tokens import NAME, ExpressionError
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import Computed, Reference
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Scalar

Part = str | Reference | Computed
"""A piece of a text: plain text, a name, or an expression."""

_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)(\}?)")
_WHERE_TEXTS_STAND = re.compile(r"(==|!=|\[|,)\s*$")
_DOTTED = re.compile(NAME)

ONE_NAME = re.compile(rf"\$\{{\s*({NAME})\s*\}}")
"""A text that is a name and nothing else."""


def read_parts(reading: TypedReader, node: Scalar, names: NameScope) -> tuple[Part, ...] | None:
    """Return the parts of a text; None when a ``${…}`` in it is wrong, which is then reported.

    ``$${`` stands for the plain text ``${``.
    """
    if "${" not in node.text:
        return (node.text,)
    alone = ONE_NAME.fullmatch(node.text)
    if alone is not None and names.problem(alone[1]) is None:
        return (_reference(alone[1], names.type_of(alone[1]) or FieldType.ANY),)
    parts: list[Part] = []
    plain = ""
    at = 0
    sound = True
    for match in _REFERENCE.finditer(node.text):
        plain += node.text[at : match.start()]
        at = match.end()
        if match[1] is None:
            plain += "${"
            continue
        part = _read_one(reading, node, match, names)
        if part is None:
            sound = False
            continue
        if plain:
            parts.append(plain)
            plain = ""
        parts.append(part)
    plain += node.text[at:]
    if plain:
        parts.append(plain)
    return tuple(parts) if sound else None


def _read_one(
    reading: TypedReader, node: Scalar, match: re.Match[str], names: NameScope
) -> Reference | Computed | None:
    inner = match[1].strip()
    offset = match.start(1) + len(match[1]) - len(match[1].lstrip())
    problem, hint = "", ""
    if not match[2] and node.text.startswith("${", match.end()):
        problem, hint = "a ${…} stands inside of another one", "write one ${ } around the whole"
    elif not match[2]:
        problem = "this '${' is not closed"
        hint = "close it: ${name}; for the plain text ${ write $${"
    elif not inner:
        problem, hint = "there is no name in ${ }", "write one: ${name}"
    if problem:
        reading.error_in("bad-reference", node, match.start(), len(match[0]), problem, hint)
        return None
    if _DOTTED.fullmatch(inner):
        unknown = names.problem(inner)
        if unknown is None:
            return _reference(inner, names.type_of(inner) or FieldType.ANY)
        _report_name(reading, node, inner, offset, unknown)
        return None
    expression = read_expression(reading, node, inner, offset, quote(inner), names)
    return None if expression is None else Computed(expression=expression)


@lru_cache(maxsize=1024)
def _reference(name: str, field_type: FieldType) -> Reference:
    """Return a name; files name the same ones again and again."""
    return Reference(name=name, type=field_type)


def read_expression(
    reading: TypedReader, node: Scalar, text: str, offset: int, what: str, names: NameScope
) -> Expression | None:
    """Return the expression that stands from ``offset`` on in a scalar's text.

    Returns:
        None when it is no expression or a name is not known, which is then reported.
    """
    try:
        expression = names.parse(text)
    except ExpressionError as error:
        place = offset + error.column - 1
        reading.error_in(
            "bad-expression", node, place, error.width, f"{what}: {error.message}", error.hint
        )
        return None
    sound = True
    for mention in expression.mentions:
        before = text[: mention.column - 1]
        maybe_text = _WHERE_TEXTS_STAND.search(before) is not None
        problem = names.problem(mention.name, maybe_text=maybe_text)
        if problem is None:
            continue
        sound = False
        _report_name(reading, node, mention.name, offset + len(before), problem)
    return expression if sound else None


def _report_name(
    reading: TypedReader, node: Scalar, name: str, offset: int, problem: tuple[str, str, str]
) -> None:
    code, message, hint = problem
    reading.error_in(code, node, offset, len(name), message, hint)
