# SPDX-License-Identifier: Apache-2.0
"""Trees ticked on a scripted environment: what each node does, tick by tick."""

from __future__ import annotations

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import Stage, scene

LONG = [ScriptedReply(after_s=100.0)]
FAILS = [ScriptedReply(state=GoalState.ABORTED, message="motor off")]


def test_sequence_runs_children_in_order() -> None:
    #  t | first | second | sequence
    #  0 |   R   |   -    |   R
    #  1 |   S   |   R    |   R
    #  2 |       |   S    |   S
    stage = Stage(
        """
        sequence:
          - say: first
          - say: second
        """,
        answers={"say": [ScriptedReply(after_s=1.0)]},
    )
    assert stage.tick() == "running"
    assert stage.said == ["first"]
    assert stage.after(1.0) == "running"
    assert stage.said == ["first", "second"]
    assert stage.after(1.0) == "succeeded"


def test_sequence_fails_with_reason_of_first_failing_child() -> None:
    stage = Stage(
        """
        sequence:
          - drive: gate 12
          - say: never
        """,
        answers={"drive": FAILS},
    )
    assert stage.tick() == "failed"
    assert stage.said == []
    assert stage.run.result is not None
    assert "drive aborted: motor off" in stage.run.result.message


def test_a_selector_takes_the_first_child_that_succeeds() -> None:
    stage = Stage(
        """
        selector:
          - check: scene.age > 4
          - say: second
          - say: third
        """
    )
    assert stage.tick() == "succeeded"
    assert stage.said == ["second"]


def test_parallel_all_waits_for_every_child() -> None:
    stage = Stage(
        """
        parallel:
          children:
            - say: x
            - show: y
        """,
        answers={"say": [ScriptedReply(after_s=1.0)], "show": [ScriptedReply(after_s=2.0)]},
    )
    assert stage.tick() == "running"
    assert stage.after(1.0) == "running"
    assert stage.after(1.0) == "succeeded"


def test_parallel_one_stops_other_children_and_settles() -> None:
    stage = Stage(
        """
        parallel:
          succeed_on: one
          children:
            - say: x
            - show: y
        """,
        answers={
            "say": [ScriptedReply(after_s=1.0)],
            "show": [ScriptedReply(after_s=9.0, cancel_s=0.5)],
        },
    )
    assert stage.tick() == "running"
    assert stage.after(1.0) == "running"
    assert stage.environment.running() == ["show"]
    assert stage.after(0.5) == "succeeded"
    assert stage.environment.running() == []


def test_check_fails_when_its_value_is_missing() -> None:
    stage = Stage("check: scene.age > 2", awarded=scene(mood=3))
    assert stage.tick() == "failed"
    assert stage.run.result is not None
    assert "'scene.age' has no value" in stage.run.result.message
    assert "a.yaml:" in stage.run.result.message


def test_set_writes_what_later_nodes_read() -> None:
    stage = Stage(
        """
        sequence:
          - set: {place: gate 12}
          - say: Going to ${place}
        """
    )
    assert stage.tick() == "succeeded"
    assert stage.said == ["Going to gate 12"]


def test_running_wait_follows_tuned_duration() -> None:
    stage = Stage(
        "wait: ${pause}",
        head="tunables: {pause: {default: 10 s, min: 1 s, max: 60 s, description: d}}",
    )
    assert stage.tick() == "running"
    assert stage.after(5.0) == "running"
    stage.tunables["pause"] = 6.0
    assert stage.after(0.5) == "running"
    assert stage.after(0.5) == "succeeded"


def test_wait_for_ends_at_first_matching_message() -> None:
    stage = Stage("wait_for: {topic: button, type: std_msgs/msg/Bool, until: msg.data}")
    assert stage.tick() == "running"
    stage.environment.arrive("button", {"data": False})
    assert stage.tick() == "running"
    stage.environment.arrive("button", {"data": True})
    assert stage.tick() == "succeeded"


def test_condition_indexes_list_and_fails_out_of_range() -> None:
    tree = "wait_for: {topic: scan, type: sensor_msgs/msg/LaserScan, until: msg.ranges.1 < 1}"
    stage = Stage(tree)
    assert stage.tick() == "running"
    stage.environment.arrive("scan", {"ranges": [0.2, 3.0]})
    assert stage.tick() == "running"
    stage.environment.arrive("scan", {"ranges": [3.0, 0.2]})
    assert stage.tick() == "succeeded"
    short = Stage(tree)
    short.tick()
    short.environment.arrive("scan", {"ranges": [0.2]})
    assert short.tick() == "failed"


