# SPDX-License-Identifier: Apache-2.0
"""Values with ``${…}`` and conditions, checked against the names in scope."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType, Plain
from bt_agents_language.expression import quantities
from bt_agents_language.expression.expression_values import ValueKind
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.expression.units import DIMENSIONS
from bt_agents_language.fields.references import (
    read_expression,
    read_parts,
    text_of,
    unmarked_expression,
    warn_of_comment,
)
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import (
    Computed,
    ListValue,
    Literal,
    MapValue,
    Reference,
    Text,
    Value,
    Variants,
)
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.typed_reader import Shape, TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence

_NUMBERS = (FieldType.NUMBER, FieldType.INTEGER)
_FITTING = {
    FieldType.NUMBER: (*_NUMBERS, *DIMENSIONS),
    FieldType.INTEGER: (FieldType.INTEGER,),
    FieldType.BOOLEAN: (FieldType.BOOLEAN,),
    **{quantity: (*_NUMBERS, quantity) for quantity in DIMENSIONS},
}
"""Type of a place → allowed types of names there; texts and any accept every name."""

ONE_OF = "one_of"
"""Key in place of a skill's main text, for several texts; the skill takes one."""

EXPECTED = {
    FieldType.TEXT: "a text",
    FieldType.NUMBER: "a number",
    FieldType.INTEGER: "a whole number",
    FieldType.BOOLEAN: "true or false",
    FieldType.ANY: "a value",
    **{quantity: dimension.wanted for quantity, dimension in DIMENSIONS.items()},
}
"""Type of a place → the expected value in words."""


def may_be(given: FieldType, wanted: FieldType) -> bool:
    """Return whether a value of one type may, as far as known, also be one of another type."""
    known = FieldType.ANY not in (given, wanted)
    return not known or given is wanted or given in _FITTING.get(wanted, ())


def may_be_sent(given: FieldType, wanted: FieldType) -> bool:
    """Return whether a message field of one type may take a value of another: any number fits."""
    return FieldType.ANY in (given, wanted) or all(
        (given is one) is (wanted is one) for one in (FieldType.TEXT, FieldType.BOOLEAN)
    )


def type_of(value: Value) -> FieldType:
    """Return the type of a value with names in it, as far as known."""
    if isinstance(value, Text):
        return FieldType.TEXT
    return value.type if isinstance(value, Reference) else FieldType.ANY


def read_value(
    reading: TypedReader,
    node: Node,
    field_type: FieldType,
    names: NameScope,
    what: str,
    minimum: float | None = None,
    *,
    variants: bool = False,
) -> Value | None:
    """Return a value that fits a type, or report that it does not and return None.

    If ``variants`` are possible, a text may insert one of several texts.
    """
    several = isinstance(node, Mapping) and [one.key.text for one in node.entries] == [ONE_OF]
    if several and field_type in (FieldType.TEXT, FieldType.ANY):
        reading.error(
            "wrong-type",
            node,
            f"{what}: only the main text of a skill can be one of several",
            f"write '{ONE_OF}' after the skill that says it, or 'random' with a node for each, "
            "such as '- set: {…}'",
        )
        return None
    if field_type is FieldType.ANY:
        return _read_any(reading, node, names, what)
    if not isinstance(node, Scalar):
        shape = Shape.TEXT if field_type is FieldType.TEXT else Shape.VALUE
        if shape is Shape.TEXT and isinstance(node, Sequence):
            reading.error(
                "wrong-type",
                node,
                f"{what}: expected a text, found a list",
                "for one of several write {one_of: […]} after the skill; for one after the other "
                "use 'sequence' with a node for each",
            )
        else:
            reading.wrong_type(node, what, EXPECTED[field_type], shape)
        return None
    if "${" not in node.text:
        if field_type is FieldType.TEXT:
            # An empty text can be intended, but then it is in quotes.
            text = reading.text(node, what, empty=not node.plain)
            warn_of_comment(reading, node)
            return None if text is None else Literal(value=text)
        return _literal(reading, node, field_type, what, minimum)
    parts = read_parts(reading, node, names, variants=variants)
    if parts is None:
        return None
    if field_type is FieldType.TEXT:
        match parts:
            case (Variants() as only,):
                return only
        return text_of(parts)
    if len(parts) == 1 and isinstance(parts[0], Reference | Computed):
        return _fitting(reading, node, parts[0], field_type, what)
    if any(not isinstance(part, str) for part in parts):
        reading.error(
            "wrong-type",
            node,
            f"{what}: expected {EXPECTED[field_type]}, found a text with a name in it",
            "write only the ${…}, without anything around it",
        )
        return None
    return _literal(reading, node, field_type, what, minimum)


def read_variants(
    reading: TypedReader, node: Node, names: NameScope, what: str
) -> Variants | None:
    """Return several texts, or report a wrong one and return None."""
    if not isinstance(node, Sequence):
        reading.wrong_type(node, what, "a list of texts", Shape.LIST)
        return None
    if len(node.items) < 2:
        reading.error(
            "missing-value",
            node,
            f"{what} needs two texts or more, found {len(node.items)}",
            "add another one, or write the text without 'one_of'",
        )
    read = [read_value(reading, one, FieldType.TEXT, names, what) for one in node.items]
    texts = tuple(one for one in read if isinstance(one, Literal | Reference | Text))
    return Variants(texts=texts) if len(texts) == len(node.items) > 1 else None


