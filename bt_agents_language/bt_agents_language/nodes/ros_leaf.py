# SPDX-License-Identifier: Apache-2.0
"""Leaves that name a ROS action, service or topic directly instead of a skill."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_language.fields.bindings import (
    RECEIVED,
    SENT,
    Outputs,
    binding_keys,
    read_binding,
    timeout_keys,
)
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import FieldSpec, NodeSpec, SkillSpec
from bt_agents_language.nodes.node_type import Content, NodeField, NodeReader, RawNode
from bt_agents_language.yaml.typed_reader import MappingReader
from bt_agents_language.yaml.yaml_reader import Scalar

ROS_TYPE = NodeField(
    name="type", content=Content.ROS_TYPE, description="ROS type, package/kind/Name"
)


def called_fields(kind: BindingKind, outputs: str, timeouts: str) -> tuple[NodeField, ...]:
    """Return the fields of a leaf that calls an action or a service.

    Args:
        kind: Which of the two.
        outputs: Description of the field ``outputs``.
        timeouts: Description of the field ``timeouts``.
    """
    return (
        NodeField(name="name", content=Content.ROS_NAME, description=f"name of the {kind.value}"),
        ROS_TYPE,
        NodeField(
            name=SENT[kind],
            content=Content.MAP,
            required=False,
            description=f"fields of the {SENT[kind]}",
        ),
        NodeField(name="outputs", content=Content.OUTPUTS, required=False, description=outputs),
        NodeField(
            name="succeed_when",
            content=Content.CONDITION,
            required=False,
            message="result",
            description="condition over the result, result.*; without it, any result is a success",
        ),
        NodeField(
            name="timeouts",
            content=Content.TIMEOUTS,
            words=timeout_keys(kind),
            required=False,
            description=timeouts,
        ),
        NodeField(
            name="heartbeat",
            content=Content.HEARTBEAT,
            required=False,
            description="topic, type: what the server publishes while it is alive; within (1 s): "
            "the node fails if the server is silent for this long",
        ),
        NodeField(
            name="error_code",
            content=Content.ERROR_CODE,
            required=False,
            description="field: result field with the error code; success (0): codes that mean "
            "success; message: result field with the reason",
        ),
    )


def read_ros_leaf(
    reader: NodeReader, raw: RawNode, path: str, names: NameScope
) -> NodeSpec | None:
    """Return the node of a leaf, as for an unnamed skill; None if it is wrong."""
    assert raw.type is not None
    assert raw.type.interface is not None
    reading, kind = reader.reading, raw.type.interface
    name_key = "topic" if kind is BindingKind.TOPIC else "name"
    keys = binding_keys(kind, name_key)
    if kind in RECEIVED:
        keys = (*keys, "outputs")
    needed = (name_key, "type", SENT[kind]) if kind is BindingKind.TOPIC else (name_key, "type")
    fields = reading.fields(raw.value, f"'{raw.type.key}'", keys, needed)
    if fields is None:
        return None
    outputs = _outputs(reader, fields, kind)
    binding = read_binding(
        reading, kind, fields, names, names, reader.interfaces, outputs, name_key=name_key
    )
    if binding is None:
        return None
    skill = SkillSpec(
        name=raw.type.key,
        description="",
        main=None,
        inputs=(),
        outputs=tuple(
            FieldSpec(name=name, type=FieldType.ANY, required=False)
            for name in (*outputs.result, *outputs.feedback)
        ),
        binding=binding,
        position=raw.key.position,
    )
    return NodeSpec(
        path=path,
        position=raw.key.position,
        kind=raw.type.key,
        name=raw.name or f"{raw.type.key} {binding.name}",
        skill=skill,
        outputs=binding.outputs,
        feedback=binding.feedback,
    )


def _outputs(reader: NodeReader, fields: MappingReader, kind: BindingKind) -> Outputs:
    node = fields.get("type")
    type_name = node.text if isinstance(node, Scalar) else ""
    outputs = Outputs(kind, type_name, reader.interfaces)
    for entry in fields.entries("outputs", "names and fields"):
        name = entry.key.text
        outputs.read(reader.reading, name, entry.value, f"output '{name[:40]}'")
    return outputs
