# SPDX-License-Identifier: Apache-2.0
"""Values with names in them, ``Hello ${who}.``, and conditions, checked against known names."""

from __future__ import annotations

import re

from bt_agents.language import quantities
from bt_agents.language.diagnostics import shown
from bt_agents.language.expressions import (
    Expression,
    ExpressionError,
    ValueKind,
    parse_expression,
)
from bt_agents.language.names import Names
from bt_agents.language.scalars import plain_value
from bt_agents.language.shape import FileReading
from bt_agents.language.specs import (
    FieldType,
    ListValue,
    Literal,
    MapValue,
    Reference,
    Text,
    Value,
)
from bt_agents.language.yaml_reader import Mapping, Node, Scalar, Sequence

_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)(\}?)")
_DOTTED = re.compile(r"[^\W\d]\w*(\.\w+)*")

_FITTING = {
    FieldType.NUMBER: {FieldType.NUMBER, FieldType.INTEGER, FieldType.DURATION},
    FieldType.INTEGER: {FieldType.INTEGER},
    FieldType.DURATION: {FieldType.DURATION, FieldType.NUMBER, FieldType.INTEGER},
    FieldType.BOOLEAN: {FieldType.BOOLEAN},
}
"""Type of a place → types of names that may stand there; texts and any take every name."""

_EXPECTED = {
    FieldType.TEXT: "a text",
    FieldType.NUMBER: "a number",
    FieldType.INTEGER: "a whole number",
    FieldType.BOOLEAN: "true or false",
    FieldType.DURATION: "a time such as '8 s'",
    FieldType.ANY: "a value",
}


def read_value(
    reading: FileReading,
    node: Node,
    field_type: FieldType,
    names: Names,
    what: str,
    minimum: float | None = None,
) -> Value | None:
    """Return a value that fits a type; None when it does not, which is then reported.

    Args:
        reading: The file.
        node: What is written.
        field_type: What is expected.
        names: What ``${…}`` may name.
        what: The field, for messages.
        minimum: Smallest number that is possible.
    """
    if field_type is FieldType.ANY:
        return _read_any(reading, node, names, what)
    expected = _EXPECTED[field_type]
    if not isinstance(node, Scalar):
        reading.wrong_type(node, what, expected)
        return None
    parts = split(reading, node)
    if parts is None or not _known(reading, node, names):
        return None
    if field_type is FieldType.TEXT:
        return _text(reading, node, parts, names, what)
    if len(parts) == 1 and isinstance(parts[0], Reference):
        return _fitting(reading, node, parts[0], field_type, names, what)
    if any(isinstance(part, Reference) for part in parts):
        reading.error(
            "wrong-type",
            node,
            f"{what}: expected {expected}, found a text with a name in it",
            "write only the ${…}, without anything around it",
        )
        return None
    return _literal(reading, node, field_type, what, minimum)


def _literal(
    reading: FileReading, node: Scalar, field_type: FieldType, what: str, minimum: float | None
) -> Literal | None:
    value: bool | int | float | None
    match field_type:
        case FieldType.BOOLEAN:
            value = reading.boolean(node, what)
        case FieldType.INTEGER:
            value = reading.integer(node, what, int(minimum) if minimum is not None else None)
        case FieldType.DURATION:
            value = reading.duration(node, what)
        case _:
            value = reading.number(node, what, minimum)
    return None if value is None else Literal(value=value)


def _text(
    reading: FileReading,
    node: Scalar,
    parts: tuple[str | Reference, ...],
    names: Names,
    what: str,
) -> Value | None:
    if not any(isinstance(part, Reference) for part in parts):
        # An empty text can be meant, but then it is in quotes.
        text = reading.text(node, what, empty=not node.plain)
        return None if text is None else Literal(value="".join(str(part) for part in parts))
    match parts:
        case (Reference() as only,) if names.type_of(only.name) is FieldType.TEXT:
            return only
    return Text(parts=parts)


def _fitting(
    reading: FileReading,
    node: Scalar,
    reference: Reference,
    field_type: FieldType,
    names: Names,
    what: str,
) -> Value | None:
    given = names.type_of(reference.name)
    if given is FieldType.ANY or given in _FITTING[field_type]:
        return reference
    assert given is not None
    reading.error(
        "wrong-value",
        node,
        f"{what}: expected {_EXPECTED[field_type]}, but '{reference.name}' is {_EXPECTED[given]}",
        "use a name with a fitting value",
    )
    return None


