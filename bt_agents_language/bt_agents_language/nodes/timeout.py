# SPDX-License-Identifier: Apache-2.0
"""``timeout``: stops its node after a time."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.endings import limited
from bt_agents_language.nodes.node_type import Mark, NodeField, NodeType, Role

TIMEOUT = NodeType(
    key="timeout",
    order=100,
    role=Role.DECORATOR,
    main="limit",
    fields=(NodeField(name="limit", type=FieldType.DURATION, description="how long"),),
    description="Longest time that the node may take; then it is stopped and fails.",
    outcomes=lambda spec, children: limited(children[0]),
    unaffected=True,
    limits=True,
    gives_up=True,
    to_cover=((Mark.BROKEN_OFF, "never ran out of time"),),
    example="""\
tree:
  drive: check-in desk
  timeout: 5 min
""",
)
