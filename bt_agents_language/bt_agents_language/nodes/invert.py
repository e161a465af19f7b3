# SPDX-License-Identifier: Apache-2.0
"""``invert``: swaps success and failure of its node."""

from __future__ import annotations

from bt_agents_language.nodes.endings import Outcome
from bt_agents_language.nodes.node_type import NodeType, Role

_SWAPPED = {Outcome.SUCCESS: Outcome.FAILURE, Outcome.FAILURE: Outcome.SUCCESS}

INVERT = NodeType(
    key="invert",
    order=110,
    role=Role.DECORATOR,
    description="Success counts as failure and failure as success.",
    outcomes=lambda spec, children: frozenset(_SWAPPED.get(one, one) for one in children[0]),
    unaffected=True,
    example="""\
tree:
  sequence:
    - check: scene.person
      invert: true
    - drive: charging station
""",
)