def _literal(
    reading: TypedReader, node: Scalar, field_type: FieldType, what: str, minimum: float | None
) -> Literal | None:
    value = (
        reading.boolean(node, what)
        if field_type is FieldType.BOOLEAN
        else reading.amount(node, what, field_type, minimum)
    )
    return None if value is None else Literal(value=value, type=field_type)


def _fitting(
    reading: TypedReader,
    node: Scalar,
    part: Reference | Computed,
    field_type: FieldType,
    what: str,
) -> Value | None:
    if isinstance(part, Reference):
        fits = may_be(part.type, field_type)
        found = f"'{part.name}' is {EXPECTED[part.type]}"
    else:
        kind, unit = part.expression.kind, part.expression.unit
        wanted = ValueKind.BOOLEAN if field_type is FieldType.BOOLEAN else ValueKind.NUMBER
        fits = kind is None or kind is wanted
        if unit is not None and field_type is not FieldType.NUMBER:
            fits = DIMENSIONS.get(field_type) is unit
        given = unit.a if unit is not None else kind.one if kind is not None else "anything"
        found = f"'{part.expression.text}' gives {given}"
    if fits:
        return part
    text = isinstance(part, Reference) and part.type is FieldType.TEXT
    reading.error(
        "wrong-value",
        node,
        f"{what}: expected {EXPECTED[field_type]}, but {found}",
        f"for the number in it write ${{number({part.name})}}"
        if isinstance(part, Reference) and text and field_type is FieldType.NUMBER
        else "use a name with a fitting value",
    )
    return None


def _read_any(reading: TypedReader, node: Node, names: NameScope, what: str) -> Value | None:
    match node:
        case Sequence():
            items = [_read_any(reading, item, names, what) for item in node.items]
            return ListValue(items=tuple(item for item in items if item is not None))
        case Mapping():
            return read_map(reading, node, names, what)
        case Scalar():
            return _read_any_scalar(reading, node, names, what)


def _read_any_scalar(
    reading: TypedReader, node: Scalar, names: NameScope, what: str
) -> Value | None:
    if node.empty:
        reading.error("missing-value", node, f"{what}: nothing is written here", "write a value")
        return None
    parts = read_parts(reading, node, names)
    if parts is None:
        return None
    if len(parts) == 1 and not isinstance(parts[0], str):
        return parts[0]
    if any(not isinstance(part, str) for part in parts):
        return Text(parts=parts)
    if "${" in node.text:
        return Literal(value="".join(map(str, parts)))
    unmarked = unmarked_expression(node, names) if node.plain else None
    if unmarked is not None:
        reading.warning("unmarked-name", node, *unmarked)
    try:
        return Literal(value=plain_value(node))
    except quantities.QuantityError as error:
        reading.error("bad-number", node, f"{what}: {error.message}", error.hint or "quote a text")
        return None


def read_map(reading: TypedReader, node: Node, names: NameScope, what: str) -> MapValue:
    """Return a mapping of values of any type; report and omit wrong ones."""
    values = {
        entry.key.text: _read_any(reading, entry.value, names, f"'{entry.key.text}'")
        for entry in reading.entries(node, what, "fields and values")
    }
    return MapValue(items={key: value for key, value in values.items() if value is not None})


def read_condition(
    reading: TypedReader, node: Node, names: NameScope, what: str
) -> Expression | None:
    """Return a condition, or report that it is invalid and return None."""
    if not isinstance(node, Scalar) or node.empty:
        reading.wrong_type(node, what, "a condition such as scene.age >= 4", Shape.CONDITION)
        return None
    expression = read_expression(reading, node, node.text, 0, what, names)
    if expression is not None and expression.kind not in (None, ValueKind.BOOLEAN):
        reading.error(
            "bad-expression",
            node,
            f"{what} is a {expression.kind.value}, expected something that is true or false",
            _comparison_hint(expression),
        )
        return None
    return expression


def _comparison_hint(expression: Expression) -> str:
    if expression.kind is ValueKind.TEXT:
        known = f"known({expression.text}), or " if expression.text in expression.names else ""
        return f"write {known}{expression.text} == 'a text'"
    return "compare it, for example with >="


def is_plain(value: Value) -> bool:
    """Return whether a value contains no names."""
    match value:
        case ListValue():
            return all(is_plain(item) for item in value.items)
        case MapValue():
            return all(is_plain(item) for item in value.items.values())
    return isinstance(value, Literal)


def plain(value: Value) -> Plain:
    """Return a value without names as plain data; names in it become None."""
    match value:
        case Literal():
            return value.value
        case ListValue():
            return tuple(plain(item) for item in value.items)
        case MapValue():
            return {key: plain(item) for key, item in value.items.items()}
    return None
