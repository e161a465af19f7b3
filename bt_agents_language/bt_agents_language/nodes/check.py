# SPDX-License-Identifier: Apache-2.0
"""``check``: succeeds when a condition is true, else fails."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.endings import EITHER, FAILURE, SUCCESS, Outcomes, constant
from bt_agents_language.nodes.node_type import Content, Mark, NodeField, NodeType


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    is_true = constant(spec.fields.get("condition"))
    return EITHER if is_true is None else SUCCESS if is_true else FAILURE


CHECK = NodeType(
    key="check",
    order=60,
    main="condition",
    fields=(
        NodeField(name="condition", content=Content.CONDITION, description="what must be true"),
    ),
    description="Succeeds if a condition is true; otherwise fails.",
    outcomes=_outcomes,
    idle=True,
    read_only=True,
    decides=True,
    to_cover=((Mark.SUCCEEDED, "never true"), (Mark.FAILED, "never false")),
    example="""\
tree:
  selector:
    - sequence:
        - check: scene.familiarity >= 4
        - say: You know how this works.
    - say: I will show you how this works.
""",
)
