# SPDX-License-Identifier: Apache-2.0
"""The part of the table of the language about nodes that name a ROS interface directly."""

from __future__ import annotations

from bt_agents_language.model.node_type import Content, NodeField, NodeType
from bt_agents_language.model.server_timeouts import timeout_keys
from bt_agents_language.model.specs import BindingKind

_ROS_TYPE = NodeField(
    name="type", content=Content.ROS_TYPE, description="its ROS type, package/kind/Name"
)
_SUCCEED_WHEN = NodeField(
    name="succeed_when",
    content=Content.CONDITION,
    required=False,
    message="result",
    description="condition over what came back, result.*; without it, an answer is a success",
)

_HEARTBEAT = NodeField(
    name="heartbeat",
    content=Content.HEARTBEAT,
    required=False,
    description="topic, type, and within, 1 s: what its server publishes while it is alive; "
    "when it falls silent for so long, the node fails",
)

ROS_KINDS = (
    NodeType(
        key="action",
        fields=(
            NodeField(name="name", content=Content.ROS_NAME, description="name of the action"),
            _ROS_TYPE,
            NodeField(
                name="goal",
                content=Content.MAP,
                required=False,
                description="fields of the goal",
            ),
            NodeField(
                name="outputs",
                content=Content.OUTPUTS,
                required=False,
                description="names for later nodes, each with the field it gets; feedback.x "
                "gives it while the action goes on",
            ),
            _SUCCEED_WHEN,
            NodeField(
                name="timeouts",
                content=Content.TIMEOUTS,
                words=timeout_keys(BindingKind.ACTION),
                required=False,
                description="server and accept, 3 s each: to be found and to take the goal; "
                "result: from then on, without limit if left out",
            ),
            _HEARTBEAT,
        ),
        description="Uses a ROS action.",
    ),
    NodeType(
        key="service",
        fields=(
            NodeField(name="name", content=Content.ROS_NAME, description="name of the service"),
            _ROS_TYPE,
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
            _SUCCEED_WHEN,
            NodeField(
                name="timeouts",
                content=Content.TIMEOUTS,
                words=timeout_keys(BindingKind.SERVICE),
                required=False,
                description="server, 3 s: to be found; result, 10 s: to answer",
            ),
            _HEARTBEAT,
        ),
        description="Calls a ROS service.",
    ),
    NodeType(
        key="publish",
        fields=(
            NodeField(name="topic", content=Content.ROS_NAME, description="name of the topic"),
            _ROS_TYPE,
            NodeField(name="message", content=Content.MAP, description="fields of the message"),
        ),
        description="Publishes a message on a ROS topic.",
    ),
)
"""Kinds of nodes for actions, services and topics."""
