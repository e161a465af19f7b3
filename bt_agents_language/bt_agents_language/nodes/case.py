# SPDX-License-Identifier: Apache-2.0
"""``case``: wraps each child of a ``choose``."""

from __future__ import annotations

from bt_agents_language.nodes.node_type import NodeType, Role

CASE = NodeType(
    key="case",
    order=10,
    role=Role.BRANCH,
    main="condition",
    # The last child of 'choose' is the only one without a condition.
    drawn_key=lambda spec: "case" if spec.fields else "otherwise",
)
