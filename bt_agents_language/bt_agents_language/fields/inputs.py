# SPDX-License-Identifier: Apache-2.0
"""Declared inputs of skills and subtrees: name, type and default."""

from __future__ import annotations

from dataclasses import replace

from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.fields.scope import RESERVED, NameScope
from bt_agents_language.fields.values import plain, read_value
from bt_agents_language.model.specs import FieldSpec
from bt_agents_language.yaml.field_tables import ANY, TEXT, Either, FieldDecl, KeyTable, WordChoice
from bt_agents_language.yaml.typed_reader import TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Mapping, MappingEntry, Node, Scalar

TYPES = tuple(one.value for one in FieldType)
"""Words for types in a file."""

_TYPE = FieldDecl("type", WordChoice(TYPES), "Type.", required=True)
_DESCRIPTION = FieldDecl("description", TEXT, "What it means.")
_INPUT = KeyTable(fields=(_TYPE, FieldDecl("default", ANY, "Value if left out."), _DESCRIPTION))
INPUT = Either((_TYPE.value, _INPUT))
"""Input of a skill or subtree: its type alone, or a mapping."""

OUTPUT = Either((_TYPE.value, KeyTable(fields=(replace(_TYPE, required=False), _DESCRIPTION))))
"""Output of a subtree."""


_OTHER_WORDS = {
    "string": "text", "str": "text", "int": "integer", "float": "number", "double": "number",
    "bool": "boolean", "time": "duration", "seconds": "duration", "list": "any", "object": "any",
    "ms": "duration", "s": "duration", "min": "duration", "minutes": "duration",
    "m": "length", "cm": "length", "metres": "length", "meters": "length",
    "deg": "angle", "degrees": "angle", "rad": "angle", "radians": "angle",
}  # fmt: skip


def read_inputs(
    reading: TypedReader, node: Node, what: str, kind: str = "input"
) -> tuple[FieldSpec, ...]:
    """Return declared inputs or outputs; report wrong ones, but keep them if possible."""
    entries = reading.entries(node, f"the {kind}s of {what}", "names and types")
    return readable(_read_input(reading, entry, kind) for entry in entries)


def _read_input(reading: TypedReader, entry: MappingEntry, kind: str) -> FieldSpec | None:
    name = read_new_name(reading, entry.key, f"an {kind}")
    if name is None:
        return None
    if not isinstance(entry.value, Mapping):
        return FieldSpec(name=name, type=read_type(reading, entry.value) or FieldType.ANY)
    fields = reading.keys(entry.value, _INPUT, f"{kind} '{name}'")
    if fields is None:
        return FieldSpec(name=name, type=FieldType.ANY)
    field_type = fields.read("type", lambda one, _: read_type(reading, one)) or FieldType.ANY
    what = f"the default of '{name}'"
    default = fields.get("default")
    return FieldSpec(
        name=name,
        type=field_type,
        required=default is None,
        default=None if default is None else read_constant(reading, default, field_type, what),
        description=fields.text("description"),
    )


def read_type(reading: TypedReader, node: Node) -> FieldType | None:
    """Return a type."""
    text = reading.text(node, "the type")
    if text is None:
        return None
    if text in TYPES:
        return FieldType(text)
    meant = _OTHER_WORDS.get(text.lower())
    hint = f"write {meant}" if meant else did_you_mean(text, TYPES)
    reading.error(
        "bad-choice", node, f"there is no type {quote(text)}, expected {', '.join(TYPES)}", hint
    )
    return None


def read_new_name(reading: TypedReader, key: Scalar, what: str) -> str | None:
    """Return a name that a file introduces; refuse reserved words."""
    name = reading.name(key, f"the name of {what}")
    if name is not None and name in RESERVED:
        reading.error(
            "name-taken",
            key,
            f"'{name}' has a meaning of its own",
            f"choose another name for {what}",
        )
        return None
    return name


def read_constant(reading: TypedReader, node: Node, field_type: FieldType, what: str) -> Plain:
    """Return a value without names, or report that it is wrong and return None."""
    if isinstance(node, Scalar) and "${" in node.text:
        reading.error(
            "bad-reference",
            node,
            f"{what} is the same in every run, so no ${{…}} can stand in it",
            "write a plain value",
        )
        return None
    value = read_value(reading, node, field_type, NameScope({}), what)
    return None if value is None else plain(value)
