# SPDX-License-Identifier: Apache-2.0
"""Timeouts and heartbeat of a binding's server."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind
from bt_agents_language.fields.interfaces import Interfaces, read_ros_name, read_ros_type
from bt_agents_language.model.specs import HeartbeatSpec, Timeouts
from bt_agents_language.yaml.field_tables import DURATION, ROS_NAME, ROS_TYPE, FieldDecl, KeyTable
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader

TIMEOUTS = KeyTable(
    what="'timeouts'",
    fields=(
        FieldDecl("server", DURATION, "until the server is found"),
        FieldDecl("accept", DURATION, "until the server says whether it takes the goal"),
        FieldDecl("result", DURATION, "until the result or answer"),
    ),
)
"""The keys of ``timeouts``."""

HEARTBEAT = KeyTable(
    what="'heartbeat'",
    fields=(
        FieldDecl("topic", ROS_NAME, "what the server publishes while it is alive", required=True),
        FieldDecl("type", ROS_TYPE, "ROS type of the topic", required=True),
        FieldDecl("within", DURATION, "how long it may be silent"),
    ),
)
"""The keys of ``heartbeat``."""


def timeout_keys(kind: BindingKind) -> tuple[str, ...]:
    """Return the keys of ``timeouts``; a service answers at once, so it accepts nothing."""
    return tuple(one for one in TIMEOUTS.values if one != "accept" or kind is BindingKind.ACTION)


def read_timeouts(reading: TypedReader, fields: MappingReader, kind: BindingKind) -> Timeouts:
    """Return how long the server may take; what is not written or wrong is as usual."""
    usual = Timeouts()
    node = fields.get("timeouts")
    table = TIMEOUTS.only(timeout_keys(kind))
    written = reading.keys(node, table) if node is not None else None
    if written is None:
        return usual
    server, accept, result = (_limit(reading, written, key) for key in TIMEOUTS.values)
    return Timeouts(
        server_s=server or usual.server_s, accept_s=accept or usual.accept_s, result_s=result
    )


def read_heartbeat(
    reading: TypedReader, fields: MappingReader, interfaces: Interfaces | None
) -> HeartbeatSpec | None:
    """Return by what the server's death is noticed; None for nothing, or what is wrong."""
    node = fields.get("heartbeat")
    if node is None:
        return None
    written = reading.keys(node, HEARTBEAT)
    if written is None:
        return None
    topic_node, type_node = written.get("topic"), written.get("type")
    topic = read_ros_name(reading, topic_node, "'topic'") if topic_node is not None else None
    type_name = (
        read_ros_type(reading, type_node, BindingKind.TOPIC, interfaces)
        if type_node is not None
        else None
    )
    within_s = _limit(reading, written, "within")
    if topic is None or type_name is None:
        return None
    if within_s is None:
        return HeartbeatSpec(topic=topic, type=type_name)
    return HeartbeatSpec(topic=topic, type=type_name, within_s=within_s)


def _limit(reading: TypedReader, fields: MappingReader, key: str) -> float | None:
    """Return a time that is more than none [s]."""
    seconds = fields.duration(key)
    if seconds == 0:
        reading.error(
            "out-of-range",
            fields.nodes[key],
            f"'{key}' is 0 s, expected a time that a server can keep",
            "write a longer time, or leave it out",
        )
        return None
    return seconds
