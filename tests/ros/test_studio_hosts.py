# SPDX-License-Identifier: Apache-2.0
"""Hosts in a studio: those with a heartbeat, for as long as it lasts."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Heartbeat, HostCard
from bt_agents_ros import qos
from bt_agents_studio import node as studio_node
from bt_agents_studio.node import StudioNode
from graph import Ros


class Hosts:
    """Hosts of a probe, and a studio that may watch them."""

    def __init__(self, ros: Ros) -> None:
        self.ros = ros
        self.studio = ros.add(StudioNode(*[lambda *_values: None] * 4))
        self._cards = ros.node.create_publisher(HostCard, "bt_agents/cards", qos.FACTS)
        ros.until(lambda: self._cards.get_subscription_count() == 1)

    def begin(self, host: str) -> Any:
        """Create a host, and return its heartbeat publisher."""
        beats = self.ros.node.create_publisher(Heartbeat, f"{host}/heartbeat", qos.EVENTS)
        self.ros.until(lambda: self.studio.count_publishers(f"{host}/heartbeat"))
        self.introduce(host)
        return beats

    def introduce(self, *hosts: str) -> None:
        for host in hosts:
            self._cards.publish(HostCard(host=host))

    def is_watched(self, host: str) -> bool:
        return bool(self.ros.node.count_subscribers(f"{host}/trees"))


def test_cards_without_heartbeat_do_not_displace_hosts(ros: Ros) -> None:
    hosts = Hosts(ros)
    forged = [f"/forged{number}" for number in range(studio_node.MOST_HOSTS)]
    hosts.introduce(*forged)
    hosts.begin("/real")
    ros.until(lambda: hosts.is_watched("/real"))
    assert not any(map(hosts.is_watched, forged))


def test_host_without_heartbeat_is_removed_until_it_returns(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The service never appears: the removal of the host must end the call, not a time limit.
    monkeypatch.setattr(studio_node, "_DISCOVERY_S", 300.0)
    hosts = Hosts(ros)
    beats = hosts.begin("/real")
    ros.until(lambda: hosts.is_watched("/real"))
    answer = hosts.studio.call("/real/tune", {}, 300.0)
    ros.until(lambda: ros.node.count_clients("/real/tune"))
    ros.node.destroy_publisher(beats)
    ros.until(lambda: not hosts.is_watched("/real"))
    ros.until(lambda: not ros.node.count_clients("/real/tune"))
    with pytest.raises(Refused, match="/real is gone"):
        answer.result(0)
    ros.node.create_publisher(Heartbeat, "/real/heartbeat", qos.EVENTS)
    ros.until(lambda: hosts.is_watched("/real"))


def test_a_silent_host_gives_its_place_to_another(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(studio_node, "MOST_HOSTS", 2)
    monkeypatch.setattr(studio_node, "SILENT_S", 2.0)
    hosts = Hosts(ros)
    hosts.begin("/silent")
    beating = [hosts.begin("/first")]
    for host in ("/silent", "/first"):
        ros.until(lambda one=host: hosts.is_watched(one))
    beating.append(hosts.begin("/second"))

    def is_second_watched() -> bool:
        for beats in beating:
            beats.publish(Heartbeat())
        return hosts.is_watched("/second")

    ros.until(is_second_watched)
    ros.until(lambda: not hosts.is_watched("/silent"))
    assert hosts.is_watched("/first")
