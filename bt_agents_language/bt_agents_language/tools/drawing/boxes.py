# SPDX-License-Identifier: Apache-2.0
"""What a picture of a tree shows of each node: its kind, its words, its place in the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.node_type import Children, Content, NodeField
from bt_agents_language.model.specs import FieldType, Literal, NodeSpec, Position, Value
from bt_agents_language.nodes import KINDS, MODIFIERS
from bt_agents_language.tools.drawing.shown_values import LONGEST_TEXT, shortened, shown_value


class BoxKind(Enum):
    """Kinds of nodes that look different in a picture."""

    COMPOSITE = "composite"
    MODIFIER = "modifier"
    LEAF = "leaf"
    SKILL = "skill"
    SUBTREE = "subtree"


@dataclass(frozen=True, kw_only=True)
class Box:
    """One node of a picture.

    Attributes:
        kind: How it looks.
        word: Its key in the file.
        name: The author's name for it; empty when it has none.
        details: Its values and conditions, one each, with the commas between them.
        role: What it is to its parent: ``on failure``; empty for an ordinary child.
        path: Its path in the tree.
        position: Its place in the file.
        children: In order.
    """

    kind: BoxKind
    word: str
    name: str
    details: tuple[str, ...]
    role: str
    path: str
    position: Position
    children: tuple[Box, ...]


_MAIN = {"case": "condition", "weight": "weight"}
"""What wraps a child of a composite like a modifier without being one, and its main field."""

_HIDDEN = ("memory", "otherwise")
_SWITCHED = {"memory": "starts over at each tick"}


def box_of(spec: NodeSpec, longest_text: int = LONGEST_TEXT, role: str = "") -> Box:
    """Return what a picture shows of a node and of all below it.

    Args:
        spec: The node.
        longest_text: Characters of a name or text; the rest is left out.
        role: What the node is to its parent.
    """
    return Box(
        kind=_kind(spec),
        word=_word(spec),
        name=shortened(_name(spec), longest_text),
        details=_details(spec, longest_text),
        role=role,
        path=spec.path,
        position=spec.position,
        children=tuple(
            box_of(
                child,
                longest_text,
                "on failure" if spec.kind == "on_failure" and index else "",
            )
            for index, child in enumerate(spec.children)
        ),
    )


def _word(spec: NodeSpec) -> str:
    # The last child of 'choose' is the only one without a condition.
    return "otherwise" if spec.kind == "case" and not spec.fields else spec.kind


def _kind(spec: NodeSpec) -> BoxKind:
    if spec.kind in MODIFIERS or spec.kind in _MAIN:
        return BoxKind.MODIFIER
    kind = KINDS.get(spec.kind)
    if kind is None:
        return BoxKind.SKILL if spec.skill is not None else BoxKind.LEAF
    if kind.children is Children.NONE:
        return BoxKind.LEAF
    return BoxKind.SUBTREE if spec.kind == "subtree" else BoxKind.COMPOSITE


def _name(spec: NodeSpec) -> str:
    if spec.kind in MODIFIERS or spec.kind in _MAIN:
        return ""
    made = spec.name == spec.kind or spec.name.startswith(f"{spec.kind} ")
    return "" if made else spec.name


def _details(spec: NodeSpec, longest_text: int) -> tuple[str, ...]:
    values = [*_interface(spec, longest_text), *_values(spec, longest_text)]
    details = [*(f"{value}," for value in values[:-1]), *values[-1:]]
    if spec.kind == "subtree":
        first = [f"with {details[0]}", *details[1:]] if details else []
        details = [*filter(None, [_called(spec)]), *first]
    if spec.outputs or spec.feedback:
        details.append(f"→ {', '.join((*spec.outputs, *spec.feedback))}")
    return tuple(details)


def _called(spec: NodeSpec) -> str:
    """Return the name of the subtree that a node does."""
    below = spec.children[0].path.removeprefix(f"{spec.path}/") if spec.children else ""
    return below.partition("/")[0].partition("@")[0]


def _interface(spec: NodeSpec, longest_text: int) -> list[str]:
    """Return the ROS interface that a node names itself, and what it sends."""
    if spec.kind not in KINDS or spec.skill is None or spec.skill.binding is None:
        return []
    binding = spec.skill.binding
    written = shown_value(binding.fields, longest_text=longest_text)
    fields = [written] if binding.fields.items else []
    return [f"{binding.name} ({binding.type})", *fields]


def _values(spec: NodeSpec, longest_text: int) -> list[str]:
    fields = _fields(spec)
    main = _main(spec)
    shown = []
    for name, value in spec.fields.items():
        field = fields.get(name)
        if _is_default(name, value, field):
            continue
        text = _chosen(spec, value) or _text(value, field, longest_text)
        if name in _SWITCHED:
            shown.append(_SWITCHED[name])
        elif name == main:
            shown.insert(0, text)
        elif spec.kind == "set":
            shown.append(f"{name} = {text}")
        else:
            shown.append(f"{name.replace('_', ' ')} {text}")
    return shown


def _chosen(spec: NodeSpec, value: Value | Expression) -> str:
    """Return the names of the children that a parallel needs; empty when it names none."""
    chosen = value.value if isinstance(value, Literal) else None
    if spec.kind != "parallel" or not isinstance(chosen, tuple):
        return ""
    names = []
    for child in (spec.children[at] for at in chosen if isinstance(at, int)):
        while child.kind in MODIFIERS:
            child = child.children[0]
        names.append(child.name)
    return f"[{', '.join(names)}]"


def _main(spec: NodeSpec) -> str | None:
    if spec.skill is not None:
        return spec.skill.main
    if spec.kind in MODIFIERS:
        return MODIFIERS[spec.kind].main
    if spec.kind in KINDS:
        return KINDS[spec.kind].main
    return _MAIN.get(spec.kind)


@dataclass(frozen=True, kw_only=True)
class _Field:
    """What is known of a field: its type, its default, and whether texts in it are words."""

    type: FieldType
    default: object
    words: bool


def _fields(spec: NodeSpec) -> Mapping[str, _Field]:
    if spec.skill is not None and spec.kind not in KINDS:
        return {
            one.name: _Field(type=one.type, default=one.default, words=False)
            for one in spec.skill.inputs
        }
    table: tuple[NodeField, ...] = ()
    if spec.kind in MODIFIERS:
        table = MODIFIERS[spec.kind].fields
    elif spec.kind in KINDS:
        table = KINDS[spec.kind].fields
    return {
        one.name: _Field(
            type=one.type,
            default=one.default,
            words=bool(one.words) or one.content is not Content.VALUE,
        )
        for one in table
    }


def _is_default(name: str, value: Value | Expression, field: _Field | None) -> bool:
    if not isinstance(value, Literal):
        return False
    if field is None:
        return name in _HIDDEN
    return value.value == field.default


def _text(value: Value | Expression, field: _Field | None, longest_text: int) -> str:
    if field is None:
        return shown_value(value, longest_text=longest_text)
    if field.words and isinstance(value, Literal) and isinstance(value.value, str):
        return value.value
    return shown_value(value, field.type, longest_text)
