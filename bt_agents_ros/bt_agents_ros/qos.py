# SPDX-License-Identifier: Apache-2.0
"""QoS profiles: the one table for every topic, service and action of the system."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from bt_agents_ros.system_topics import SystemTopic

QUEUE = 1000
"""Queue depth at which no request of a burst of 10,000 was lost; the default of 10 loses half."""


def _profile(
    depth: int, durability: DurabilityPolicy, reliability: ReliabilityPolicy
) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        durability=durability,
        reliability=reliability,
    )


EVENTS = _profile(QUEUE, DurabilityPolicy.VOLATILE, ReliabilityPolicy.RELIABLE)
"""Events, such as calls, bids and feedback: none may be lost, late joiners do not need them."""

FACT = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""State: late joiners get the last message (latched)."""

FACTS = _profile(QUEUE, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""State that several publishers share a topic for, or of which no message may be missed."""

HISTORY = _profile(50, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""Last decisions and runs: late joiners can ask why."""

SENSOR = _profile(10, DurabilityPolicy.VOLATILE, ReliabilityPolicy.BEST_EFFORT)
"""Readings that are soon replaced by newer ones."""

HEARTBEATS = _profile(QUEUE, DurabilityPolicy.VOLATILE, ReliabilityPolicy.BEST_EFFORT)
"""Heartbeats of one sender, with room for what others send on their topic."""

SERVICE = _profile(QUEUE, DurabilityPolicy.VOLATILE, ReliabilityPolicy.RELIABLE)
"""Services and actions, both ends."""

PROFILES = {"EVENTS": EVENTS, "FACT": FACT, "FACTS": FACTS, "HISTORY": HISTORY, "SENSOR": SENSOR}
"""Name → profile, for the table of the topics."""


def listening(topic: SystemTopic) -> QoSProfile:
    """Return the profile with which a topic is heard: all that its publishers still hold.

    A heartbeat is heard only while it is new, so that nobody waits for a listener that hangs.
    """
    if topic.name.endswith("/heartbeat"):
        return SENSOR
    return FACTS if topic.profile in ("FACT", "HISTORY") else PROFILES[topic.profile]
