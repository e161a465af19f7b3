# SPDX-License-Identifier: Apache-2.0
"""Scene delivery to a market that is away, starting or dying: resent until accepted."""

from __future__ import annotations

import pytest

from bt_agents_core.scene import Scene
from scene_layer.scene_delivery import KEPT_S, MOST_KEPT, SceneDelivery


class DeliveryHarness:
    """A delivery on a manual clock, and a market that may be dead."""

    def __init__(self, epoch: str = "") -> None:
        self.delivery = SceneDelivery()
        self.now = 100.0
        self.epoch = epoch
        self.listens = True
        self.sent: list[str] = []
        self.wait(0.0)

    def announce(self, scene_id: str = "s1", label: str = "") -> bool:
        scene = Scene(scene_id=scene_id, label=label, person=True, values=())
        return self.delivery.announce(scene, self.now, listens=self.listens)

    def wait(self, seconds: float) -> list[str]:
        """Let time pass; return all scenes sent so far."""
        for _ in range(max(1, round(seconds * 10))):
            self.now += 0.1
            if self.epoch:
                self.delivery.heartbeat(self.epoch, self.now)
            due = self.delivery.due(self.now, listens=self.listens)
            self.sent += [one.scene_id for one in due]
        return self.sent

    def given_up(self) -> list[str]:
        return [one.scene_id for one in self.delivery.given_up(self.now)]


@pytest.fixture
def layer() -> DeliveryHarness:
    return DeliveryHarness()


def test_scene_for_a_live_market_is_sent_once() -> None:
    layer = DeliveryHarness("e1")
    assert layer.announce() is False
    assert layer.wait(5.0) == []
    assert not layer.delivery.pending


def test_scenes_without_market_are_queued_in_order(layer: DeliveryHarness) -> None:
    assert layer.announce("s1")
    assert layer.announce("s2")
    assert layer.wait(5.0) == []
    layer.epoch = "e1"
    assert layer.wait(0.2) == ["s1", "s2"]


def test_unmatched_market_is_sent_nothing() -> None:
    layer = DeliveryHarness("e1")
    layer.listens = False
    assert layer.announce()
    assert layer.wait(3.0) == []
    layer.listens = True
    assert layer.wait(0.2) == ["s1"]


@pytest.mark.parametrize("shown", ["s1", "a child"])
def test_scene_acknowledged_by_market_is_not_sent_again(
    layer: DeliveryHarness, shown: str
) -> None:
    layer.announce("s1", "a child")
    layer.epoch = "e1"
    layer.wait(0.2)
    layer.delivery.shown({shown, "another"})

    assert layer.wait(5.0) == ["s1"]
    assert not layer.delivery.pending


def test_unacknowledged_queued_scene_is_sent_once_more(layer: DeliveryHarness) -> None:
    layer.announce()
    layer.epoch = "e1"

    assert layer.wait(10.0) == ["s1", "s1"]
    assert not layer.delivery.pending


def test_scene_of_crashed_market_goes_to_next_one() -> None:
    layer = DeliveryHarness("e1")
    layer.announce("s1", "a child")
    layer.epoch = ""
    assert layer.wait(3.0) == []
    layer.epoch = "e2"
    layer.delivery.heartbeat("e2", layer.now)
    layer.delivery.shown({"a child"})
    assert layer.delivery.pending, "another market may show this label"
    layer.wait(0.2)
    layer.delivery.shown({"s1"})

    assert layer.wait(5.0) == ["s1"]


def test_full_queue_drops_the_oldest_scene(layer: DeliveryHarness) -> None:
    for number in range(MOST_KEPT + 2):
        layer.announce(f"s{number}")

    assert [layer.given_up(), layer.given_up()] == [["s0", "s1"], []]


def test_scene_is_dropped_once_when_no_market_comes(layer: DeliveryHarness) -> None:
    layer.announce()
    layer.now += KEPT_S - 0.1
    assert layer.given_up() == []
    layer.now += 0.2

    assert layer.given_up() == ["s1"]
    assert not layer.delivery.pending
