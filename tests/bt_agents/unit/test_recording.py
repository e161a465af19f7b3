# SPDX-License-Identifier: Apache-2.0
"""What is noted of a run: only news, as long as there is room, and nothing that breaks it."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from bt_agents.engine.environment import GoalState, SkillGoal
from bt_agents.engine.scripted_environment import ScriptedEnvironment, ScriptedReply
from bt_agents.recording.recording_run import RecordingRun
from bt_agents.recording.recording_world import Notebook
from bt_agents.recording.replay_world import Turn, read_record, repeat
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind
from tree_harness import SPACE, Stage


class Recorded(Stage):
    """A stage whose run is recorded."""

    def __init__(self, tree: str, most: int = 10**6, **how: Any) -> None:
        super().__init__(tree, **how)
        self.lines: list[str] = []
        self.run = self.recording = RecordingRun(
            self.spec,
            space=SPACE,
            scene=self.scene,
            profile=self.spec.profile,
            live=lambda: self.live,
            tunables=self.tunables,
            world=self.world,
            steady=self.world.clock,
            seed=1,
            sink=lambda _tick, line: self.lines.append(line),
            most=most,
        )

    @property
    def notes(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.lines[1:]]

    def again(self) -> list[Turn]:
        return list(repeat(read_record(self.lines), self.spec, SPACE))


LONG = {"say": [ScriptedReply(after_s=100.0)]}


def test_a_tick_in_which_nothing_came_in_is_not_noted() -> None:
    stage = Recorded("say: hello", answers=LONG)
    stage.tick()
    before = len(stage.lines)
    stage.tick(1000, 0.05)
    assert len(stage.lines) == before
    stage.after(100.0)
    assert stage.outcome == "succeeded"
    turn = stage.again()[-1]
    assert turn.tick == 1002
    assert turn.result is not None


def test_a_tick_that_only_waits_for_a_time_is_not_noted() -> None:
    stage = Recorded("wait: 50 s")
    stage.tick()
    before = len(stage.lines)
    stage.tick(999, 0.05)
    assert len(stage.lines) == before
    assert stage.after(50.0) == "succeeded"
    assert stage.again()[-1].result == stage.run.result


def test_a_clock_that_goes_back_is_noted_even_if_a_time_has_not_come() -> None:
    stage = Recorded("sequence: [{wait: 1 s}, {wait: 1 s}]")
    stage.tick()
    stage.tick(3, 0.5)
    stage.world.clock.advance(-1.0)
    stage.tick()
    assert stage.notes[-1]["t"] == stage.world.clock()


def test_what_is_asked_for_is_noted_with_its_fields() -> None:
    stage = Recorded("say: hello")
    stage.tick()
    [[kind, name, fields]] = stage.notes[0]["out"]
    assert (kind, name, fields["text"]) == ("action", "say", "hello")


def test_a_record_that_gets_too_long_ends_with_the_reason_and_the_run_goes_on() -> None:
    tree = "sequence: [{wait_for: {topic: t, type: std_msgs/msg/Bool, until: msg.data}}]"
    stage = Recorded(tree, most=1500)
    for _ in range(40):
        stage.world.arrive("t", {"data": False})
        stage.tick()
    assert stage.notes[-1] == {"stopped": "its notes got too long"}
    length = len(stage.lines)
    stage.world.arrive("t", {"data": True})
    assert stage.tick() == "succeeded"
    assert len(stage.lines) == length
    record = read_record(stage.lines)
    assert record.stopped
    assert not record.ended
    assert len(stage.again()) == record.turns


def test_a_value_that_cannot_be_written_down_stops_the_notes_and_not_the_run() -> None:
    stage = Recorded("say: x", answers={"say": [ScriptedReply(result={"extra": object()})]})  # type: ignore[dict-item]
    assert stage.tick() == "succeeded"
    assert "cannot be written down" in stage.notes[-1]["stopped"]


def test_numbers_that_json_does_not_know_come_back() -> None:
    tree = "sequence: [{wait_for: {topic: t, type: std_msgs/msg/Float64, until: msg.data > 1}}]"
    stage = Recorded(tree)
    stage.tick()
    stage.world.arrive("t", {"data": float("nan")})
    stage.world.arrive("t", {"data": float("inf")})
    assert stage.tick() == "succeeded"
    assert [len(turn.changes) for turn in stage.again()] == [2, 2]


def test_a_service_that_is_refused_is_refused_again_with_its_words() -> None:
    stage = Recorded("say: x")

    def refuse(_goal: SkillGoal) -> Any:
        raise Refused("WRONG_TYPE", "'text' is a number")

    stage.world.send = refuse  # type: ignore[method-assign]
    assert stage.tick() == "failed"
    [turn] = stage.again()
    assert turn.changes == stage.changes
    assert turn.noted[0][3] == ["WRONG_TYPE", "'text' is a number"]


def test_an_answer_that_a_cancel_changes_comes_out_with_the_cancel() -> None:
    world = ScriptedEnvironment({"a": [ScriptedReply(after_s=9.0)]})
    notebook = Notebook(world, lambda: pytest.fail("not looked at"), {}, world.clock)
    notebook.begin()
    goal = notebook.send(SkillGoal(kind=BindingKind.ACTION, name="a", type="t", fields={}))
    assert goal.state is GoalState.ACTIVE
    goal.cancel()
    assert goal.state is GoalState.CANCELLED
    assert notebook.end()["goals"] == [
        [0, "state", "ACTIVE", False],
        [0, "state", "CANCELLED", True],
    ]


def test_a_goal_stands_still_during_a_turn() -> None:
    world = ScriptedEnvironment({"a": [ScriptedReply(after_s=1.0)]})
    notebook = Notebook(world, lambda: pytest.fail("not looked at"), {}, world.clock)
    notebook.begin()
    goal = notebook.send(SkillGoal(kind=BindingKind.ACTION, name="a", type="t", fields={}))
    before = notebook.clock(), goal.state
    world.clock.advance(5.0)
    assert (notebook.clock(), goal.state) == before
    notebook.end()
    notebook.begin()
    assert (notebook.clock(), goal.state) == (5.0, GoalState.SUCCEEDED)


HEAD = json.dumps({"format": 1})


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "it is empty"),
        (["{"], "a line is no JSON"),
        (["[1]"], "a line holds a list, expected a mapping"),
        (['{"format": 2}'], "it begins with the form 2, expected 1"),
        (['{"turn": 1}'], "it begins with the form None, expected 1"),
        ([HEAD, "{}"], "a note has the turn None"),
        (
            [HEAD, '{"turn": 2, "quiet": 1}', '{"turn": 1}'],
            "a note has the turn 1, expected a later one",
        ),
        ([HEAD, '{"turn": 2, "quiet": "1"}'], "turn 2 comes after '1' quiet ones"),
        ([HEAD, '{"turn": 99999999999}'], "a note has the turn 99999999999"),
        ([HEAD, "[" * 100_000], "a line is no JSON"),
    ],
    ids=str,
)
def test_a_record_that_is_none_is_refused_in_words(lines: list[str], words: str) -> None:
    with pytest.raises(Refused) as refused:
        read_record(lines)
    assert words in refused.value.reason


BROKEN: dict[str, Callable[[dict[str, Any], list[dict[str, Any]]], Any]] = {
    "parameters": lambda head, notes: head.update(parameters=["x"]),
    "scene": lambda head, notes: head.update(scene=5),
    "profile": lambda head, notes: head.update(profile=None),
    "goals": lambda head, notes: notes[0].update(goals=[[0, "colour", 1, False]]),
    "state": lambda head, notes: notes[0].update(goals=[[0, "state", "FINE", False]]),
    "clock": lambda head, notes: notes[0].update(t="noon"),
    "do": lambda head, notes: notes[0].update(do=[["cancel"]]),
    "live": lambda head, notes: notes[0].update(live={"colour": 1}),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_record_with_a_broken_note_is_refused_in_words(what: str) -> None:
    stage = Recorded("say: hello")
    stage.tick()
    head, *notes = map(json.loads, stage.lines)
    BROKEN[what](head, notes)
    lines = [json.dumps(note) for note in (head, *notes)]
    with pytest.raises(Refused, match="the record of a run cannot be repeated"):
        list(repeat(read_record(lines), stage.spec, SPACE))
