# SPDX-License-Identifier: Apache-2.0
"""``weight``: wraps a child of a ``random``; its key is written next to the child."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.node_type import NodeField, NodeType, Role, SiblingKey

WEIGHT_KEY = SiblingKey(
    field=NodeField(
        name="weight",
        type=FieldType.NUMBER,
        minimum=0,
        description="How often this child is chosen relative to the other children; 1 if left "
        "out.",
    ),
    where="a child of 'random'",
    hint="put the node among the children of 'random', or remove it",
    example="""\
tree:
  random:
    - say: Hello.
      weight: 3
    - say: Good day to you.
      weight: 1
""",
)

WEIGHT = NodeType(key="weight", order=20, role=Role.BRANCH, main="weight")
