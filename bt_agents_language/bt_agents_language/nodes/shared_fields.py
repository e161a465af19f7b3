# SPDX-License-Identifier: Apache-2.0
"""Fields that several node types have."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.node_type import Content, NodeField

MEMORY = NodeField(
    name="memory",
    content=Content.CONSTANT,
    type=FieldType.BOOLEAN,
    required=False,
    default=True,
    description="whether it goes on at the running child instead of starting over at each tick",
    drawn="starts over at each tick",
)

PAUSE = NodeField(
    name="pause",
    type=FieldType.DURATION,
    required=False,
    description="how long to wait in between",
)
