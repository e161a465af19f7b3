# SPDX-License-Identifier: Apache-2.0
"""``wait_for``: waits until a condition is true, or for a message on a topic."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_core.text import join_quoted
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import Literal, NodeSpec
from bt_agents_language.nodes.endings import EITHER, ENDLESS
from bt_agents_language.nodes.node_type import (
    Content,
    NodeField,
    NodeReader,
    NodeType,
    RawNode,
    Resources,
    Waits,
)
from bt_agents_language.yaml.yaml_reader import key_or_node

_OF_A_MESSAGE = ("topic", "type", "until", "latched", "outputs")
_NEEDED = ("topic", "type")


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
    nodes = reader.written_fields(raw)
    if nodes is None:
        return None
    message = [key for key in _OF_A_MESSAGE if key in nodes]
    missing = [key for key in _NEEDED if key not in nodes]
    if "condition" in nodes and message:
        reader.reading.error(
            "misplaced-key",
            key_or_node(raw.value, message[0]),
            f"'{message[0]}' is about a message, but this waits for a condition",
            "wait for the one or the other; 'parallel' waits for both",
        )
    elif "condition" not in nodes and missing:
        reader.reading.error(
            "missing-key",
            raw.key,
            f"'wait_for' needs a condition, or the keys {join_quoted(_NEEDED)}",
            "write wait_for: live.person, or add " + ", ".join(f"'{key}: …'" for key in missing),
        )
    label = nodes.get("condition") or nodes.get("topic")
    return reader.leaf(raw, path, names, nodes, label)


def _resources(spec: NodeSpec) -> Resources:
    values = spec.fields.items()
    fixed = {name: value.value for name, value in values if isinstance(value, Literal)}
    if "topic" not in fixed:
        return Resources()
    topic = (str(fixed["topic"]), str(fixed["type"]))
    return Resources(topic=topic, latched=fixed.get("latched") is True)


WAIT_FOR = NodeType(
    key="wait_for",
    order=90,
    main="condition",
    fields=(
        NodeField(
            name="condition",
            content=Content.CONDITION,
            required=False,
            description="condition to wait for; instead of a topic",
        ),
        NodeField(
            name="topic",
            content=Content.ROS_NAME,
            required=False,
            description="topic to wait for a message on; instead of a condition",
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
            description="true: the last earlier message counts too, if its publisher keeps it "
            "(transient local)",
        ),
        NodeField(
            name="until",
            content=Content.CONDITION,
            required=False,
            message="msg",
            description="condition over the message, msg.*; without it, any message counts",
        ),
        NodeField(
            name="for",
            type=FieldType.DURATION,
            required=False,
            description="how long the condition must hold without interruption",
        ),
        NodeField(
            name="outputs",
            content=Content.OUTPUTS,
            required=False,
            message="msg",
            description="names for later nodes, each with the message field that gives its value",
        ),
    ),
    description="Waits until a condition is true, or for a message on a topic.",
    message=BindingKind.TOPIC,
    read=_read,
    outcomes=lambda spec, children: EITHER | ENDLESS,
    waits=Waits.EVENT,
    takes_time=True,
    idle=True,
    resources=_resources,
    example="""\
tree:
  sequence:
    - wait_for: live.person
      timeout: 1 min
    - wait_for: {condition: live.mood >= 4, for: 2 s}
      timeout: 1 min
    - wait_for: {topic: buttons/confirm, type: std_msgs/msg/Bool, until: msg.data}
      timeout: 10 s
""",
)