def test_later_node_reads_skill_output() -> None:
    stage = Stage(
        """
        sequence:
          - ask: Where to?
          - drive: ${answer}
        """,
        answers={"ask": [ScriptedReply(result={"answer": "gate 7", "message": ""})]},
    )
    assert stage.tick() == "succeeded"
    assert stage.environment.goals[-1].goal.fields["destination"] == "gate 7"


def test_skill_fails_when_its_result_condition_is_false() -> None:
    stage = Stage("ask: Where to?", answers={"ask": [ScriptedReply(result={"answer": ""})]})
    assert stage.tick() == "failed"


def test_raw_leaves_send_their_declared_fields() -> None:
    stage = Stage(
        """
        sequence:
          - action: {name: /dock, type: test_msgs/action/Fibonacci, goal: {order: 3}}
          - service: {name: /reset, type: std_srvs/srv/Trigger}
          - publish: {topic: beep, type: std_msgs/msg/String, message: {data: "age ${scene.age}"}}
        """
    )
    assert stage.tick() == "succeeded"
    assert [(g.goal.name, g.goal.fields) for g in stage.environment.goals] == [
        ("/dock", {"order": 3}),
        ("/reset", {}),
    ]
    assert stage.environment.published[0].fields == {"data": "age 3"}


def test_timeout_halts_node_and_cancels_its_goal() -> None:
    stage = Stage("say: long text\ntimeout: 2 s", answers={"say": LONG})
    assert stage.tick() == "running"
    assert stage.after(1.9) == "running"
    assert stage.after(0.1) == "failed"
    assert stage.environment.running() == []
    assert stage.run.result is not None
    assert "not done within 2 s" in stage.run.result.message


def test_retry_restarts_child_until_it_succeeds() -> None:
    stage = Stage("say: x\nretry: 3", answers={"say": [*FAILS, *FAILS, ScriptedReply()]})
    assert stage.tick(2) == "running"
    assert stage.tick() == "succeeded"
    assert len(stage.said) == 3


def test_exhausted_retry_fails_with_last_reason() -> None:
    stage = Stage("say: x\nretry: 2", answers={"say": FAILS})
    assert stage.tick(2) == "failed"
    assert len(stage.said) == 2
    assert stage.run.result is not None
    assert "motor off" in stage.run.result.message


def test_repeat_counts_successes() -> None:
    stage = Stage("say: x\nrepeat: 3")
    assert stage.tick(3) == "succeeded"
    assert len(stage.said) == 3


def test_invert_swaps_success_and_failure() -> None:
    assert Stage("check: scene.age > 4\ninvert: true").tick() == "succeeded"
    assert Stage("check: scene.age < 4\ninvert: true").tick() == "failed"


def test_on_failure_branch_replaces_failed_node() -> None:
    stage = Stage("drive: x\non_failure: {say: sorry}", answers={"drive": FAILS})
    assert stage.tick() == "succeeded"
    assert stage.said == ["sorry"]


def test_sequence_skips_child_whose_when_is_false() -> None:
    stage = Stage(
        """
        sequence:
          - say: for old people
            when: scene.age > 4
          - say: for all
        """
    )
    assert stage.tick() == "succeeded"
    assert stage.said == ["for all"]


def test_selector_skips_child_whose_when_is_false() -> None:
    stage = Stage(
        """
        selector:
          - say: for old people
            when: scene.age > 4
          - say: for all
        """
    )
    assert stage.tick() == "succeeded"
    assert stage.said == ["for all"]


def test_when_is_evaluated_once_at_node_start() -> None:
    stage = Stage("say: x\nwhen: live.mood >= 3", answers={"say": [ScriptedReply(after_s=2.0)]})
    assert stage.tick() == "running"
    stage.set_mood(1.0)
    assert stage.after(1.0) == "running"
    assert stage.after(1.0) == "succeeded"


def test_subtree_receives_inputs_from_its_caller() -> None:
    stage = Stage(
        """
        sequence:
          - subtree: greet
            with: {who: "${name}"}
          - subtree: greet
            with: {who: Bob}
        """,
        head="""
        tunables: {name: {default: Ann, description: d}}
        subtrees:
          greet:
            inputs: {who: text}
            tree: {say: "Hello ${who}."}
        """,
    )
    stage.tunables["name"] = "Eve"
    assert stage.tick() == "succeeded"
    assert stage.said == ["Hello Eve.", "Hello Bob."]


