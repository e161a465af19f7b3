# SPDX-License-Identifier: Apache-2.0
"""Every quality-of-service profile of the system, in one table."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

QUEUE = 1000
"""Depth at which no request of a burst of 10,000 was lost; the default of 10 loses half."""


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
"""Things that happen: calls, bids, feedback; none may be lost, late joiners do not need them."""

FACT = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""What is true now: late joiners get the last one."""

FACTS = _profile(QUEUE, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""Subscriber side of facts that several nodes state on one topic, or that must all be seen."""

HISTORY = _profile(50, DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE)
"""The last decisions and runs: late joiners can ask why."""

SENSOR = _profile(10, DurabilityPolicy.VOLATILE, ReliabilityPolicy.BEST_EFFORT)
"""Readings that are soon replaced by newer ones."""

SERVICE = _profile(QUEUE, DurabilityPolicy.VOLATILE, ReliabilityPolicy.RELIABLE)
"""Services and actions, both ends."""
