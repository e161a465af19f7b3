# SPDX-License-Identifier: Apache-2.0
"""``action``: uses a ROS action."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind
from bt_agents_language.nodes.node_type import NodeType
from bt_agents_language.nodes.ros_leaf import called_fields, read_ros_leaf

ACTION = NodeType(
    key="action",
    order=100,
    fields=called_fields(
        BindingKind.ACTION,
        outputs="names for later nodes, each with the result field that gives its value; "
        "feedback.x gives the value while the action runs",
        timeouts="server (3 s): longest time to find the server; accept (3 s): for the server to "
        "accept the goal; result: from then to the result, unlimited if left out",
    ),
    description="Sends a goal to a ROS action and waits for the result.",
    interface=BindingKind.ACTION,
    message=BindingKind.ACTION,
    read=read_ros_leaf,
    idle=True,
    example="""\
tree:
  sequence:
    - action:
        name: ask
        type: bt_agents_interfaces/action/Ask
        goal: {text: "Where to?", wait_s: 10.0}
        outputs: {place: answer}
        succeed_when: result.answer != ''
    - say: To ${place}.
""",
)
