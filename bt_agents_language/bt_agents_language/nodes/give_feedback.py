# SPDX-License-Identifier: Apache-2.0
"""``give_feedback``: moves the agent's profile."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import Literal, NodeSpec
from bt_agents_language.nodes.node_type import (
    Content,
    NodeField,
    NodeReader,
    NodeType,
    RawNode,
    Resources,
)
from bt_agents_language.yaml.yaml_reader import Mapping, key_or_node


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
    spec = reader.leaf(raw, path, names)
    kind = spec.fields.get("kind") if spec is not None else None
    if spec is None or not isinstance(kind, Literal):
        return spec
    direct = kind.value == "direct"
    values = raw.value.get("values") if isinstance(raw.value, Mapping) else None
    if direct and values is None:
        reader.reading.error(
            "missing-key",
            raw.value,
            "direct feedback needs the values that the profile moves to",
            "write give_feedback: {kind: direct, values: {…}}",
        )
    elif not direct and values is not None:
        reader.reading.error(
            "misplaced-key",
            key_or_node(raw.value, "values"),
            f"{kind.value} feedback takes the scene, so it has no values of its own",
            "remove 'values', or write kind: direct",
        )
    return spec


GIVE_FEEDBACK = NodeType(
    key="give_feedback",
    order=140,
    main="kind",
    fields=(
        NodeField(
            name="kind",
            content=Content.CONSTANT,
            type=FieldType.TEXT,
            words=("positive", "negative", "direct"),
            description="moves towards the scene, away from it, or towards given values",
        ),
        NodeField(
            name="values",
            content=Content.MAP,
            required=False,
            description="scene parameters and their wanted values; only for direct",
        ),
        NodeField(name="reason", type=FieldType.TEXT, required=False, description="why, in words"),
    ),
    description="Moves the agent's profile, like feedback from a person.",
    read=_read,
    idle=True,
    resources=lambda spec: Resources(feedback=True),
    example="""\
tree:
  sequence:
    - ask: {text: "Was this good?", choices: ["yes", "no"]}
    - give_feedback: {kind: positive, reason: the person said so}
      when: answer == 'yes'
""",
)
