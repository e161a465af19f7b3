# SPDX-License-Identifier: Apache-2.0
"""Recordings: only news, as long as there is room, and nothing that breaks the run."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import py_trees
import pytest
from py_trees.common import Status

from bt_agents.engine.environment import GoalState, SkillGoal
from bt_agents.engine.scripted_environment import ScriptedEnvironment, ScriptedReply
from bt_agents.recording.format import read_recording
from bt_agents.recording.recorded_environment import RecordingEnvironment
from bt_agents.recording.recorded_run import RecordingRun, ReplayedStep, replay
from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind
from bt_agents_core.stop_cause import Cancellation
from bt_agents_language.model.specs import NodeSpec, Reference, Text
from tree_harness import SPACE, Stage


class Recorded(Stage):
    """A stage whose run is recorded."""

    def __init__(self, tree: str | NodeSpec, most: int = 10**6, **how: Any) -> None:
        super().__init__(tree, **how)
        self.lines: list[str] = []
        self.run = self.recording = RecordingRun(
            self.spec,
            space=SPACE,
            scene=self.scene,
            profile=self.spec.profile,
            live=lambda: self.live,
            tunables=self.tunables,
            environment=self.environment,
            steady=self.environment.clock,
            seed=1,
            sink=lambda _tick, line: self.lines.append(line),
            most=most,
        )

    @property
    def entries(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.lines[1:]]

    def again(self) -> list[ReplayedStep]:
        return list(replay(read_recording(self.lines), self.spec, SPACE))


LONG = {"say": [ScriptedReply(after_s=100.0)]}


def test_a_tick_in_which_nothing_came_in_is_not_recorded() -> None:
    stage = Recorded("say: hello", answers=LONG)
    stage.tick()
    before = len(stage.lines)
    stage.tick(1000, 0.05)
    assert len(stage.lines) == before
    stage.after(100.0)
    assert stage.outcome == "succeeded"
    step = stage.again()[-1]
    assert step.tick == 1002
    assert step.result is not None


def test_a_tick_that_only_waits_for_a_time_is_not_recorded() -> None:
    stage = Recorded("wait: 50 s")
    stage.tick()
    before = len(stage.lines)
    stage.tick(999, 0.05)
    assert len(stage.lines) == before
    assert stage.after(50.0) == "succeeded"
    assert stage.again()[-1].result == stage.run.result


def test_a_clock_that_goes_back_is_recorded_even_if_a_time_has_not_come() -> None:
    stage = Recorded("sequence: [{wait: 1 s}, {wait: 1 s}]")
    stage.tick()
    stage.tick(3, 0.5)
    stage.environment.clock.advance(-1.0)
    stage.tick()
    assert stage.entries[-1]["t"] == stage.environment.clock()


def test_what_is_asked_for_is_recorded_with_its_fields() -> None:
    stage = Recorded("say: hello")
    stage.tick()
    [request] = stage.entries[0]["requests"]
    assert (request["kind"], request["name"]) == ("action", "say")
    assert request["fields"]["text"] == "hello"


def test_a_record_that_gets_too_long_ends_with_the_reason_and_the_run_goes_on() -> None:
    tree = "sequence: [{wait_for: {topic: t, type: std_msgs/msg/Bool, until: msg.data}}]"
    stage = Recorded(tree, most=1500)
    for _ in range(40):
        stage.environment.arrive("t", {"data": False})
        stage.tick()
    assert stage.entries[-1] == {"stopped": "the recording got too long"}
    length = len(stage.lines)
    stage.environment.arrive("t", {"data": True})
    assert stage.tick() == "succeeded"
    assert len(stage.lines) == length
    recording = read_recording(stage.lines)
    assert recording.stopped
    assert not recording.complete
    assert len(stage.again()) == recording.steps


def test_a_value_that_cannot_be_written_down_stops_the_recording_and_not_the_run() -> None:
    stage = Recorded("say: x", answers={"say": [ScriptedReply(result={"extra": object()})]})  # type: ignore[dict-item]
    assert stage.tick() == "succeeded"
    assert "cannot be written down" in stage.entries[-1]["stopped"]


def test_numbers_that_json_does_not_know_come_back() -> None:
    tree = "sequence: [{wait_for: {topic: t, type: std_msgs/msg/Float64, until: msg.data > 1}}]"
    stage = Recorded(tree)
    stage.tick()
    stage.environment.arrive("t", {"data": float("nan")})
    stage.environment.arrive("t", {"data": float("inf")})
    assert stage.tick() == "succeeded"
    assert [len(step.changes) for step in stage.again()] == [2, 2]


def test_a_service_that_is_refused_is_refused_again_with_its_words() -> None:
    stage = Recorded("say: x")

    def refuse(_goal: SkillGoal) -> Any:
        raise Refused("WRONG_TYPE", "'text' is a number")

    stage.environment.send = refuse  # type: ignore[method-assign]
    assert stage.tick() == "failed"
    [step] = stage.again()
    assert step.changes == stage.changes
    [request] = step.recorded_requests
    assert request["error"] == {"code": "WRONG_TYPE", "reason": "'text' is a number"}


def test_an_answer_that_a_cancel_changes_comes_out_with_the_cancel() -> None:
    scripted = ScriptedEnvironment({"a": [ScriptedReply(after_s=9.0)]})
    environment = RecordingEnvironment(
        scripted, lambda: pytest.fail("not read"), {}, scripted.clock
    )
    goal = environment.send(SkillGoal(kind=BindingKind.ACTION, name="a", type="t", fields={}))
    assert goal.state is GoalState.ACTIVE
    goal.cancel()
    assert goal.state is GoalState.CANCELLED
    assert environment.steps.end()["goals"] == [
        {"goal": 0, "field": "state", "value": "ACTIVE"},
        {"goal": 0, "field": "state", "value": "CANCELLED", "after_cancel": True},
    ]


def test_a_goal_stands_still_during_a_step() -> None:
    scripted = ScriptedEnvironment({"a": [ScriptedReply(after_s=1.0)]})
    environment = RecordingEnvironment(
        scripted, lambda: pytest.fail("not read"), {}, scripted.clock
    )
    goal = environment.send(SkillGoal(kind=BindingKind.ACTION, name="a", type="t", fields={}))
    before = environment.clock(), goal.state
    scripted.clock.advance(5.0)
    assert (environment.clock(), goal.state) == before
    environment.steps.end()
    assert (environment.clock(), goal.state) == (5.0, GoalState.SUCCEEDED)


def test_who_stopped_a_run_and_when_that_was_known_come_back() -> None:
    head = "on_cancel: {say: '${cancel.by}: ${cancel.reason}'}"
    stage = Recorded("say: hello", head=head, answers=LONG)
    stage.tick()
    stage.run.cancel("enough")
    stage.after(0.05)
    stage.run.cancel("enough", cancellation=Cancellation(by="operator", reason="late"))
    stage.tick()
    stage.after(3.0)
    assert stage.said == ["hello", "operator: late"]
    steps = stage.again()
    assert [step.requests for step in steps] == [step.recorded_requests for step in steps]
    assert any("operator: late" in str(step.requests) for step in steps)
    last = steps[-1]
    assert (last.recorded_end, last.result) == (
        {**asdict(stage.run.result), "outcome": "cancelled", "orphans": []},
        stage.run.result,
    )


HEAD = json.dumps({"format": 2})


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "it is empty"),
        (["{"], "a line is no JSON"),
        (["[1]"], "a line holds a list, expected a mapping"),
        (['{"format": 3}'], "it begins with the format 3, expected 2"),
        (['{"step": 1}'], "it begins with the format None, expected 2"),
        ([HEAD, "{}"], "an entry has the step None"),
        (
            [HEAD, '{"step": 2, "quiet": 1}', '{"step": 1}'],
            "an entry has the step 1, expected a later one",
        ),
        ([HEAD, '{"step": 2, "quiet": "1"}'], "step 2 comes after '1' quiet ones"),
        ([HEAD, '{"step": 99999999999}'], "an entry has the step 99999999999"),
        ([HEAD, "[" * 100_000], "a line is no JSON"),
    ],
    ids=str,
)
def test_a_record_that_is_none_is_refused_in_words(lines: list[str], words: str) -> None:
    with pytest.raises(Refused) as refused:
        read_recording(lines)
    assert words in refused.value.reason


BROKEN: dict[str, Callable[[dict[str, Any], list[dict[str, Any]]], Any]] = {
    "parameters": lambda head, entries: head.update(parameters=["x"]),
    "scene": lambda head, entries: head.update(scene=5),
    "profile": lambda head, entries: head.update(profile=None),
    "goals": lambda head, entries: entries[0].update(
        goals=[{"goal": 0, "field": "colour", "value": 1}]
    ),
    "state": lambda head, entries: entries[0].update(
        goals=[{"goal": 0, "field": "state", "value": "FINE"}]
    ),
    "clock": lambda head, entries: entries[0].update(t="noon"),
    "calls": lambda head, entries: entries[0].update(calls=[{"call": "cancel"}]),
    "live": lambda head, entries: entries[0].update(live={"colour": 1}),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_record_with_a_broken_entry_is_refused_in_words(what: str) -> None:
    stage = Recorded("say: hello")
    stage.tick()
    head, *entries = map(json.loads, stage.lines)
    BROKEN[what](head, entries)
    lines = [json.dumps(entry) for entry in (head, *entries)]
    with pytest.raises(Refused, match="the recording of a run cannot be replayed"):
        list(replay(read_recording(lines), stage.spec, SPACE))


def test_the_local_time_is_recorded_when_it_changes() -> None:
    stage = Recorded("wait_for: clock.hour == 14")
    stage.tick()
    stage.tick(10, 60.0)
    assert [one["clock"]["hour"] for one in stage.entries if "clock" in one] == [12]
    assert stage.after(3600.0) == "running"
    assert stage.after(3600.0) == "succeeded"
    assert [one["clock"]["hour"] for one in stage.entries if "clock" in one] == [12, 13, 14]
    step = stage.again()[-1]
    assert step.result is not None
    assert step.result.outcome.value == "succeeded"


class Sender(py_trees.behaviour.Behaviour):
    """Gives a name a value, and has a goal that goes on for a while after its end."""

    def update(self) -> Status:
        py_trees.blackboard.Blackboard.set("answer", {"text": "yes"})
        return Status.SUCCESS


class OneGoal:
    """A node for a plug-in with one goal."""

    node = None

    def __init__(self) -> None:
        self.open = 1
        self.closed = False

    def open_goals(self) -> int:
        return self.open

    def lost(self) -> str:
        return ""

    def settle(self) -> None:
        pass

    def plain(self, value: object) -> Any:
        return value

    def close(self) -> None:
        self.closed = True


def test_goals_and_names_of_a_plug_in_are_replayed_without_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    position = Position(file="a.yaml", line=7, column=3)
    sender = NodeSpec(
        path="tree/0.sender",
        position=position,
        kind="sender",
        name="sender",
        outputs={"answer": "answer"},
        plugin=Sender,
    )
    line = Text(parts=("the answer is ", Reference(name="answer")))
    log = NodeSpec(
        path="tree/1.log", position=position, kind="log", name="log", fields={"message": line}
    )
    stage = Recorded(
        NodeSpec(
            path="tree", position=position, kind="sequence", name="both", children=(sender, log)
        )
    )
    node = OneGoal()
    monkeypatch.setattr(stage.environment, "open_plugin_node", lambda _path: node)
    assert stage.tick() == "running"
    assert stage.after(0.5) == "running"
    node.open = 0
    assert stage.after(0.1) == "succeeded"
    assert node.closed
    assert stage.environment.logged == [("info", "the answer is {'text': 'yes'}")]
    again = stage.again()
    assert again[-1].tick == stage.run.ticks
    assert again[-1].result == stage.run.result