def _read_any(reading: FileReading, node: Node, names: Names, what: str) -> Value | None:
    match node:
        case Sequence():
            items = [_read_any(reading, item, names, what) for item in node.items]
            return ListValue(items=tuple(item for item in items if item is not None))
        case Mapping():
            return read_map(reading, node, names, what)
        case Scalar():
            return _read_any_scalar(reading, node, names, what)


def _read_any_scalar(reading: FileReading, node: Scalar, names: Names, what: str) -> Value | None:
    if node.empty:
        reading.error("missing-value", node, f"{what}: nothing is written here", "write a value")
        return None
    parts = split(reading, node)
    if parts is None or not _known(reading, node, names):
        return None
    if len(parts) == 1 and isinstance(parts[0], Reference):
        return parts[0]
    if any(isinstance(part, Reference) for part in parts):
        return Text(parts=parts)
    if "${" in node.text:
        return Literal(value="".join(str(part) for part in parts))
    try:
        return Literal(value=plain_value(node))
    except quantities.QuantityError as error:
        reading.error("bad-number", node, f"{what}: {error.message}", error.hint or "quote a text")
        return None


def read_map(reading: FileReading, node: Node, names: Names, what: str) -> MapValue:
    """Return a mapping of values of any type; what is wrong in it is reported and left out."""
    values = {
        entry.key.text: _read_any(reading, entry.value, names, f"'{entry.key.text}'")
        for entry in reading.entries(node, what, "fields and values")
    }
    return MapValue(items={key: value for key, value in values.items() if value is not None})


def split(reading: FileReading, node: Scalar) -> tuple[str | Reference, ...] | None:
    """Return the parts of a text: plain text and names; None when a ``${…}`` is wrong.

    ``$${`` stands for the plain text ``${``.
    """
    if "${" not in node.text:
        return (node.text,)
    parts: list[str | Reference] = []
    plain = ""
    at = 0
    sound = True
    for match in _REFERENCE.finditer(node.text):
        plain += node.text[at : match.start()]
        at = match.end()
        if match[1] is None:
            plain += "${"
            continue
        name = match[1].strip()
        problem, hint = _reference_problem(name, closed=bool(match[2]))
        if problem:
            width = len(match[0])
            reading.error_in("bad-reference", node, match.start(), width, problem, hint)
            sound = False
            continue
        if plain:
            parts.append(plain)
            plain = ""
        parts.append(Reference(name=name))
    plain += node.text[at:]
    if plain:
        parts.append(plain)
    return tuple(parts) if sound else None


def _reference_problem(name: str, *, closed: bool) -> tuple[str, str]:
    if not closed:
        return "this '${' is not closed", "close it: ${name}; for the plain text ${ write $${"
    if not name:
        return "there is no name in ${ }", "write one: ${name}"
    if not _DOTTED.fullmatch(name):
        return f"{shown(name)} is not one name", "only a single name can stand in ${ }"
    return "", ""


def _known(reading: FileReading, node: Scalar, names: Names) -> bool:
    """Return whether all names of a text exist; report the others where they stand."""
    known = True
    for match in _REFERENCE.finditer(node.text):
        name = (match[1] or "").strip()
        problem = names.problem(name) if name else None
        if problem is not None:
            code, message, hint = problem
            offset = match.start(1) + len(match[1]) - len(match[1].lstrip())
            reading.error_in(code, node, offset, len(name), message, hint)
            known = False
    return known


def read_condition(reading: FileReading, node: Node, names: Names, what: str) -> Expression | None:
    """Return a condition; None when it is none, which is then reported."""
    if not isinstance(node, Scalar) or node.empty:
        reading.wrong_type(node, what, "a condition such as scene.age >= 4")
        return None
    try:
        expression = parse_expression(node.text, kind_of=names.kind_of)
    except ExpressionError as error:
        reading.error_in(
            "bad-expression", node, error.column - 1, 1, f"{what}: {error.message}", error.hint
        )
        return None
    sound = True
    for mention in expression.mentions:
        problem = names.problem(mention.name)
        if problem is not None:
            code, message, hint = problem
            reading.error_in(code, node, mention.column - 1, len(mention.name), message, hint)
            sound = False
    if sound and expression.kind not in (None, ValueKind.BOOLEAN):
        reading.error(
            "bad-expression",
            node,
            f"{what} is a {expression.kind.value}, expected something that is true or false",
            "compare it, for example with >=",
        )
        return None
    return expression if sound else None
