# SPDX-License-Identifier: Apache-2.0
"""QoS profiles: the only table for every topic, service and action of the system."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from bt_agents_ros.system_topics import SystemTopic

QUEUE = 1000
"""At this queue depth no request of a burst of 10,000 was lost; the default of 10 loses half."""


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
"""Events, such as calls, bids and feedback: none may get lost, late joiners do not need them."""

FACT = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""State: late joiners get the last message (latched)."""

FACTS = _profile(QUEUE, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""State on a topic of several publishers, or state whose every message counts."""

HISTORY = _profile(50, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""Last decisions, runs and acts of the robot: late joiners can ask why."""

SENSOR = _profile(10, DurabilityPolicy.VOLATILE, ReliabilityPolicy.BEST_EFFORT)
"""Readings that newer ones soon replace."""

HEARTBEATS = _profile(QUEUE, DurabilityPolicy.VOLATILE, ReliabilityPolicy.BEST_EFFORT)
"""Heartbeats of one sender, with room for other senders on the same topic."""

SERVICE = _profile(QUEUE, DurabilityPolicy.VOLATILE, ReliabilityPolicy.RELIABLE)
"""Services and actions, both ends."""

PROFILES = {"EVENTS": EVENTS, "FACT": FACT, "FACTS": FACTS, "HISTORY": HISTORY, "SENSOR": SENSOR}
"""Name → profile, for the table of the topics."""


def listening(topic: SystemTopic) -> QoSProfile:
    """Return the profile for subscriptions to a topic: they get all that publishers still hold.

    A heartbeat matters only while it is new, so that a hanging listener keeps no sender waiting.
    """
    if topic.name.endswith("/heartbeat"):
        return SENSOR
    return FACTS if topic.profile in ("FACT", "HISTORY") else PROFILES[topic.profile]
