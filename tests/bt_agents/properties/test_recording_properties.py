# SPDX-License-Identifier: Apache-2.0
"""Laws of recording: whatever a tree is made of, its recording alone repeats it step by step."""

from __future__ import annotations

import json
from dataclasses import replace
from random import Random
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents.engine.environment import GIVE_FEEDBACK, GoalState
from bt_agents.engine.run import Run, StatusChange
from bt_agents.engine.scripted_environment import ManualClock, ScriptedEnvironment, ScriptedReply
from bt_agents.recording.format import read_recording
from bt_agents.recording.recorded_run import RecordingRun, replay
from bt_agents_language.model.specs import NodeSpec
from random_trees import ACTIONS, Puppet, placed, trees
from tree_harness import SPACE, Stage, agent, scene

HEAD = """
tunables:
  rest: {default: 1 s, min: 0 s, max: 60 s, description: d}
  times: {default: 2, min: 1, max: 9, description: d}
"""

answers = st.builds(
    ScriptedReply,
    state=st.sampled_from([s for s in GoalState if s.ended]),
    result=st.sampled_from([{}, {"word": "a"}, {"word": 5}]),
    message=st.sampled_from(["", "no time"]),
    accept_s=st.sampled_from([0.0, 0.5]),
    after_s=st.sampled_from([0.0, 1.0, 4.0]),
    cancel_s=st.sampled_from([0.0, 1.0, float("inf")]),
    feedback=st.sampled_from(
        [(), ((0.0, {"word": "b"}), (0.6, {"word": "a"}), (0.7, {"word": "a"}))]
    ),
)
scripts = st.fixed_dictionaries(
    {name: st.lists(answers, min_size=1, max_size=3) for name in (*ACTIONS, GIVE_FEEDBACK)}
)
events = st.one_of(
    st.tuples(st.just("pass"), st.sampled_from([0.0, 0.5, 1.0, 5.0])),
    st.tuples(st.sampled_from(["mood", "age"]), st.sampled_from([0.0, 1.0, 3.0])),
    st.tuples(st.just("stale"), st.sampled_from([0.0, 1.5])),
    st.tuples(st.just("arrive"), st.sampled_from([{"data": 2, "word": "a"}, {"data": 0}, {}])),
    st.tuples(st.sampled_from(["rest", "times"]), st.sampled_from([0.0, 1, 2, float("nan")])),
    st.tuples(st.just("cancel"), st.booleans()),
    st.tuples(st.just("hurry"), st.sampled_from([0.0, 0.5])),
)
stories = st.lists(events, max_size=14)


class CreepingClock(ManualClock):
    """A clock that goes on at each look, so that nothing is hidden by its standing still."""

    def __call__(self) -> float:
        self.now += 0.013
        return self.now


class Recorded(Stage):
    """A stage whose run is recorded on a clock that never stands still."""

    def __init__(
        self,
        tree: NodeSpec,
        script: dict[str, list[ScriptedReply]],
        seed: int,
        clock: ManualClock | None = None,
    ) -> None:
        Puppet.alive = set()
        Puppet.set_up = set()
        super().__init__("wait: 0 s", head=HEAD + "on_cancel: {wait: 1 s}\n")
        self.spec = replace(agent("wait: 0 s", HEAD), tree=tree)
        self.spec = replace(self.spec, on_cancel=placed(tree, "on_cancel"))
        self.environment = ScriptedEnvironment(script, clock or CreepingClock())
        self.scene = self.live = scene(mood=3)
        self.lines: list[str] = []
        self.steps: list[tuple[int, list[StatusChange]]] = []
        self.run: Run = RecordingRun(
            self.spec,
            space=SPACE,
            scene=self.scene,
            profile=self.spec.profile,
            live=lambda: self.live,
            tunables=self.tunables,
            environment=self.environment,
            steady=self.environment.clock,
            seed=seed,
            sink=lambda _tick, line: self.lines.append(line),
        )

    def play(self, story: list[tuple[str, object]]) -> None:
        """Tick once, and after each event again; then wait for the end."""
        self.step()
        for event, value in story:
            if self.run.result is not None:
                return
            self.step(event, value)

    def step(self, event: str = "", value: object = None) -> None:
        """Let something happen and tick."""
        changes: list[StatusChange] = []
        match event, value:
            case "pass", float(duration):
                self.environment.clock.advance(duration)
            case "mood" | "age", float(value):
                self.set_live(event, value)
            case "stale", float(seconds):
                self.live = replace(self.live, stale_s=seconds)
            case "arrive", dict(message):
                self.environment.arrive("t", message)
            case "rest" | "times", _:
                self.tunables[event] = value  # type: ignore[assignment]
            case "cancel", bool(clean_up):
                changes += self.run.cancel("enough", clean_up=clean_up)
            case "hurry", float(seconds):
                self.run.shorten_settling(seconds)
        changes += self.run.tick()
        self.steps.append((self.run.ticks, changes))


@settings(max_examples=400, deadline=None, derandomize=True)
@given(trees, scripts, stories, st.integers(0, 2**53))
def test_the_recording_of_a_run_repeats_each_step_of_it(
    tree: NodeSpec,
    script: dict[str, list[ScriptedReply]],
    story: list[tuple[str, object]],
    seed: int,
) -> None:
    stage = Recorded(tree, script, seed)
    stage.play(story)
    made = len(Puppet.set_up)
    again = list(replay(read_recording(stage.lines), stage.spec, SPACE))
    # Steps after the last news have no entry, and nothing happened in them.
    played = stage.steps[: len(again)]
    assert [(step.tick, step.changes) for step in again] == played
    for step in again:
        assert _plain(step.requests) == _plain(step.recorded_requests)
    if stage.run.result is not None:
        assert len(again) == len(stage.steps)
        assert again[-1].result == replace(stage.run.result, overruns=again[-1].result.overruns)  # type: ignore[union-attr]
    # Behaviours of packages are not made again.
    assert len(Puppet.set_up) == made


@settings(max_examples=100, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_a_run_goes_the_same_way_recorded_or_not(
    tree: NodeSpec, script: dict[str, list[ScriptedReply]], story: list[tuple[str, object]]
) -> None:
    recorded = Recorded(tree, script, 1, ManualClock())
    recorded.play(story)
    plain = Recorded(tree, script, 1, ManualClock())
    plain.run = Run(
        plain.spec,
        space=SPACE,
        scene=plain.scene,
        profile=plain.spec.profile,
        live=lambda: plain.live,
        tunables=plain.tunables,
        environment=plain.environment,
        steady=plain.environment.clock,
        random=Random(1),
    )
    plain.play(story)
    assert recorded.steps == plain.steps
    assert recorded.run.result == plain.run.result
    assert recorded.asked == plain.asked


@settings(max_examples=60, deadline=None, derandomize=True)
@given(trees, scripts, stories, st.integers(0, 400))
def test_whatever_is_cut_from_a_recording_its_replay_ends(
    tree: NodeSpec,
    script: dict[str, list[ScriptedReply]],
    story: list[tuple[str, object]],
    cut: int,
) -> None:
    stage = Recorded(tree, script, 1)
    stage.play(story)
    lines = stage.lines[: max(1, len(stage.lines) - cut % 7)]
    again = list(replay(read_recording(lines), stage.spec, SPACE))
    played = stage.steps[: len(again)]
    assert [(step.tick, step.changes) for step in again] == played


def _plain(requests: list[Any]) -> str:
    return json.dumps(requests, sort_keys=True, default=list)
