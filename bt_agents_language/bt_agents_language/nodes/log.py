# SPDX-License-Identifier: Apache-2.0
"""``log``: writes a line into the log of the robot."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.endings import always_success
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType

LOG = NodeType(
    key="log",
    order=130,
    main="message",
    fields=(
        NodeField(name="message", type=FieldType.TEXT, description="what to write"),
        NodeField(
            name="level",
            content=Content.CONSTANT,
            type=FieldType.TEXT,
            required=False,
            default="info",
            words=("info", "warning", "error"),
            description="severity of the line",
        ),
    ),
    description="Writes a line to the robot's log; the robot does not say it.",
    outcomes=always_success,
    example="""\
tree:
  sequence:
    - log: The mood is ${live.mood}.
    - log: {message: Nobody is here., level: warning}
      when: not live.person
""",
)
