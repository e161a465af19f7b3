# SPDX-License-Identifier: Apache-2.0
"""Health of sources: stale ones, and ones without any reading."""

from __future__ import annotations

from bt_agents_core.health import Health
from scene_layer.health import Standing, sources_health


def test_sources_with_fresh_readings_are_ok():
    health = sources_health({"/age": Standing.FRESH}, {}, {})
    assert (health.part, health.level) == ("sources", Health.OK)
    assert health.message == "every source has a reading that holds"


def test_unread_source_warns_and_stale_source_is_stale():
    unread = sources_health({"/age": Standing.UNREAD, "/mood": Standing.FRESH}, {}, {})
    assert (unread.level, unread.message) == (Health.WARN, "no reading so far: /age")
    stale = sources_health({"/age": Standing.UNREAD, "/mood": Standing.STALE}, {}, {})
    assert (stale.level, stale.message) == (Health.STALE, "stale: /mood")


def test_refused_messages_are_counted_per_topic():
    health = sources_health({"/age": Standing.UNREAD}, {("/age", "OUT_OF_RANGE"): 12}, {})
    assert health.values == {"/age": "no reading so far, 12 refused as OUT_OF_RANGE"}


def test_other_type_of_publisher_is_an_error() -> None:
    types = "std_msgs/msg/Int32, expected std_msgs/msg/Float64"
    health = sources_health({"/age": Standing.STALE}, {}, {"/age": types})
    assert (health.level, health.message) == (Health.ERROR, f"/age is published as {types}")
    assert health.values["/age"] == f"its last reading is stale, published as {types}"
