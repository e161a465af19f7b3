# SPDX-License-Identifier: Apache-2.0
"""The table of the language: every kind of node and modifier with its fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from bt_agents.language.specs import FieldType, Plain


class Content(Enum):
    """What may stand in a field of a node."""

    VALUE = "a value, which may hold ${…}"
    CONDITION = "a condition over names"
    CONSTANT = "a value without ${…}"
    ROS_NAME = "the name of a topic, service or action"
    ROS_TYPE = "the name of a ROS type"


class Children(Enum):
    """How many children a kind of node has."""

    NONE = "none"
    LIST = "list"
    ONE = "one"


@dataclass(frozen=True, kw_only=True)
class NodeField:
    """One field of a kind of node.

    Attributes:
        content: What may stand there.
        type: Type of a value or constant.
        required: Whether it must be written.
        default: Taken when it is not written; None leaves the field out.
        words: The possible texts of a constant; empty allows all.
        minimum: Smallest possible number.
        message: Name under which a condition sees a message, for example ``msg``.
    """

    name: str
    content: Content = Content.VALUE
    type: FieldType = FieldType.ANY
    required: bool = True
    default: Plain = None
    words: tuple[str, ...] = ()
    minimum: float | None = None
    message: str = ""
    description: str = ""


@dataclass(frozen=True, kw_only=True)
class NodeKind:
    """One kind of node.

    Attributes:
        key: The word in a file.
        main: Field that a scalar stands for; None when there is none.
        fields: In the order of the documentation.
        children: How many children it has.
        description: One sentence.
    """

    key: str
    main: str | None = None
    fields: tuple[NodeField, ...] = ()
    children: Children = Children.NONE
    description: str = ""


@dataclass(frozen=True, kw_only=True)
class ModifierKind:
    """One modifier: a key beside a node that wraps the node.

    Attributes:
        key: The word in a file.
        field: What is written behind it; None for a node or a switch.
        description: One sentence.
    """

    key: str
    field: NodeField | None = None
    description: str = ""


_MEMORY = NodeField(
    name="memory",
    content=Content.CONSTANT,
    type=FieldType.BOOLEAN,
    required=False,
    default=True,
    description="whether it goes on at the running child instead of starting over at each tick",
)

KINDS: Mapping[str, NodeKind] = {
    kind.key: kind
    for kind in (
        NodeKind(
            key="sequence",
            fields=(_MEMORY,),
            children=Children.LIST,
            description="Does its children one after the other, until one fails.",
        ),
        NodeKind(
            key="selector",
            fields=(_MEMORY,),
            children=Children.LIST,
            description="Tries its children one after the other, until one succeeds.",
        ),
        NodeKind(
            key="parallel",
            fields=(
                NodeField(
                    name="succeed_on",
                    content=Content.CONSTANT,
                    type=FieldType.TEXT,
                    required=False,
                    default="all",
                    words=("all", "one"),
                    description="how many children must succeed",
                ),
            ),
            children=Children.LIST,
            description="Does its children at the same time.",
        ),
        NodeKind(
            key="check",
            main="condition",
            fields=(NodeField(name="condition", content=Content.CONDITION),),
            description="Succeeds when a condition is true, else fails.",
        ),
        NodeKind(key="set", description="Gives names values that later nodes can use."),
        NodeKind(
            key="wait",
            main="duration",
            fields=(NodeField(name="duration", type=FieldType.DURATION),),
            description="Waits for a time.",
        ),
        NodeKind(
            key="wait_for",
            fields=(
                NodeField(name="topic", content=Content.ROS_NAME),
                NodeField(name="type", content=Content.ROS_TYPE),
                NodeField(name="until", content=Content.CONDITION, required=False, message="msg"),
            ),
            description="Waits for a message on a topic, or for one that fits a condition.",
        ),
        NodeKind(key="action", description="Uses a ROS action."),
        NodeKind(key="service", description="Calls a ROS service."),
        NodeKind(key="publish", description="Publishes a message on a ROS topic."),
        NodeKind(
            key="subtree",
            main="name",
            children=Children.ONE,
            description="Does a tree that stands under 'subtrees'; 'with' gives its inputs.",
        ),
    )
}
"""Kinds of nodes by key; skills come on top of these."""

MODIFIERS: Mapping[str, ModifierKind] = {
    modifier.key: modifier
    for modifier in (
        ModifierKind(
            key="when",
            field=NodeField(name="condition", content=Content.CONDITION),
            description="Leaves the node out unless a condition is true when it would start.",
        ),
        ModifierKind(
            key="on_failure", description="A node that is done instead when the node has failed."
        ),
        ModifierKind(
            key="retry",
            field=NodeField(name="attempts", type=FieldType.INTEGER, minimum=1),
            description="How often the node is tried in all, until it succeeds.",
        ),
        ModifierKind(
            key="repeat",
            field=NodeField(name="times", type=FieldType.INTEGER, minimum=1),
            description="How often the node is done in all, while it succeeds.",
        ),
        ModifierKind(
            key="timeout",
            field=NodeField(name="limit", type=FieldType.DURATION),
            description="How long the node may take; then it is stopped and has failed.",
        ),
        ModifierKind(
            key="invert", description="Success counts as failure and failure as success."
        ),
    )
}
"""Modifiers by key, in the order in which they wrap a node: the first one is the outermost."""

BESIDE = ("name", "with")
"""Other keys beside a node: its name for people, and the inputs of a subtree."""
