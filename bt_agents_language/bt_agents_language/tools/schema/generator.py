# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas generated from the field tables of files."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.field_types import FieldType
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.fields.scope import mood_names, scene_names
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.value_schemas import Schema, described, mapping
from bt_agents_language.yaml.field_tables import (
    Either,
    Entries,
    FieldDecl,
    FileKind,
    Form,
    Items,
    Key,
    KeyTable,
    Needs,
    SceneNameList,
    SceneValues,
    Several,
    Shared,
    Single,
    Value,
    WordChoice,
)
from bt_agents_language.yaml.typed_reader import FORMAT

DRAFT = "http://json-schema.org/draft-07/schema#"

_SINGLE: Mapping[Form, Schema] = {
    Form.ANY: {},
    Form.AMOUNT: {"type": ["number", "string"]},
    Form.ANGLE: value_schemas.quantity(FieldType.ANGLE),
    Form.BOOLEAN: value_schemas.BOOLEAN,
    Form.CONDITION: value_schemas.CONDITION,
    Form.DURATION: value_schemas.quantity(FieldType.DURATION),
    Form.LENGTH: value_schemas.quantity(FieldType.LENGTH),
    Form.NAME: value_schemas.NAME,
    Form.NODE: value_schemas.NODE,
    Form.NOTHING: {"type": "null"},
    Form.ROS_TYPE: value_schemas.ROS_TYPE,
    Form.TEXT: value_schemas.TEXT,
}


def file_schema(
    kind: FileKind, space: SceneSpace, definitions: Mapping[str, Schema] | None = None
) -> Schema:
    """Return the schema of a kind of file, with names of scene parameters as keys.

    Its definitions are the shared tables of the file and any others that it refers to.
    """
    generator = SchemaGenerator(space)
    version: Schema = {
        "description": "Version of the language.",
        "enum": [FORMAT, str(FORMAT)],
        "default": FORMAT,
        "errorMessage": f"this version reads format: {FORMAT}",
    }
    properties = {"format": version, **generator.properties(kind.fields)}
    shared = {name: generator.table(table) for name, table in kind.shared.items()}
    every = {**shared, **(definitions or {})}
    return {
        "$schema": DRAFT,
        "title": kind.title,
        "description": kind.description,
        **mapping(properties, ["format", *kind.required]),
        **({"definitions": every} if every else {}),
    }


def table_schema(table: KeyTable) -> Schema:
    """Return the schema of a mapping that does not depend on the scene parameters."""
    return SchemaGenerator(SceneSpace(parameters=(), mood=None)).table(table)


class SchemaGenerator:
    """Generator of schemas of values from their declarations."""

    def __init__(self, space: SceneSpace) -> None:
        self._space = space

    def table(self, table: KeyTable) -> Schema:
        """Return the schema of a mapping with the keys of a table."""
        properties = self.properties(table.fields)
        if table.scene:
            properties = {**_parameters(self._space), **properties}
        filled: Schema = {"minProperties": 1} if table.filled else {}
        needs = _needs(table.needs) if table.needs is not None else {}
        return {**mapping(properties, list(table.required)), **filled, **needs}

    def properties(self, fields: tuple[FieldDecl, ...]) -> dict[str, Schema]:
        """Return the schema of each field by name."""
        return {one.name: self._field(one) for one in fields}

    def _field(self, declared: FieldDecl) -> Schema:
        schema = self.value(declared.value)
        text = declared.description
        if isinstance(declared.value, Single) and declared.value.scene_names:
            text += f" Names: {', '.join(self._condition_names())}."
        if declared.default is not None:
            schema = {**schema, "default": declared.default}
        return described(schema, text)

    def _condition_names(self) -> list[str]:
        known = [*scene_names(self._space), *mood_names(self._space)]
        # Names of parameters come first, because conditions mostly use them.
        return sorted(known, key=lambda name: name.rpartition(".")[2] not in self._space.names)

    def value(self, declared: Value) -> Schema:
        """Return the schema of the values of a key."""
        match declared:
            case Single():
                return self._single(declared)
            case WordChoice():
                return {"enum": list(declared.words)}
            case Items():
                schema = _array(self.value(declared.item))
                schema |= {"minItems": 1} if declared.filled or declared.empty else {}
                return schema | ({"uniqueItems": True} if declared.unique else {})
            case Several():
                one = self.value(declared.one)
                other = [] if declared.other is None else [self.value(declared.other)]
                return {"anyOf": [one, _array(one), *other]}
            case Either():
                return {"anyOf": [self.value(one) for one in declared.options]}
            case Entries():
                return self._entries(declared)
            case SceneValues():
                return self._scene_values(declared)
            case SceneNameList():
                names: Schema = {"enum": list(self._space.profiles.names)}
                return {"anyOf": [{"const": declared.every}, _array(names)]}
            case Shared():
                return {"$ref": f"#/definitions/{declared.name}"}
            case KeyTable():
                return self.table(declared)

    def _single(self, declared: Single) -> Schema:
        limits = (declared.minimum, declared.maximum)
        match declared.form:
            case Form.NUMBER:
                return value_schemas.number(*limits)
            case Form.INTEGER:
                return value_schemas.integer(*limits)
            case Form.ROS_NAME:
                return value_schemas.ros_name(placeholders=declared.placeholders)
        return _SINGLE[declared.form]

    def _entries(self, declared: Entries) -> Schema:
        value = self.value(declared.value)
        schema: Schema = {"type": "object"} | ({"additionalProperties": value} if value else {})
        match declared.keys:
            case Key.NEW_NAME:
                schema = value_schemas.names(value)
            case Key.NUMBER:
                schema = value_schemas.names(value, str(value_schemas.number()["pattern"]))
            case Key.TOPIC:
                schema |= {"propertyNames": {"pattern": value_schemas.ros_name()["pattern"]}}
        if declared.filled or declared.empty or declared.single:
            schema |= {"minProperties": 1}
        return schema | ({"maxProperties": 1} if declared.single else {})

    def _scene_values(self, declared: SceneValues) -> Schema:
        space = self._space.profiles if declared.of_profiles else self._space
        if declared.limits is not None:
            limits = {one.name: declared.limits(one) for one in space.parameters}
            return mapping({name: value_schemas.number(*of) for name, of in limits.items()}, [])
        properties = _parameters(space)
        if declared.person and "person" not in properties:
            properties["person"] = described(value_schemas.BOOLEAN, declared.person)
        schema = mapping(properties, list(space.names) if declared.every else [])
        return schema | ({"minProperties": 1} if declared.filled else {})


def _parameters(space: SceneSpace) -> dict[str, Schema]:
    return {one.name: _parameter(one) for one in space.parameters}


def _parameter(parameter: SceneParameter) -> Schema:
    labels = ", ".join(f"{value:g} {word}" for value, word in parameter.labels.items())
    bounds = f"{parameter.minimum:g} to {parameter.maximum:g}"
    text = f"{parameter.description or parameter.name} ({bounds})"
    schema = value_schemas.number(parameter.minimum, parameter.maximum)
    return {
        **described(schema, f"{text}: {labels}" if labels else text),
        "defaultSnippets": [{"label": parameter.name, "body": f"${{1:{parameter.default:g}}}"}],
    }


def _array(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _needs(needs: Needs) -> Schema:
    schema: Schema = {"required": list(needs.keys)} if needs.keys else {}
    if needs.hint:
        schema["errorMessage"] = needs.hint
    if needs.options:
        key = "oneOf" if needs.exclusive else "anyOf"
        schema[key] = [_needs(one) for one in needs.options]
    return schema
