# SPDX-License-Identifier: Apache-2.0
"""``sequence``: runs its children one after the other, until one fails."""

from __future__ import annotations

from bt_agents_language.nodes.endings import Outcome, in_sequence, unreached_after
from bt_agents_language.nodes.node_type import MEMORY, Children, NodeType, Role

SEQUENCE = NodeType(
    key="sequence",
    order=10,
    role=Role.COMPOSITE,
    fields=(MEMORY,),
    children=Children.LIST,
    description="Runs its children one after another until one fails.",
    outcomes=lambda spec, children: in_sequence(children, Outcome.SUCCESS),
    unreached=lambda spec, outcomes: unreached_after(spec, Outcome.SUCCESS, outcomes),
    example="""\
tree:
  sequence:
    - say: Hello.
    - drive: check-in desk
""",
)
