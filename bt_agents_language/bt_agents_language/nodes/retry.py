# SPDX-License-Identifier: Apache-2.0
"""``retry``: runs its node again after a failure."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_core.field_types import FieldType
from bt_agents_language.model.specs import Literal, NodeSpec
from bt_agents_language.nodes.endings import ENDLESS, FAILURE, Outcomes
from bt_agents_language.nodes.node_type import FOREVER, PAUSE, NodeField, NodeType, Role


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    endless = spec.fields.get("attempts") == Literal(value=FOREVER)
    return (children[0] - FAILURE) | ENDLESS if endless else children[0]


RETRY = NodeType(
    key="retry",
    order=80,
    role=Role.DECORATOR,
    main="attempts",
    fields=(
        NodeField(
            name="attempts",
            type=FieldType.INTEGER,
            minimum=1,
            words=(FOREVER,),
            description="total number of times",
        ),
        PAUSE,
    ),
    description="Tries the node again after a failure, up to a total number of attempts.",
    outcomes=_outcomes,
    rounds="attempts",
    gives_up=True,
    example="""\
tree:
  ask: Where to?
  retry: {attempts: 3, pause: 2 s}
""",
)
