# SPDX-License-Identifier: Apache-2.0
"""``fail``: counts every end of its node as failure."""

from __future__ import annotations

from bt_agents_language.nodes.endings import Outcome, counted_as
from bt_agents_language.nodes.node_type import NodeType, Role

FAIL = NodeType(
    key="fail",
    order=50,
    role=Role.DECORATOR,
    description="However the node ends, it counts as failure.",
    contrary="succeed",
    outcomes=lambda spec, children: counted_as(children[0], Outcome.FAILURE),
    unaffected=True,
    example="""\
tree:
  selector:
    - say: I look for somebody who can help.
      fail: true
    - drive: help desk
""",
)
