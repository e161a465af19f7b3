# SPDX-License-Identifier: Apache-2.0
"""The table of the language: every kind of node and modifier with its fields."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_language.model.node_type import (
    Children,
    Content,
    DecoratorType,
    NodeField,
    NodeType,
    SiblingKey,
)
from bt_agents_language.model.specs import FieldType
from bt_agents_language.ros_nodes import ROS_KINDS

FOREVER = "forever"
"""Word for an attempt or repetition without end."""

_MEMORY = NodeField(
    name="memory",
    content=Content.CONSTANT,
    type=FieldType.BOOLEAN,
    required=False,
    default=True,
    description="whether it goes on at the running child instead of starting over at each tick",
)
_PAUSE = NodeField(
    name="pause",
    type=FieldType.DURATION,
    required=False,
    description="how long to wait in between",
)
KINDS: Mapping[str, NodeType] = {
    kind.key: kind
    for kind in (
        NodeType(
            key="sequence",
            fields=(_MEMORY,),
            children=Children.LIST,
            description="Does its children one after the other, until one fails.",
        ),
        NodeType(
            key="selector",
            fields=(_MEMORY,),
            children=Children.LIST,
            description="Tries its children one after the other, until one succeeds.",
        ),
        NodeType(
            key="parallel",
            fields=(
                NodeField(
                    name="succeed_on",
                    content=Content.COUNT,
                    required=False,
                    default="all",
                    words=("all", "one"),
                    minimum=1,
                    description="which children must succeed: all, one, so many, or those named",
                ),
            ),
            children=Children.LIST,
            description="Does its children at the same time.",
        ),
        NodeType(
            key="choose",
            fields=(
                NodeField(
                    name="otherwise",
                    content=Content.NODE,
                    required=False,
                    description="the node that is done when no case fits",
                ),
            ),
            children=Children.LIST,
            description="Does the first of its named cases whose 'when' is true, and no other.",
        ),
        NodeType(
            key="random",
            fields=(
                NodeField(
                    name="seed",
                    content=Content.CONSTANT,
                    type=FieldType.INTEGER,
                    required=False,
                    description="makes the choices the same in every run",
                ),
            ),
            children=Children.LIST,
            description="Does one of its children, the more often the larger its 'weight'.",
        ),
        NodeType(
            key="check",
            main="condition",
            fields=(
                NodeField(
                    name="condition", content=Content.CONDITION, description="what must be true"
                ),
            ),
            description="Succeeds when a condition is true, else fails.",
        ),
        NodeType(key="set", open=True, description="Gives names values that later nodes can use."),
        NodeType(
            key="wait",
            main="duration",
            fields=(NodeField(name="duration", type=FieldType.DURATION, description="how long"),),
            description="Waits for a time.",
        ),
        NodeType(
            key="wait_for",
            main="condition",
            fields=(
                NodeField(
                    name="condition",
                    content=Content.CONDITION,
                    required=False,
                    description="what must become true; instead of a topic",
                ),
                NodeField(
                    name="topic",
                    content=Content.ROS_NAME,
                    required=False,
                    description="where a message must come; instead of a condition",
                ),
                NodeField(
                    name="type",
                    content=Content.ROS_TYPE,
                    required=False,
                    description="ROS type of the topic",
                ),
                NodeField(
                    name="latched",
                    content=Content.CONSTANT,
                    type=FieldType.BOOLEAN,
                    required=False,
                    description="whether the last message from before counts too, where its "
                    "publisher keeps it (transient local)",
                ),
                NodeField(
                    name="until",
                    content=Content.CONDITION,
                    required=False,
                    message="msg",
                    description="condition over the message, msg.*; without it, any will do",
                ),
                NodeField(
                    name="for",
                    type=FieldType.DURATION,
                    required=False,
                    description="how long it must hold without a break",
                ),
                NodeField(
                    name="outputs",
                    content=Content.OUTPUTS,
                    required=False,
                    message="msg",
                    description="names for later nodes, each with the field of the message",
                ),
            ),
            description="Waits until a condition is true, or for a message on a topic.",
        ),
        *ROS_KINDS,
        NodeType(
            key="log",
            main="message",
            fields=(
                NodeField(name="message", type=FieldType.TEXT, description="what to write"),
                NodeField(
                    name="level",
                    content=Content.CONSTANT,
                    type=FieldType.TEXT,
                    required=False,
                    default="info",
                    words=("info", "warning", "error"),
                    description="how serious it is",
                ),
            ),
            description="Writes a line into the log of the robot; nobody hears it.",
        ),
        NodeType(
            key="give_feedback",
            main="kind",
            fields=(
                NodeField(
                    name="kind",
                    content=Content.CONSTANT,
                    type=FieldType.TEXT,
                    words=("positive", "negative", "direct"),
                    description="towards the scene, away from it, or towards given values",
                ),
                NodeField(
                    name="values",
                    content=Content.MAP,
                    required=False,
                    description="scene parameters and their wanted values; for direct only",
                ),
                NodeField(
                    name="reason",
                    type=FieldType.TEXT,
                    required=False,
                    description="why, in words",
                ),
            ),
            description="Moves the agent's profile, as a person's feedback does.",
        ),
        NodeType(
            key="subtree",
            main="name",
            fields=(
                NodeField(
                    name="name",
                    content=Content.CONSTANT,
                    type=FieldType.TEXT,
                    description="name under 'subtrees', of this file or of an import",
                ),
            ),
            children=Children.ONE,
            description="Does a tree that stands under 'subtrees'; 'with' gives its inputs.",
        ),
    )
}
"""Kinds of nodes by key; skills and plug-ins come on top of these."""

MODIFIERS: Mapping[str, DecoratorType] = {
    modifier.key: modifier
    for modifier in (
        DecoratorType(
            key="when",
            main="condition",
            fields=(
                NodeField(
                    name="condition",
                    content=Content.CONDITION,
                    description="what must be true for the node to start",
                ),
            ),
            description="Leaves the node out unless a condition is true when it would start.",
        ),
        DecoratorType(
            key="once",
            description="Leaves the node out after it has ended once in this run.",
        ),
        DecoratorType(
            key="cooldown",
            main="duration",
            fields=(NodeField(name="duration", type=FieldType.DURATION, description="how long"),),
            description="Leaves the node out for a time after it has ended.",
        ),
        DecoratorType(key="succeed", description="However the node ends, it counts as success."),
        DecoratorType(key="fail", description="However the node ends, it counts as failure."),
        DecoratorType(
            key="on_failure",
            handler=True,
            description="A node that is done instead when the node has failed.",
        ),
        DecoratorType(
            key="while",
            main="condition",
            fields=(
                NodeField(
                    name="condition",
                    content=Content.CONDITION,
                    description="what must stay true",
                ),
            ),
            description="Looks at a condition at each tick; once it is not true, the node is "
            "stopped and has failed.",
        ),
        DecoratorType(
            key="retry",
            main="attempts",
            fields=(
                NodeField(
                    name="attempts",
                    type=FieldType.INTEGER,
                    minimum=1,
                    words=(FOREVER,),
                    description="how often in all",
                ),
                _PAUSE,
            ),
            description="Tries the node again after a failure, so often in all.",
        ),
        DecoratorType(
            key="repeat",
            main="times",
            fields=(
                NodeField(
                    name="times",
                    type=FieldType.INTEGER,
                    required=False,
                    minimum=1,
                    words=(FOREVER,),
                    description="how often in all",
                ),
                NodeField(
                    name="until",
                    content=Content.CONDITION,
                    required=False,
                    description="looked at after each time; ends the repetition when it is true",
                ),
                _PAUSE,
            ),
            description="Does the node again after a success, so often in all.",
        ),
        DecoratorType(
            key="timeout",
            main="limit",
            fields=(NodeField(name="limit", type=FieldType.DURATION, description="how long"),),
            description="How long the node may take; then it is stopped and has failed.",
        ),
        DecoratorType(
            key="invert", description="Success counts as failure and failure as success."
        ),
    )
}
"""Modifiers by key, in the order in which they wrap a node: the first one is the outermost."""

BESIDE: Mapping[str, SiblingKey] = {
    beside.key: beside
    for beside in (
        SiblingKey(key="name", where="any node", description="A name for people."),
        SiblingKey(
            key="with", where="a subtree", description="The inputs of a subtree by their names."
        ),
        SiblingKey(
            key="outputs",
            where="a subtree or a skill",
            description="Names for later nodes, each with the output whose value it gets.",
        ),
        SiblingKey(
            key="weight",
            where="a child of 'random'",
            description="How often this child is chosen, relative to the others; 1 if not given.",
        ),
    )
}
"""Other keys beside a node."""

STANDS_BESIDE = (*MODIFIERS, *BESIDE)
"""Every key that can stand beside a node."""

WORDS = frozenset((*KINDS, *STANDS_BESIDE, "children"))
"""The words of the language, which no skill and no plug-in can be called."""
