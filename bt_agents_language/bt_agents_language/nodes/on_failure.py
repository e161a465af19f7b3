# SPDX-License-Identifier: Apache-2.0
"""``on_failure``: runs another node when its node has failed."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.endings import FAILURE, Outcome, Outcomes
from bt_agents_language.nodes.node_type import NodeType, Role


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    inner, handler = children
    return (inner - FAILURE) | handler if Outcome.FAILURE in inner else inner


ON_FAILURE = NodeType(
    key="on_failure",
    order=60,
    role=Role.DECORATOR,
    handler=True,
    description="Runs another node if the node fails; the end of that node then counts.",
    outcomes=_outcomes,
    alternatives=lambda spec: spec.children[:1],
    example="""\
tree:
  drive: check-in desk
  on_failure: {say: I could not get through. A colleague will help you.}
""",
)
