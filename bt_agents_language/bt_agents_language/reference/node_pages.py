# SPDX-License-Identifier: Apache-2.0
"""Reference pages of the words of the tree language, for documents, editors and terminals."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from bt_agents_core.field_types import FieldType, Plain
from bt_agents_language.expression.units import DIMENSIONS
from bt_agents_language.fields.values import ONE_OF
from bt_agents_language.model.specs import SkillSpec, SubtreeSpec
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES, SIBLINGS
from bt_agents_language.nodes.node_type import (
    Children,
    Content,
    NodeField,
    NodeType,
    Role,
    declared_field,
)
from bt_agents_language.nodes.skill import takes_variants
from bt_agents_language.nodes.symbols import SymbolTable


class Group(Enum):
    """Kinds of words, in the order of the documentation; nodes have the kind of their role."""

    COMPOSITE = "composite"
    LEAF = "leaf"
    SKILL = "skill"
    PLUGIN = "node of a plug-in"
    DECORATOR = "decorator"
    SIBLING = "key beside a node"
    SUBTREE = "subtree of a library"


@dataclass(frozen=True, kw_only=True)
class FieldEntry:
    """Field of a word.

    Attributes:
        expected: Allowed values in words: ``time`` or ``whole number ≥ 1``.
        default: Value if left out, as it would be written; empty for none.
        main: Whether a scalar after the word sets it.
    """

    name: str
    expected: str
    required: bool
    default: str = ""
    main: bool = False
    sample: str = ""
    description: str = ""


@dataclass(frozen=True, kw_only=True)
class NodePage:
    """Page about one word.

    Attributes:
        forms: The ways of writing it, shortest first: ``wait: <time>``.
        outputs: Names that later nodes may use; only for skills and subtrees.
        note: Where it is allowed, or in which order it takes effect; may be empty.
        example: Part of an agent file, YAML.
    """

    key: str
    group: Group
    description: str
    forms: tuple[str, ...]
    fields: tuple[FieldEntry, ...] = ()
    outputs: tuple[FieldEntry, ...] = ()
    note: str = ""
    example: str


_TYPE_WORDS: Mapping[FieldType, str] = {
    FieldType.TEXT: "text",
    FieldType.NUMBER: "number",
    FieldType.INTEGER: "whole number",
    FieldType.BOOLEAN: "true or false",
    FieldType.ANY: "anything",
    **{quantity: dimension.name for quantity, dimension in DIMENSIONS.items()},
}
"""Names of types for authors."""

_CONTENT_WORDS = {
    Content.CONDITION: "condition",
    Content.ROS_NAME: "ROS name",
    Content.ROS_TYPE: "ROS type",
    Content.MAP: "fields and values",
    Content.OUTPUTS: "names and fields",
    Content.TIMEOUTS: "times",
    Content.HEARTBEAT: "topic, type and time",
    Content.ERROR_CODE: "fields and codes",
    Content.NODE: "node",
}


def node_page(key: str, symbols: SymbolTable) -> NodePage | None:
    """Return the page of a node, skill, decorator or other key next to a node.

    Returns:
        The page; None if there is no such word.
    """
    node_type = symbols.node_types.get(key)
    if node_type is not None:
        return _type_page(node_type)
    if key in symbols.skills:
        return _skill_page(symbols.skills[key])
    if key in DECORATORS:
        return _type_page(DECORATORS[key])
    if key in SIBLINGS:
        sibling = SIBLINGS[key]
        return NodePage(
            key=key,
            group=Group.SIBLING,
            description=sibling.field.description,
            forms=(f"{key}: …",),
            note=f"Stands beside {sibling.where}.",
            example=sibling.example,
        )
    return None


def node_pages(symbols: SymbolTable) -> tuple[NodePage, ...]:
    """Return the pages of all words, group by group."""
    keys = [*NODE_TYPES, *symbols.skills, *symbols.plugins, *DECORATORS, *SIBLINGS]
    pages = [page for key in keys if (page := node_page(key, symbols)) is not None]
    order = list(Group)
    return tuple(sorted(pages, key=lambda page: order.index(page.group)))


def subtree_page(library: str, subtree: SubtreeSpec) -> NodePage:
    """Return the page of a subtree in a library, which is a path in the trees folder."""
    fields = tuple(_entry(declared_field(one)) for one in subtree.inputs)
    outputs = tuple(_entry(declared_field(one)) for one in subtree.outputs)
    given = [field for field in fields if field.required] or fields[:1]
    head = f"subtree: {subtree.name}"
    call = f"{head}\n"
    if given:
        values = ", ".join(f"{field.name}: {field.default or field.sample}" for field in given)
        call += f"with: {{{values}}}\n"
    return NodePage(
        key=subtree.name,
        group=Group.SUBTREE,
        description=subtree.description,
        forms=(head, f"with: {_every_field(fields)}") if fields else (head,),
        fields=fields,
        outputs=outputs,
        note=f"Declared in {library}, which an agent imports.",
        example=f"imports: [{library}]\n{_tree(call, outputs)}",
    )


def _expected(field: NodeField) -> str:
    """Return the allowed values of a field: ``whole number ≥ 1 or forever``."""
    if field.content is Content.COUNT:
        return "all, one, whole number ≥ 1 or list of names"
    if field.content in _CONTENT_WORDS:
        return _CONTENT_WORDS[field.content]
    words = " or ".join(field.words)
    if field.content is Content.CONSTANT and words:
        return words
    least = f" ≥ {field.minimum:g}" if field.minimum is not None else ""
    return _TYPE_WORDS[field.type] + least + (f" or {words}" if words else "")


def _format_default(value: Plain, field_type: FieldType = FieldType.ANY) -> str:
    """Return a default as an author would write it; empty for none."""
    unit = f" {DIMENSIONS[field_type].si}" if field_type in DIMENSIONS else ""
    match value:
        case None:
            return ""
        case bool():
            return "true" if value else "false"
        case int() | float():
            return f"{value:g}{unit}"
        case str():
            return value if value else '""'
        case tuple():
            return f"[{', '.join(map(_format_default, value))}]"
    return f"{{{', '.join(f'{key}: {_format_default(item)}' for key, item in value.items())}}}"


def _type_page(node_type: NodeType) -> NodePage:
    fields = tuple(_entry(field, node_type.main) for field in node_type.fields)
    return NodePage(
        key=node_type.key,
        group=Group.PLUGIN if node_type.plugin is not None else Group[node_type.role.name],
        description=node_type.description,
        forms=_forms_of_type(node_type, fields),
        fields=fields,
        note=_nesting(node_type.key) if node_type.role is Role.DECORATOR else "",
        example=node_type.example or _made_example(node_type.key, fields, ()),
    )


def _forms_of_type(node_type: NodeType, fields: tuple[FieldEntry, ...]) -> tuple[str, ...]:
    key = node_type.key
    if node_type.children is Children.LIST:
        options = "".join(f"{field.name}: …, " for field in fields)
        return f"{key}: [node, …]", f"{key}: {{{options}children: [node, …]}}"
    if node_type.open:
        return (f"{key}: {{name: value, …}}",)
    if node_type.handler:
        return (f"{key}: <node>",)
    if node_type.role is Role.DECORATOR and not fields:
        return (f"{key}: true",)
    return _forms(key, fields)


def _nesting(decorator: str) -> str:
    """Return in words the decorators outside and inside a decorator."""
    keys = list(DECORATORS)
    at = keys.index(decorator)
    places = [("inside of", keys[:at]), ("around", keys[at + 1 :])]
    words = [f"{place} {', '.join(others)}" for place, others in places if others]
    return f"Whatever the order in the file, it acts {' and '.join(words)}."


def _skill_page(skill: SkillSpec) -> NodePage:
    fields = tuple(_entry(declared_field(one), skill.main) for one in skill.inputs)
    outputs = tuple(_entry(declared_field(one)) for one in skill.outputs)
    return NodePage(
        key=skill.name,
        group=Group.SKILL,
        description=skill.description,
        forms=(
            *_forms(skill.name, fields),
            *([f"{skill.name}: {{{ONE_OF}: [<text>, …]}}"] if takes_variants(skill) else []),
        ),
        fields=fields,
        outputs=outputs,
        note=skill.unoffered,
        example=_made_example(skill.name, fields, outputs),
    )


def _entry(field: NodeField, main: str | None = None) -> FieldEntry:
    return FieldEntry(
        name=field.name,
        expected=_expected(field),
        required=field.required,
        default=_format_default(field.default, field.type),
        main=field.name == main,
        sample=_sample(field),
        description=field.description,
    )


def _forms(key: str, fields: tuple[FieldEntry, ...]) -> tuple[str, ...]:
    """Return the scalar form if one field is enough, and the form with all fields."""
    forms = []
    needed = [field.name for field in fields if field.required]
    main = next((field for field in fields if field.main), None)
    if main is not None and needed in ([], [main.name]):
        forms.append(f"{key}: <{main.expected}>")
    elif not needed:
        forms.append(f"{key}:")
    if len(fields) > 1 or (fields and main is None):
        forms.append(f"{key}: {_every_field(fields)}")
    return tuple(forms)


def _every_field(fields: tuple[FieldEntry, ...]) -> str:
    return f"{{{', '.join(f'{field.name}: …' for field in fields)}}}"


_TEXTS: Mapping[str, str] = {
    "say": "Hello.",
    "ask": "Shall we go?",
    "show": "Follow me",
    "drive": "check-in desk",
    "light": "green",
    "sound": "chirp",
}
"""Text of a skill in its example, by the usual names of skills."""

_SAMPLES: Mapping[FieldType, str] = {
    FieldType.TEXT: '"…"',
    FieldType.NUMBER: "1.5",
    FieldType.INTEGER: "2",
    FieldType.BOOLEAN: "true",
    FieldType.DURATION: "5 s",
    FieldType.LENGTH: "1 m",
    FieldType.ANGLE: "90 deg",
    FieldType.ANY: "[a, b]",
}


def _made_example(
    key: str, fields: tuple[FieldEntry, ...], outputs: tuple[FieldEntry, ...]
) -> str:
    """Return an example made from the types of the fields."""
    needed = [field for field in fields if field.required]
    main = next((field for field in fields if field.main), None)
    if main is not None and needed in ([], [main]):
        is_text = main.sample == _SAMPLES[FieldType.TEXT]
        value = f" {_TEXTS.get(key, main.sample) if is_text else main.sample}"
    elif needed:
        value = f" {{{', '.join(f'{field.name}: {field.sample}' for field in needed)}}}"
    else:
        value = ""
    return _tree(f"{key}:{value}\n", outputs)


def _tree(node: str, outputs: tuple[FieldEntry, ...]) -> str:
    """Return a tree of one node, and a node that uses what the first gives."""
    if not outputs:
        return f"tree:\n{textwrap.indent(node, '  ')}"
    item = textwrap.indent(node, "      ").replace("      ", "    - ", 1)
    name = outputs[0].name
    return f'tree:\n  sequence:\n{item}    - log: "{name}: ${{{name}}}"\n'


def _sample(field: NodeField) -> str:
    if field.content is Content.CONDITION:
        return "live.person"
    if field.content is Content.CONSTANT and field.words:
        return field.words[0]
    return _CONTENT_WORDS.get(field.content) or _SAMPLES[field.type]
