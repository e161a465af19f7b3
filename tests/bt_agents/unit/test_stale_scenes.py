# SPDX-License-Identifier: Apache-2.0
"""Validity of the live scene, and the behaviour of trees with a stale one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.host.run_monitors import LiveSceneView
from bt_agents_core.liveness import LIVE_LEASE_S
from bt_agents_core.scene import Scene
from tree_harness import TreeHarness, scene

AWARDED = scene(mood=3)


class Story:
    """A run's live scene on a manual clock."""

    def __init__(self, lease_s: float = LIVE_LEASE_S) -> None:
        self.now = 7.0
        self.view = LiveSceneView(AWARDED, lambda: self.now, lease_s)

    def at(self, moment: float) -> Scene:
        """Return the scene some seconds after the start."""
        self.now = 7.0 + moment
        return self.view.now()

    def receive(self, moment: float, live: Scene) -> None:
        """Receive a live scene."""
        self.now = 7.0 + moment
        self.view.receive(live)


@pytest.mark.parametrize(
    ("moment", "stale_s"), [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.25, 1.25), (60.0, 60.0)]
)
def test_awarded_scene_is_fresh_for_the_lease(moment, stale_s):
    assert Story().at(moment) == replace(AWARDED, stale_s=stale_s)


@pytest.mark.parametrize(
    ("lease_s", "moment", "stale_s"),
    [(1.0, 5.5, 0.0), (1.0, 6.0, 0.0), (1.0, 6.5, 1.5), (2.0, 6.5, 0.0), (0.25, 5.5, 0.5)],
)
def test_each_live_scene_renews_the_lease(lease_s, moment, stale_s):
    story = Story(lease_s)
    live = scene(mood=1)
    story.receive(5.0, live)
    assert story.at(moment) == replace(live, stale_s=stale_s)


def test_live_scene_ends_a_silence():
    story = Story()
    assert story.at(1.5) == replace(AWARDED, stale_s=1.5)
    story.receive(9.0, scene(mood=2))
    assert story.at(9.5) == scene(mood=2)
    assert story.at(11.0).stale_s
    story.view.lease_s = 3.0
    assert not story.at(11.0).stale_s, "a tuned lease applies at once"


# --- stale scenes in trees ----------------------------------------------------------------

SILENT = "is stale: the scene layer has been silent for 2.3 s"


def silenced(tree: str, stale_s: float = 2.3) -> TreeHarness:
    harness = TreeHarness(tree)
    harness.live = replace(harness.live, stale_s=stale_s)
    return harness


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ("check: live.mood >= 1", f"'live.mood' {SILENT}"),
        ("check: live.person", f"'live.person' {SILENT}"),
        ("check: not live.person", f"'live.person' {SILENT}"),
        ("check: mood.change >= -9", f"'mood.change' {SILENT}"),
        ("check: scene.mood == 3 and live.mood == 3", f"'live.mood' {SILENT}"),
        ("check: not live.stale and live.mood > 3", "live.mood is stale"),
        ("log: the mood is ${live.mood}", f"'live.mood' {SILENT}"),
    ],
)
def test_node_with_stale_value_fails_with_reason(tree, words):
    harness = silenced(tree)
    assert harness.tick() == "failed"
    assert words in harness.message


@pytest.mark.parametrize(
    ("condition", "stale_s"),
    [
        ("scene.mood == 3", 2.3),
        ("live.stale", 2.3),
        ("live.stale or not live.person", 2.3),
        ("profile.age >= 1", 2.3),
        ("not live.stale and live.mood == 3", 0.0),
    ],
)
def test_condition_without_stale_values_is_decided_as_usual(condition, stale_s):
    assert silenced(f"check: {condition}", stale_s).tick() == "succeeded"


def test_node_with_stale_condition_is_skipped():
    harness = silenced("{when: live.mood >= 1, wait: 1 s}")
    assert harness.tick() == "succeeded"
    assert f"left out: 'live.mood' {SILENT}" in [one.message for one in harness.changes]


def test_while_ends_its_node_once_value_is_stale():
    harness = TreeHarness("{while: live.person, wait: 10 s}")
    assert harness.tick() == "running"
    harness.live = replace(harness.live, stale_s=2.3)
    assert harness.after(1.0) == "failed"
    assert f"'live.person' {SILENT}" in harness.message


def test_wait_reports_staleness_once_and_resumes_with_updates():
    harness = TreeHarness("wait_for: {condition: live.mood >= 3, for: 2 s}")
    harness.tick()
    for silent_s in (1.1, 1.2, 1.3):
        harness.live = replace(harness.live, stale_s=silent_s)
        assert harness.after(0.1) == "running"
    told = [message for _, message in harness.reports("tree") if "stale" in message]
    assert told == ["'live.mood' is stale: the scene layer has been silent for 1.1 s"]
    harness.live = replace(harness.live, stale_s=0.0)
    assert harness.after(0.1) == "running"
    assert harness.after(1.9) == "running"
    assert harness.after(0.1) == "succeeded"
