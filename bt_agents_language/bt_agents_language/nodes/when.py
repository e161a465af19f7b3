# SPDX-License-Identifier: Apache-2.0
"""``when``: skips its node unless a condition is true at its start."""

from __future__ import annotations

from bt_agents_language.nodes.endings import never_true, skippable
from bt_agents_language.nodes.node_type import Content, Mark, NodeField, NodeType, Role

WHEN = NodeType(
    key="when",
    order=10,
    role=Role.DECORATOR,
    main="condition",
    fields=(
        NodeField(
            name="condition",
            content=Content.CONDITION,
            description="must be true for the node to start",
        ),
    ),
    description="Leaves the node out unless a condition is true when the node is due to start.",
    outcomes=skippable,
    unreached=never_true,
    skips=True,
    decides=True,
    to_cover=((Mark.LEFT_OUT, "never left out"),),
    example="""\
tree:
  sequence:
    - say: Hello. I carry your luggage.
      when: scene.familiarity < 3
    - drive: check-in desk
""",
)
