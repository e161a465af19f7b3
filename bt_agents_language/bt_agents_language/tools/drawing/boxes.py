# SPDX-License-Identifier: Apache-2.0
"""Boxes of a drawing: its view of each node of a tree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from bt_agents_core.diagnostic import Position
from bt_agents_core.text import excerpt
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import Literal, NodeSpec, Value
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.node_type import Children, Content, NodeField, Role, declared_field
from bt_agents_language.nodes.skill import SKILL
from bt_agents_language.tools.drawing.value_format import LONGEST_TEXT, format_value


class BoxKind(Enum):
    """Kind of box; kinds look different in a drawing."""

    COMPOSITE = "composite"
    DECORATOR = "decorator"
    LEAF = "leaf"
    SKILL = "skill"
    SUBTREE = "subtree"


@dataclass(frozen=True, kw_only=True)
class Box:
    """Box for one node in a drawing.

    Attributes:
        name: The author's name for it; empty if it has none.
        details: Its values and conditions, one each, including commas between them.
        role: Its role for its parent: ``on failure``; empty for an ordinary child.
    """

    kind: BoxKind
    word: str
    name: str
    details: tuple[str, ...]
    role: str
    position: Position
    children: tuple[Box, ...]


def box_of(spec: NodeSpec, longest_text: int = LONGEST_TEXT, role: str = "") -> Box:
    """Return the box of a node and of all nodes below it, with shortened texts."""
    return Box(
        kind=_kind(spec),
        word=type_of(spec).drawn_key(spec),
        name=excerpt(_name(spec), longest_text),
        details=_details(spec, longest_text),
        role=role,
        position=spec.position,
        children=tuple(
            box_of(child, longest_text, "on failure" if type_of(spec).handler and index else "")
            for index, child in enumerate(spec.children)
        ),
    )


def _kind(spec: NodeSpec) -> BoxKind:
    node_type = type_of(spec)
    if node_type.role in (Role.DECORATOR, Role.BRANCH):
        return BoxKind.DECORATOR
    if node_type is SKILL:
        return BoxKind.SKILL
    if node_type.children is Children.NONE:
        return BoxKind.LEAF
    return BoxKind.COMPOSITE if node_type.children is Children.LIST else BoxKind.SUBTREE


def _name(spec: NodeSpec) -> str:
    if type_of(spec).role in (Role.DECORATOR, Role.BRANCH):
        return ""
    made = spec.name == spec.kind or spec.name.startswith(f"{spec.kind} ")
    return "" if made else spec.name


def _details(spec: NodeSpec, longest_text: int) -> tuple[str, ...]:
    values = [*_interface(spec, longest_text), *_values(spec, longest_text)]
    details = [*(f"{value}," for value in values[:-1]), *values[-1:]]
    if type_of(spec).children is Children.ONE:
        first = [f"with {details[0]}", *details[1:]] if details else []
        details = [*filter(None, [_called(spec)]), *first]
    if spec.outputs or spec.feedback:
        details.append(f"→ {', '.join((*spec.outputs, *spec.feedback))}")
    return tuple(details)


def _called(spec: NodeSpec) -> str:
    """Return the name of the subtree that a node runs."""
    below = spec.children[0].path.removeprefix(f"{spec.path}/") if spec.children else ""
    return below.partition("/")[0].partition("@")[0]


def _interface(spec: NodeSpec, longest_text: int) -> list[str]:
    """Return the ROS interface that a node names itself, and the values that it sends."""
    if spec.skill is None or spec.skill.binding is None or type_of(spec) is SKILL:
        return []
    binding = spec.skill.binding
    written = format_value(binding.fields, longest_text=longest_text)
    fields = [written] if binding.fields.items else []
    return [f"{binding.name} ({binding.type})", *fields]


def _values(spec: NodeSpec, longest_text: int) -> list[str]:
    node_type = type_of(spec)
    fields = _fields(spec)
    main = spec.skill.main if spec.skill is not None else node_type.main
    shown = []
    for name, value in spec.fields.items():
        field = fields.get(name)
        constant = value.value if isinstance(value, Literal) else value
        by_place = node_type.skips and name == "otherwise"
        if by_place or (field is not None and constant == field.default):
            continue
        text = _chosen(spec, value, field) or _text(value, field, longest_text)
        if field is not None and field.drawn:
            shown.append(field.drawn)
        elif name == main:
            shown.insert(0, text)
        elif node_type.open:
            shown.append(f"{name} = {text}")
        else:
            shown.append(f"{name.replace('_', ' ')} {text}")
    return shown


def _chosen(spec: NodeSpec, value: Value | Expression, field: NodeField | None) -> str:
    """Return the names of the children that a field selects; empty if it selects none."""
    chosen = value.value if isinstance(value, Literal) else None
    if field is None or field.content is not Content.COUNT or not isinstance(chosen, tuple):
        return ""
    names = []
    for child in (spec.children[at] for at in chosen if isinstance(at, int)):
        while type_of(child).role is Role.DECORATOR:
            child = child.children[0]
        names.append(child.name)
    return f"[{', '.join(names)}]"


def _fields(spec: NodeSpec) -> Mapping[str, NodeField]:
    if spec.skill is not None and type_of(spec) is SKILL:
        return {one.name: declared_field(one) for one in spec.skill.inputs}
    return {field.name: field for field in type_of(spec).fields}


def _text(value: Value | Expression, field: NodeField | None, longest_text: int) -> str:
    if field is None:
        return format_value(value, longest_text=longest_text)
    is_word = field.words or field.content is not Content.VALUE
    if is_word and isinstance(value, Literal) and isinstance(value.value, str):
        return value.value
    return format_value(value, field.type, longest_text)
