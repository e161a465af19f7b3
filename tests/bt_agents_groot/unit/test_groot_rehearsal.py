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


def test_failed_condition_stops_running_child():
    tree = "<ReactiveSequence><IsClear/><Go/></ReactiveSequence>"
    result = rehearsed(tree, "go: {after: 9 s}, is_clear: [{after: 1 s}, {fails: blocked}]")
    assert result.outcome is TreeOutcome.FAILED
    assert kinds(result, EventKind.STOPS) == ["go"]


def test_reactive_fallback_stops_once_condition_holds():
    tree = "<ReactiveFallback><IsDone/><Go/></ReactiveFallback>"
    result = rehearsed(tree, "go: {after: 9 s}, is_done: [{fails: no}, {fails: no}, {after: 1 s}]")
    assert result.outcome is TreeOutcome.SUCCEEDED
    assert kinds(result, EventKind.BEGINS).count("go") == 1
    assert "go" in kinds(result, EventKind.STOPS)


def test_branch_switches_with_its_condition():
    tree = "<WhileDoElse><IsDay/><Work/><Sleep_well/></WhileDoElse>"
    result = rehearsed(
        tree, "work: {after: 9 s}, sleep_well: {after: 4 s}, is_day: [{after: 1 s}, {fails: no}]"
    )
    assert result.outcome is TreeOutcome.SUCCEEDED
    begun = [one for one in kinds(result, EventKind.BEGINS) if one != "is_day"]
    assert begun == ["work", "sleep_well"]


@pytest.mark.parametrize(
    ("controller", "times"),
    [("RateController hz='0.5'", 2), ("DistanceController distance='1.0'", 3)],
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
