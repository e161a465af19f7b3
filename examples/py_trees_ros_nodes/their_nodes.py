# SPDX-License-Identifier: Apache-2.0
"""Behaviours of py_trees_ros as nodes."""

from py_trees.common import ClearingPolicy
from py_trees_ros.action_clients import FromConstant
from py_trees_ros.subscribers import CheckData, ToBlackboard
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool, String

from bt_agents_core.field_types import FieldType
from bt_agents_interfaces.action import Say
from bt_agents_language.nodes.node_type import NodeField


class Door(CheckData):
    """Waits until the door is open, or closed."""

    main = "open"
    fields = (NodeField(name="open", type=FieldType.BOOLEAN, description="what it waits for"),)

    def __init__(self, name, open):
        super().__init__(
            name,
            topic_name="door",
            topic_type=Bool,
            qos_profile=QoSProfile(depth=1),
            variable_name="data",
            expected_value=open,
            clearing_policy=ClearingPolicy.NEVER,
        )


class Greet(FromConstant):
    """Greets by the action of another robot."""

    main = "text"
    fields = (NodeField(name="text", type=FieldType.TEXT, description="what it says"),)

    def __init__(self, name, text):
        super().__init__(
            name, action_type=Say, action_name="other/say", action_goal=Say.Goal(text=text)
        )


class Listen(ToBlackboard):
    """Waits for words; later nodes can use ${heard}."""

    writes = {"/heard": NodeField(name="heard", type=FieldType.TEXT)}

    def __init__(self, name):
        super().__init__(
            name,
            topic_name="words",
            topic_type=String,
            qos_profile=QoSProfile(depth=10),
            blackboard_variables={"heard": "data"},
            clearing_policy=ClearingPolicy.NEVER,
        )
