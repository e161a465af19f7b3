# SPDX-License-Identifier: Apache-2.0
"""Facts: messages that hold until a later one, so that each file of a journal begins with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from bt_agents_ros.system_topics import HOST, TOPICS, SystemTopic, topic_called

CARDS = topic_called("bt_agents/cards")
DIAGNOSTICS = topic_called("/diagnostics")

_EVENTS = ("bt_agents/scene", "bt_agents/scene/persons")
"""Latched topics whose messages are independent events."""


def is_fact(topic: SystemTopic) -> bool:
    """Return whether each message of a topic holds until the next one."""
    return topic.profile == "FACT" and topic.name not in _EVENTS


def reporting_node(statuses: Sequence[Any]) -> str:
    """Return the node whose health some statuses of ``/diagnostics`` report; empty for none."""
    return f"{statuses[0].hardware_id} {statuses[0].name}" if statuses else ""


def fact_key(topic: str, type_name: str, decode: Callable[[], Any]) -> str:
    """Return which fact a recorded message is: the next one with this key replaces it.

    Args:
        topic: Full name, in any namespace.
        type_name: ``package/msg/Name``.
        decode: Returns the message; called for topics that several nodes publish.

    Returns:
        Key; empty for an event, and for a message that cannot be read.
    """
    known = _system_topic(topic, type_name)
    if known not in (CARDS, DIAGNOSTICS):
        return topic if known is not None and is_fact(known) else ""
    try:
        message = decode()
        sender = message.host if known is CARDS else reporting_node(message.status)
    except Exception:
        # Decoders raise any exception for broken bytes.
        return ""
    return f"{topic} {sender}"


@lru_cache(maxsize=1000)
def _system_topic(topic: str, type_name: str) -> SystemTopic | None:
    """Return the topic of the system that a recorded one is; None for another one."""
    full = f"/{topic.lstrip('/')}"
    for known in TOPICS:
        end = known.name.removeprefix(HOST).lstrip("/")
        if known.type == type_name and full.endswith(f"/{end}"):
            return known
    return None
