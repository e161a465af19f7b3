# SPDX-License-Identifier: Apache-2.0
"""``selector``: tries its children one after the other, until one succeeds."""

from __future__ import annotations

from bt_agents_language.nodes.endings import Outcome, in_sequence, unreached_after
from bt_agents_language.nodes.node_type import MEMORY, Children, NodeType, Role

SELECTOR = NodeType(
    key="selector",
    order=20,
    role=Role.COMPOSITE,
    fields=(MEMORY,),
    children=Children.LIST,
    description="Tries its children one after another until one succeeds.",
    continues_on=Outcome.FAILURE,
    outcomes=lambda spec, children: in_sequence(children, Outcome.FAILURE),
    unreached=lambda spec, outcomes: unreached_after(spec, Outcome.FAILURE, outcomes),
    alternatives=lambda spec: spec.children,
    example="""\
tree:
  selector:
    - ask: Shall I carry your bag?
    - say: Nobody answered. I wait over there.
""",
)
