# SPDX-License-Identifier: Apache-2.0
"""``succeed``: counts every end of its node as success."""

from __future__ import annotations

from bt_agents_language.nodes.endings import Outcome, counted_as
from bt_agents_language.nodes.node_type import NodeType, Role

SUCCEED = NodeType(
    key="succeed",
    order=40,
    role=Role.DECORATOR,
    description="However the node ends, it counts as success.",
    contrary="fail",
    outcomes=lambda spec, children: counted_as(children[0], Outcome.SUCCESS),
    unaffected=True,
    example="""\
tree:
  sequence:
    - ask: Would you like some music?
      succeed: true
    - drive: check-in desk
""",
)
