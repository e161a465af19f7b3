# SPDX-License-Identifier: Apache-2.0
"""Scenes reach a market that is away, just starting, or dying, and then are sent no more."""

from __future__ import annotations

import pytest

from bt_agents_core.scene import Scene
from scene_layer.scene_delivery import KEPT_S, MOST_KEPT, SceneDelivery


class Driver:
    """A delivery with a clock turned by hand, and a market that may be dead."""

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

    def wait(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds * 10))):
            self.now += 0.1
            if self.epoch:
                self.delivery.heartbeat(self.epoch, self.now)
            due = self.delivery.due(self.now, listens=self.listens)
            self.sent += [one.scene_id for one in due]

    def given_up(self) -> list[str]:
        return [one.scene_id for one in self.delivery.given_up(self.now)]


def test_a_scene_for_a_market_that_lives_on_is_sent_once() -> None:
    layer = Driver("e1")
    assert layer.announce() is False
    layer.wait(5.0)

    assert layer.sent == []
    assert not layer.delivery.pending


def test_without_a_market_scenes_are_kept_and_sent_in_order_when_there_is_one() -> None:
    layer = Driver()
    assert layer.announce("s1")
    assert layer.announce("s2")
    layer.wait(5.0)
    assert layer.sent == []
    layer.epoch = "e1"
    layer.wait(0.2)

    assert layer.sent == ["s1", "s2"]


def test_a_market_that_is_not_matched_yet_is_sent_nothing() -> None:
    layer = Driver("e1")
    layer.listens = False
    assert layer.announce()
    layer.wait(3.0)
    assert layer.sent == []
    layer.listens = True
    layer.wait(0.2)

    assert layer.sent == ["s1"]


@pytest.mark.parametrize("shown", ["s1", "a child"])
def test_what_a_market_shows_to_have_is_sent_no_more(shown: str) -> None:
    layer = Driver()
    layer.announce("s1", "a child")
    layer.epoch = "e1"
    layer.wait(0.2)
    layer.delivery.shown({shown, "another"})
    layer.wait(5.0)

    assert layer.sent == ["s1"]
    assert not layer.delivery.pending


def test_a_market_that_shows_nothing_is_sent_a_kept_scene_once_more() -> None:
    layer = Driver()
    layer.announce()
    layer.epoch = "e1"
    layer.wait(10.0)

    assert layer.sent == ["s1", "s1"]
    assert not layer.delivery.pending


def test_a_scene_whose_market_dies_at_once_goes_to_the_next_one() -> None:
    layer = Driver("e1")
    assert layer.announce() is False
    layer.epoch = ""
    layer.wait(3.0)
    assert layer.sent == []
    layer.epoch = "e2"
    layer.wait(0.2)
    layer.delivery.shown({"s1"})
    layer.wait(5.0)

    assert layer.sent == ["s1"]


def test_a_label_that_another_market_has_shown_says_nothing() -> None:
    layer = Driver("e1")
    layer.announce("s1", "a child")
    layer.epoch = ""
    layer.wait(2.0)
    layer.delivery.heartbeat("e2", layer.now)
    layer.delivery.shown({"a child"})

    assert layer.delivery.pending


def test_of_more_scenes_than_can_be_kept_the_oldest_is_given_up() -> None:
    layer = Driver()
    for number in range(MOST_KEPT + 2):
        layer.announce(f"s{number}")

    assert layer.given_up() == ["s0", "s1"]
    assert layer.given_up() == []


def test_a_scene_is_given_up_once_when_no_market_comes() -> None:
    layer = Driver()
    layer.announce()
    layer.now += KEPT_S - 0.1
    assert layer.given_up() == []
    layer.now += 0.2

    assert layer.given_up() == ["s1"]
    assert not layer.delivery.pending
