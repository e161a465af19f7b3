# SPDX-License-Identifier: Apache-2.0
"""Leaves that name a ROS action, service or topic directly instead of a skill."""

from __future__ import annotations

from bt_agents_language.files.bindings import (
    RECEIVED,
    SENT,
    Outputs,
    binding_keys,
    read_binding,
    what_comes_back,
)
from bt_agents_language.model.interfaces import Interfaces
from bt_agents_language.model.scope import NameScope
from bt_agents_language.model.specs import BindingKind, FieldSpec, FieldType, SkillSpec
from bt_agents_language.tree.raw_nodes import RawNode
from bt_agents_language.yaml.mapping_reader import MappingReader
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Scalar

RAW_LEAVES = {
    "action": BindingKind.ACTION,
    "service": BindingKind.SERVICE,
    "publish": BindingKind.TOPIC,
}
"""Node key → kind of ROS interface."""


def read_raw_leaf(
    reading: TypedReader,
    draft: RawNode,
    kind: BindingKind,
    names: NameScope,
    interfaces: Interfaces | None,
) -> SkillSpec | None:
    """Return an unnamed skill for the leaf; None when the leaf is wrong."""
    key = draft.word
    name_key = "topic" if kind is BindingKind.TOPIC else "name"
    keys = binding_keys(kind, name_key)
    if kind in RECEIVED:
        keys = (*keys, "outputs")
    needed = (name_key, "type", SENT[kind]) if kind is BindingKind.TOPIC else (name_key, "type")
    fields = reading.fields(draft.value, f"'{key}'", keys, needed)
    if fields is None:
        return None
    outputs = _outputs(reading, fields, kind, interfaces)
    binding = read_binding(
        reading, kind, fields, names, names, interfaces, outputs, name_key=name_key
    )
    if binding is None:
        return None
    return SkillSpec(
        name=key,
        description="",
        main=None,
        inputs=(),
        outputs=tuple(
            FieldSpec(name=name, type=FieldType.ANY, required=False)
            for name in (*outputs.result, *outputs.feedback)
        ),
        binding=binding,
        position=draft.key.position,
    )


def _outputs(
    reading: TypedReader, fields: MappingReader, kind: BindingKind, interfaces: Interfaces | None
) -> Outputs:
    node = fields.get("type")
    type_name = node.text if isinstance(node, Scalar) else ""
    back = what_comes_back(kind, type_name, interfaces)
    outputs = Outputs()
    for entry in fields.entries("outputs", "names and fields"):
        name = entry.key.text
        outputs.read(reading, name, entry.value, f"output '{name[:40]}'", back)
    return outputs