def test_only_live_names_follow_the_live_scene() -> None:
    stage = Stage(
        """
        sequence:
          - wait: 1 s
          - check: scene.mood == 3 and live.mood == 2 and mood.change == -1
        """
    )
    assert stage.tick() == "running"
    stage.set_mood(2.0)
    assert stage.after(1.0) == "succeeded"


def test_cancel_halts_leaves_cleans_up_and_settles() -> None:
    #  t    | say       | show      | on_cancel | run
    #  0    | R         | R         |           | R
    #  0    | cancelled | cancel    |           | cleaning
    #  0    |           |           | R (light) | cleaning
    #  1    |           | ended     | S         | cancelled
    stage = Stage(
        """
        parallel:
          children:
            - say: x
            - show: y
        """,
        head="on_cancel: {light: red}",
        answers={
            "say": LONG,
            "show": [ScriptedReply(after_s=100.0, cancel_s=1.0)],
            "set_light": [ScriptedReply(result={"accepted": True})],
        },
    )
    stage.tick()
    stage.changes = stage.run.cancel("enough")
    assert {change.path for change in stage.changes} >= {"tree"}
    assert stage.environment.running() == ["show"]
    assert stage.tick() == "running"
    assert stage.asked == ["say", "show", "set_light"]
    assert stage.after(1.0) == "cancelled"
    assert stage.run.result is not None
    assert stage.run.result.orphans == ()
    assert stage.run.result.message == "enough"


def test_goal_ignoring_cancel_becomes_an_orphan() -> None:
    stage = Stage("say: x", answers={"say": [ScriptedReply(after_s=1e9, cancel_s=1e9)]})
    stage.tick()
    stage.run.cancel("enough")
    assert stage.tick() == "running"
    assert stage.after(2.0) == "cancelled"
    assert stage.run.result is not None
    assert stage.run.result.orphans == ("tree",)


def test_pending_goal_is_cancelled_on_acceptance() -> None:
    stage = Stage("say: x", answers={"say": [ScriptedReply(accept_s=0.5, after_s=50.0)]})
    stage.tick()
    stage.run.cancel("enough")
    assert stage.tick() == "running"
    assert stage.after(0.5) == "cancelled"


def test_endless_cleanup_is_bounded() -> None:
    stage = Stage("wait: 9 s", head="on_cancel: {wait: 1 min}")
    stage.tick()
    stage.run.cancel("enough")
    assert stage.tick() == "running"
    assert stage.after(2.9) == "running"
    assert stage.after(0.1) == "cancelled"


def test_a_cancel_before_the_first_tick_ticks_nothing() -> None:
    stage = Stage("say: x")
    stage.run.cancel("early")
    assert stage.outcome == "cancelled"
    assert stage.said == []


def test_a_cancel_after_the_end_changes_nothing() -> None:
    stage = Stage("say: x")
    assert stage.tick() == "succeeded"
    assert stage.run.cancel("late") == []
    assert stage.outcome == "succeeded"


def test_a_second_cancel_changes_nothing() -> None:
    stage = Stage("wait: 9 s", head="on_cancel: {wait: 1 s}")
    stage.tick()
    stage.run.cancel("first")
    assert stage.run.cancel("second") == []
    stage.tick()
    stage.after(1.0)
    assert stage.run.result is not None
    assert stage.run.result.message == "first"


def test_stop_without_cleanup_skips_on_cancel() -> None:
    stage = Stage("wait: 9 s", head="on_cancel: {say: bye}")
    stage.tick()
    stage.run.cancel("shutdown", clean_up=False)
    assert stage.outcome == "cancelled"
    assert stage.said == []


def test_tick_reports_only_changes_in_order() -> None:
    stage = Stage(
        """
        sequence:
          - check: scene.age == 3
          - wait: 1 s
        """
    )
    stage.tick()
    assert [(c.path.rpartition("/")[2], c.status.name) for c in stage.changes] == [
        ("0.check", "SUCCESS"),
        ("1.wait", "RUNNING"),
        ("tree", "RUNNING"),
    ]
    stage.changes = []
    stage.tick()
    assert stage.changes == []


def test_raising_leaf_fails_with_path_and_file_position(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage("sequence:\n  - say: x")

    def broken(goal: object) -> None:
        raise RuntimeError("cable cut")

    monkeypatch.setattr(stage.environment, "send", broken)
    assert stage.tick() == "failed"
    assert stage.run.result is not None
    assert "RuntimeError: cable cut (tree/0.say, a.yaml:" in stage.run.result.message
