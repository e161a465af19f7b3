# SPDX-License-Identifier: Apache-2.0
"""Rehearsals of imported trees: skills in the same order as in BehaviorTree.CPP and Nav2."""

from __future__ import annotations

import pytest

from bt_agents.engine.run import TreeOutcome
from bt_agents_groot.agent_import import import_agent, skills_file
from bt_agents_language.files.testing.test_reader import read_scenario_text
from bt_agents_language.yaml.source import Source
from bt_agents_tools.rehearsal.events import EventKind, Rehearsed
from bt_agents_tools.rehearsal.rehearsal import rehearse
from file_texts import read_agent_text, read_skills_text
from tree_harness import SPACE, SYMBOLS


def rehearsed(tree: str, answers: str = "") -> Rehearsed:
    """Return the rehearsal of a tree with its own skills."""
    text = f"<root BTCPP_format='4'><BehaviorTree ID='T'>{tree}</BehaviorTree></root>"
    made = import_agent(Source("t.xml", text), "a", SYMBOLS)
    symbols = SYMBOLS.with_skills(read_skills_text(skills_file(made.missing), "new.yaml"))
    agent = read_agent_text(made.text, "a.yaml", symbols)
    head = "format: 1\nscene: {age: 3, familiarity: 3, mood: 3}\n"
    script = f"answers: {{{answers}}}\n" if answers else ""
    return rehearse(agent, SPACE, read_scenario_text(head + script, "options", agent, symbols))


def kinds(result: Rehearsed, kind: EventKind) -> list[str]:
    """Return the skills of the events of a kind, in order."""
    return [one.node.kind for one in result.events if one.kind is kind and one.node is not None]


def test_last_child_ends_reactive_sequence():
    tree = "<ReactiveSequence><IsClear/><IsBright/><Go/></ReactiveSequence>"
    result = rehearsed(tree, "go: {after: 5 s}")
    assert result.outcome is TreeOutcome.SUCCEEDED
    assert kinds(result, EventKind.BEGINS).count("go") == 1
    assert kinds(result, EventKind.BEGINS).count("is_clear") > 3


RECOVERY = "<RecoveryNode number_of_retries='%d'><Follow/><Help/></RecoveryNode>"
THRICE = "follow: [{fails: x}, {fails: x}, {fails: x}, {}]"
IN_TURN = "<RoundRobin><Clear/><Spin/></RoundRobin>"
ONCE_EACH = "<RoundRobin wrap_around='false'><Clear/><Spin/></RoundRobin>"
CHECKED = "<ReactiveSequence><Clear/><Go/></ReactiveSequence>"
EITHER = "<ReactiveFallback><Done/><Go/></ReactiveFallback>"
SWITCH = "<WhileDoElse><Day/><Work/><Nap/></WhileDoElse>"
PERSISTENT = """<Sequence><Script code="at := %d"/><Repeat num_cycles="2">
  <RetryUntilSuccessful num_attempts="2"><PersistentSequence current_child_idx="{at}">
  <Clear/><Spin/></PersistentSequence></RetryUntilSuccessful></Repeat></Sequence>"""
BRANCH = "<IfThenElse><Sequence><IsDay/><IsDry/></Sequence><Work/><Rest/></IfThenElse>"


@pytest.mark.parametrize(
    ("tree", "answers", "outcome", "begun"),
    [
        (RECOVERY % 2, "follow: {fails: x}, help: {fails: x}", "failed", "follow help"),
        (RECOVERY % 2, "follow: {fails: x}", "failed", "follow help follow help follow"),
        (RECOVERY % 0, "follow: {fails: x}", "failed", "follow"),
        (RECOVERY % -1, THRICE, "succeeded", "follow help " * 3 + "follow"),
        (IN_TURN, "clear: {fails: x}", "succeeded", "clear spin"),
        (IN_TURN, "clear: {fails: x}, spin: {fails: x}", "failed", "clear spin"),
        (f"<Repeat num_cycles='3'>{IN_TURN}</Repeat>", "", "succeeded", "clear spin clear"),
        (f"<Repeat num_cycles='3'>{ONCE_EACH}</Repeat>", "", "failed", "clear spin"),
        (PERSISTENT % 1, "", "succeeded", "spin clear spin"),
        (PERSISTENT % 0, "spin: {fails: x}", "failed", "clear spin clear spin"),
        (CHECKED, "go: {after: 9 s}, clear: [{}, {fails: x}]", "failed", "clear go clear"),
        (EITHER, "go: {after: 9 s}, done: [{fails: x}, {}]", "succeeded", "done go done"),
        (EITHER, "done: {fails: x}", "succeeded", "done go done"),
        (EITHER, "done: {fails: x}, go: {fails: x}", "failed", "done go done"),
        (SWITCH, "work: {after: 9 s}, day: [{}, {fails: x}]", "succeeded", "day work day nap day"),
        (SWITCH, "nap: {after: 9 s}, day: [{fails: x}, {}]", "succeeded", "day nap day work day"),
        (BRANCH, "", "succeeded", "is_day is_dry work"),
        (BRANCH, "is_dry: {fails: x}", "succeeded", "is_day is_dry rest"),
    ],
)
def test_children_begin_in_the_same_order(tree, answers, outcome, begun):
    result = rehearsed(tree, answers)
    assert (result.outcome.value, kinds(result, EventKind.BEGINS)) == (outcome, begun.split())
    assert result.duration_s < 9.0, "a running child was stopped"


@pytest.mark.parametrize(
    ("controller", "times"),
    [
        ("RateController hz='0.5'", 2),
        ("DistanceController distance='1.0'", 3),
        ("SpeedController min_rate='0.2'", 3),
        ("GoalUpdatedController", 3),
    ],
)
def test_plan_is_recomputed_while_robot_follows_it(controller, times):
    tag = controller.split()[0]
    tree = f"""<PipelineSequence><{controller}><ComputePathToPose path="{{path}}"/></{tag}>
      <FollowPath path="{{path}}"/></PipelineSequence>"""
    result = rehearsed(tree, "follow_path: {after: 4.5 s}")
    assert result.outcome is TreeOutcome.SUCCEEDED
    assert kinds(result, EventKind.BEGINS).count("follow_path") == 1
    assert kinds(result, EventKind.SUCCEEDS).count("compute_path_to_pose") == times


def test_stuck_robot_recovers_and_continues():
    tree = """<RecoveryNode number_of_retries="2">
      <FollowPath error_code_id="{code}"/>
      <Sequence><WouldAControllerRecoveryHelp error_code="{code}"/>
        <ReactiveFallback><GoalUpdated/><RoundRobin><Clear/><BackUp/></RoundRobin>
        </ReactiveFallback></Sequence></RecoveryNode>"""
    result = rehearsed(tree, "follow_path: [{fails: x}, {fails: x}, ''], goal_updated: {fails: x}")
    assert result.outcome is TreeOutcome.SUCCEEDED
    begun = [one for one in kinds(result, EventKind.BEGINS) if one != "goal_updated"]
    helps = "would_a_controller_recovery_help"
    assert begun == ["follow_path", helps, "clear", "follow_path", helps, "back_up", "follow_path"]
