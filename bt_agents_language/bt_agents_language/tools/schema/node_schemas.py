# SPDX-License-Identifier: Apache-2.0
"""JSON Schema of a node with all node types, skills and decorators."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.field_types import FieldType
from bt_agents_core.scene import SceneSpace
from bt_agents_language.fields.bindings import ERROR_CODE, HEARTBEAT, TIMEOUTS
from bt_agents_language.fields.values import EXPECTED, ONE_OF
from bt_agents_language.model.specs import SkillSpec
from bt_agents_language.nodes.catalogue import DECORATORS, SIBLINGS
from bt_agents_language.nodes.node_type import Children, Content, NodeField, NodeType, Role
from bt_agents_language.nodes.skill import SKILL, takes_variants
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.reference.node_pages import NodePage, node_page
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.generator import table_schema
from bt_agents_language.tools.schema.value_schemas import NODE, Schema, described, mapping

_CONTENT: Mapping[Content, Schema] = {
    Content.CONDITION: value_schemas.CONDITION,
    Content.ROS_NAME: value_schemas.ros_name(),
    Content.ROS_TYPE: value_schemas.ROS_TYPE,
    Content.MAP: {"type": "object"},
    Content.OUTPUTS: value_schemas.names(value_schemas.TEXT),
    Content.HEARTBEAT: table_schema(HEARTBEAT),
    Content.ERROR_CODE: table_schema(ERROR_CODE),
    Content.NODE: NODE,
}


def node_definitions(symbols: SymbolTable) -> Mapping[str, Schema]:
    """Return the definitions that a schema with trees needs.

    A node is one mapping with all of its possible keys, not one alternative per kind: so editors
    offer all keys at once, and report a mistake in a field there, not as a node that fits no
    alternative.
    """
    nodes = {
        **{key: _type(one, symbols.space) for key, one in symbols.node_types.items()},
        **{key: _skill(skill) for key, skill in symbols.skills.items()},
    }
    others = {
        **{key: _type(one, symbols.space) for key, one in DECORATORS.items()},
        **{key: _content(one.field) for key, one in SIBLINGS.items()},
    }
    properties: dict[str, object] = {}
    for key, schema in {**nodes, **others}.items():
        page = node_page(key, symbols)
        assert page is not None
        properties[key] = _documented(page, schema)
    required = [{"required": [key]} for key in nodes]
    return {
        "node": {
            "title": "node",
            "type": "object",
            "description": "A node: exactly one node or skill, and decorators beside it.",
            "properties": properties,
            "additionalProperties": False,
            "minProperties": 1,
            "dependencies": {
                "with": _having("with", symbols),
                "outputs": _one_of(
                    _having("outputs", symbols), "'outputs' stands beside a subtree or a skill"
                ),
            },
            "allOf": [
                {
                    "if": {"propertyNames": {"enum": list(others)}, "minProperties": 1},
                    "then": _refused("a decorator alone: there is no node beside it"),
                },
                {
                    "if": {"allOf": [{"anyOf": required}, {"not": {"oneOf": required}}]},
                    "then": _refused(
                        "two nodes in one item: indent the block, or start a new '-' item"
                    ),
                },
            ],
        }
    }


def _having(sibling: str, symbols: SymbolTable) -> list[str]:
    """Return the keys that allow a sibling key."""
    types = [one.key for one in symbols.node_types.values() if sibling in one.siblings]
    return [*types, *(symbols.skills if sibling in SKILL.siblings else ())]


def _refused(message: str) -> Schema:
    """Return a schema that refuses every mapping with a message."""
    return {"required": ["exactly one node"], "errorMessage": message}


def _one_of(keys: list[str], message: str) -> Schema:
    return {"anyOf": [{"required": [key], "errorMessage": message} for key in keys]}


def _documented(page: NodePage, schema: Schema) -> Schema:
    """Return the schema of a key with its page for hovering.

    The schema is in ``allOf``: otherwise an editor that completes the key would insert all of its
    fields. The type next to it tells the editor what to begin: a list, a mapping or a text.
    """
    documented: Schema = {
        "title": page.key,
        "description": page.description,
        "markdownDescription": _markdown(page),
    }
    needed = [field.name for field in page.fields if field.required]
    if schema.get("type") == "object" and needed:
        documented["defaultSnippets"] = [_snippet(needed)]
    return {**documented, "type": schema.get("type", ["string", "object"]), "allOf": [schema]}


def _markdown(page: NodePage) -> str:
    parts = [page.description, " · ".join(f"`{form}`" for form in page.forms)]
    lines = []
    for field in page.fields:
        default = f", {field.default} if left out" if field.default else ""
        needed = "" if field.required else ", may be left out" if not default else ""
        text = f": {field.description}" if field.description else ""
        lines.append(f"- `{field.name}` ({field.expected}{default}{needed}){text}")
    lines += [f"- gives `{one.name}` ({one.expected}): {one.description}" for one in page.outputs]
    parts += ["\n".join(lines), page.note, f"```yaml\n{page.example}```"]
    return "\n\n".join(filter(None, parts))


def _snippet(names: list[str]) -> Schema:
    """Return a snippet that inserts fields."""
    body = {name: f"${at}" for at, name in enumerate(names, start=1)}
    return {"label": ", ".join(names), "body": body}


def _type(node_type: NodeType, space: SceneSpace) -> Schema:
    if node_type.handler:
        return {"type": "object", "allOf": [NODE]}
    if node_type.role is Role.DECORATOR and not node_type.fields:
        return value_schemas.BOOLEAN
    scene = {one: value_schemas.value(FieldType.NUMBER) for one in space.profiles.names}
    properties = {}
    for field in node_type.fields:
        # Only goals, requests and messages of ROS have fields outside the tables.
        of_scene = field.content is Content.MAP and node_type.interface is None
        schema = mapping(scene, []) if of_scene else _content(field)
        properties[field.name] = described(schema, field.description)
    required = [field.name for field in node_type.fields if field.required]
    if node_type.open:
        declared = {
            name: described(value_schemas.value(kind), f"{EXPECTED[kind]}, as scene.yaml declares")
            for name, kind in node_type.declared(space).items()
        }
        others = value_schemas.value(FieldType.ANY) if node_type.assigns else False
        return {**mapping(declared, []), "minProperties": 1, "additionalProperties": others}
    if node_type.children is Children.LIST:
        child = NODE
        if node_type.child_keys:
            child = {"allOf": [NODE, {"required": list(node_type.child_keys)}]}
        children: Schema = {"type": "array", "minItems": 1, "items": child}
        return {
            **children,
            "title": node_type.key,
            "type": ["array", "object"],
            "errorMessage": "expected a list of nodes, each starting with '- '; with options, "
            "the list goes under 'children:'",
            "properties": {
                **properties,
                "children": described(children, f"Children of '{node_type.key}'."),
            },
            "required": ["children", *required],
            "additionalProperties": False,
        }
    main = next((field for field in node_type.fields if field.name == node_type.main), None)
    written = None if main is None else (main.name, _content(main))
    return _leaf(node_type.key, properties, required, written, empty=node_type.plugin is not None)


def _skill(skill: SkillSpec) -> Schema:
    values = {one.name: value_schemas.value(one.type) for one in skill.inputs}
    properties = {}
    for one in skill.inputs:
        known = not one.required and one.default is not None
        default: Schema = {"default": one.default} if known else {}
        properties[one.name] = described({**values[one.name], **default}, one.description)
    required = [one.name for one in skill.inputs if one.required]
    main = None if skill.main is None else (skill.main, values[skill.main])
    variants = takes_variants(skill)
    if variants:
        properties[ONE_OF] = described(
            {"type": "array", "minItems": 2, "items": value_schemas.TEXT},
            f"Several texts instead of '{skill.main}'; a different one each time.",
        )
    schema = _leaf(skill.name, properties, required, main, empty=True)
    if variants and skill.main in required:
        others = [name for name in required if name != skill.main]
        either = _one_of([skill.main, ONE_OF], f"'{skill.name}' needs '{skill.main}'")
        schema = {**schema, "required": others, **either}
    return schema


def _leaf(
    key: str,
    properties: dict[str, Schema],
    required: list[str],
    main: tuple[str, Schema] | None,
    *,
    empty: bool = False,
) -> Schema:
    """Return the schema of fields in a mapping, or of the main one as a scalar.

    If possible, one schema covers both, which gives one clear message per mistake. ``empty``
    allows an empty value if no field is required.
    """
    types: list[object] = ["object", *(["null"] if empty and not required else [])]
    fields: Schema = {**mapping(properties, required), "type": types if types[1:] else "object"}
    if main is None or [name for name in required if name != main[0]]:
        return fields
    scalar = main[1]
    if "enum" in scalar:
        return {"type": ["string", *types], "anyOf": [scalar, fields]}
    written = scalar["type"]
    scalars = written if isinstance(written, list) else [written]
    snippets = scalar.get("defaultSnippets", [])
    assert isinstance(snippets, list)
    if len(properties) > 1:
        snippets = [*snippets, _snippet(list(properties))]
    return {
        **scalar,
        **fields,
        "title": key,
        "type": list(dict.fromkeys([*scalars, *types])),
        **({"defaultSnippets": snippets} if snippets else {}),
    }


def _content(field: NodeField) -> Schema:
    match field.content:
        case Content.VALUE:
            return value_schemas.value(field.type, field.minimum, field.words)
        case Content.TIMEOUTS:
            return table_schema(TIMEOUTS.only(field.words))
        case Content.COUNT:
            words: Schema = {"enum": list(field.words)}
            names: Schema = {"type": "array", "items": value_schemas.TEXT}
            return {"anyOf": [words, value_schemas.integer(1), names]}
        case Content.CONSTANT:
            return {"enum": list(field.words)} if field.words else _constant(field)
    return _CONTENT[field.content]


def _constant(field: NodeField) -> Schema:
    match field.type:
        case FieldType.BOOLEAN:
            return value_schemas.BOOLEAN
        case FieldType.INTEGER:
            return value_schemas.integer(None if field.minimum is None else int(field.minimum))
        case FieldType.DURATION:
            return value_schemas.quantity(field.type)
        case FieldType.NUMBER:
            return value_schemas.number(field.minimum)
    return value_schemas.TEXT
