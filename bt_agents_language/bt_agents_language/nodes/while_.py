# SPDX-License-Identifier: Apache-2.0
"""``while``: stops its node once a condition is no longer true."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.endings import FAILURE, Outcomes, constant, limited, never_true
from bt_agents_language.nodes.node_type import Content, Mark, NodeField, NodeType, Role


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    is_true = constant(spec.fields.get("condition"))
    if is_true is not None:
        return children[0] if is_true else FAILURE
    return limited(children[0])


WHILE = NodeType(
    key="while",
    order=70,
    role=Role.DECORATOR,
    main="condition",
    fields=(
        NodeField(name="condition", content=Content.CONDITION, description="what must stay true"),
    ),
    description="Checks a condition at each tick; as soon as it is not true, stops the node, "
    "which then fails.",
    outcomes=_outcomes,
    unreached=never_true,
    limits=True,
    gives_up=True,
    to_cover=((Mark.BROKEN_OFF, "never broken off"),),
    example="""\
tree:
  while: live.person
  sequence:
    - say: Follow me.
    - drive: check-in desk
""",
)
