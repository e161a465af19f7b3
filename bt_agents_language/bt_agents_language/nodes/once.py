# SPDX-License-Identifier: Apache-2.0
"""``once``: skips its node after that has ended once."""

from __future__ import annotations

from bt_agents_language.nodes.endings import skippable
from bt_agents_language.nodes.node_type import Mark, NodeType, Role

ONCE = NodeType(
    key="once",
    order=20,
    role=Role.DECORATOR,
    description="Leaves the node out after it has ended once in this run.",
    outcomes=skippable,
    skips=True,
    unaffected=True,
    single_round=True,
    decides=True,
    to_cover=((Mark.LEFT_OUT, "never left out"),),
    example="""\
tree:
  repeat: 3
  sequence:
    - say: I play a sound whenever you press the button.
      once: true
    - wait_for: {topic: buttons/confirm, type: std_msgs/msg/Bool, until: msg.data}
      timeout: 10 s
    - sound: chirp
""",
)
