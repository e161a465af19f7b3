# SPDX-License-Identifier: Apache-2.0
"""``service``: calls a ROS service."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind
from bt_agents_language.nodes.node_type import NodeType
from bt_agents_language.nodes.ros_leaf import called_fields, read_ros_leaf

SERVICE = NodeType(
    key="service",
    order=110,
    fields=called_fields(
        BindingKind.SERVICE,
        outputs="names for later nodes, each with the result field that gives its value",
        timeouts="server (3 s): longest time to find the server; result (10 s): for its answer",
    ),
    description="Calls a ROS service.",
    interface=BindingKind.SERVICE,
    message=BindingKind.SERVICE,
    read=read_ros_leaf,
    idle=True,
    example="""\
tree:
  service:
    name: set_light
    type: bt_agents_interfaces/srv/SetLight
    request: {colour: green, blink: true}
    succeed_when: result.accepted
""",
)
