# SPDX-License-Identifier: Apache-2.0
"""``service``: calls a ROS service."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind
from bt_agents_language.fields.bindings import timeout_keys
from bt_agents_language.nodes.node_type import Content, MessageSource, NodeField, NodeType
from bt_agents_language.nodes.ros_leaf import (
    ERROR_CODE,
    HEARTBEAT,
    ROS_TYPE,
    SUCCEED_WHEN,
    read_ros_leaf,
)

SERVICE = NodeType(
    key="service",
    order=110,
    fields=(
        NodeField(name="name", content=Content.ROS_NAME, description="name of the service"),
        ROS_TYPE,
        NodeField(
            name="request",
            content=Content.MAP,
            required=False,
            description="fields of the request",
        ),
        NodeField(
            name="outputs",
            content=Content.OUTPUTS,
            required=False,
            description="names for later nodes, each with the field it gets",
        ),
        SUCCEED_WHEN,
        NodeField(
            name="timeouts",
            content=Content.TIMEOUTS,
            words=timeout_keys(BindingKind.SERVICE),
            required=False,
            description="server, 3 s: to be found; result, 10 s: to answer",
        ),
        HEARTBEAT,
        ERROR_CODE,
    ),
    description="Calls a ROS service.",
    interface=BindingKind.SERVICE,
    message=MessageSource(kind=BindingKind.SERVICE, section="response", prefix="result"),
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
