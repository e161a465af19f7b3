# SPDX-License-Identifier: Apache-2.0
"""Health of the market: unreachable hosts, and scenes that wait for them."""

from __future__ import annotations

from bt_agents_core.health import Health
from marketplace_node.health import hosts_health, queue_health


def test_market_without_hosts_warns():
    health = hosts_health({}, {})
    assert (health.part, health.level) == ("hosts", Health.WARN)
    assert health.message == "no host has registered, so nobody bids"


def test_reachable_hosts_are_counted_with_agents():
    health = hosts_health({"/agents": 9, "/others": 5}, {})
    assert (health.level, health.message) == (Health.OK, "hosts: 2, agents: 14")
    assert health.values == {"/agents": "9 agents", "/others": "5 agents"}


def test_silent_host_is_an_error_with_reason():
    health = hosts_health({"/agents": 9, "/others": 5}, {"/others": "it has no heartbeat"})
    assert health.level is Health.ERROR
    assert health.message == "1 of 2 hosts cannot be asked: /others (it has no heartbeat)"
    assert health.values == {"/agents": "9 agents", "/others": "it has no heartbeat"}


def test_queued_scenes_warn_only_when_awaiting_host():
    assert queue_health(3, ()).level is Health.OK
    waiting = queue_health(2, ["/agents"])
    assert (waiting.level, waiting.message) == (Health.WARN, "scenes in line: 2, for /agents")
