# SPDX-License-Identifier: Apache-2.0
"""``publish``: publishes a message on a ROS topic."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType
from bt_agents_language.nodes.ros_leaf import ROS_TYPE, read_ros_leaf

PUBLISH = NodeType(
    key="publish",
    order=120,
    fields=(
        NodeField(name="topic", content=Content.ROS_NAME, description="name of the topic"),
        ROS_TYPE,
        NodeField(name="message", content=Content.MAP, description="fields of the message"),
    ),
    description="Publishes a message on a ROS topic.",
    interface=BindingKind.TOPIC,
    read=read_ros_leaf,
    idle=True,
    example="""\
tree:
  publish: {topic: sound, type: std_msgs/msg/String, message: {data: chirp}}
""",
)
