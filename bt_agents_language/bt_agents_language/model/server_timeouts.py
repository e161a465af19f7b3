# SPDX-License-Identifier: Apache-2.0
"""What a binding says about its server's time and signs of life: ``timeouts``, ``heartbeat``."""

from __future__ import annotations

from bt_agents_language.model.interfaces import Interfaces, read_ros_name, read_ros_type
from bt_agents_language.model.specs import BindingKind, HeartbeatSpec, Timeouts
from bt_agents_language.yaml.mapping_reader import MappingReader
from bt_agents_language.yaml.typed_reader import TypedReader

LIMIT_KEYS = ("timeouts", "heartbeat")
"""Keys of a binding to an action or service."""

TIMEOUT_KEYS = {
    "server": "until the server is found",
    "accept": "until the server says whether it takes the goal",
    "result": "until the result or answer",
}
"""Keys of ``timeouts``, with what they limit."""

HEARTBEAT_KEYS = {
    "topic": "what the server publishes while it is alive",
    "type": "ROS type of the topic",
    "within": "how long it may be silent",
}
"""Keys of ``heartbeat``, with their meaning."""


def timeout_keys(kind: BindingKind) -> tuple[str, ...]:
    """Return the keys of ``timeouts``; a service answers at once, so it accepts nothing."""
    return tuple(one for one in TIMEOUT_KEYS if one != "accept" or kind is BindingKind.ACTION)


def read_timeouts(reading: TypedReader, fields: MappingReader, kind: BindingKind) -> Timeouts:
    """Return how long the server may take; what is not written or wrong is as usual."""
    usual = Timeouts()
    node = fields.get("timeouts")
    written = reading.fields(node, "'timeouts'", timeout_keys(kind)) if node is not None else None
    if written is None:
        return usual
    server, accept, result = (_limit(reading, written, key) for key in TIMEOUT_KEYS)
    return Timeouts(
        server_s=server or usual.server_s,
        accept_s=accept or usual.accept_s,
        result_s=result,
    )


def read_heartbeat(
    reading: TypedReader, fields: MappingReader, interfaces: Interfaces | None
) -> HeartbeatSpec | None:
    """Return by what the server's death is noticed; None for nothing, or what is wrong."""
    node = fields.get("heartbeat")
    if node is None:
        return None
    written = reading.fields(node, "'heartbeat'", tuple(HEARTBEAT_KEYS), ("topic", "type"))
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
