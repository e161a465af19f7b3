# SPDX-License-Identifier: Apache-2.0
"""``cooldown``: skips its node for a time after that has ended."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.endings import skippable
from bt_agents_language.nodes.node_type import Mark, NodeField, NodeType, Role

COOLDOWN = NodeType(
    key="cooldown",
    order=30,
    role=Role.DECORATOR,
    main="duration",
    fields=(NodeField(name="duration", type=FieldType.DURATION, description="how long"),),
    description="Leaves the node out for a time after it has ended.",
    outcomes=skippable,
    skips=True,
    decides=True,
    to_cover=((Mark.LEFT_OUT, "never left out"),),
    example="""\
tree:
  repeat: {until: not live.person, pause: 1 s}
  sequence:
    - say: I am still here.
      cooldown: 30 s
    - wait: 1 s
""",
)
