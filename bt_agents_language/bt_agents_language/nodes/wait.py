# SPDX-License-Identifier: Apache-2.0
"""``wait``: waits for a time."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.endings import always_success
from bt_agents_language.nodes.node_type import NodeField, NodeType, Waits

WAIT = NodeType(
    key="wait",
    order=80,
    main="duration",
    fields=(NodeField(name="duration", type=FieldType.DURATION, description="how long"),),
    description="Waits for a time.",
    outcomes=always_success,
    waits=Waits.TIME,
    takes_time=True,
    idle=True,
    example="""\
tree:
  sequence:
    - say: Let me think.
    - wait: 1.5 s
    - say: This way.
""",
)
