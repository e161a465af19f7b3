# SPDX-License-Identifier: Apache-2.0
"""Trees ticked on a scripted environment: what each node does, tick by tick."""

from __future__ import annotations

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import Stage, scene

LONG = [ScriptedReply(after_s=100.0)]
FAILS = [ScriptedReply(state=GoalState.ABORTED, message="motor off")]


def test_a_sequence_runs_its_children_one_after_the_other() -> None:
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


def test_a_sequence_fails_with_its_first_failing_child_and_says_why() -> None:
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


def test_a_parallel_for_all_waits_for_all() -> None:
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


def test_a_parallel_for_one_stops_the_others_and_the_run_waits_until_they_have_ended() -> None:
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


def test_a_check_whose_value_is_missing_is_a_failure_that_says_so() -> None:
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


def test_wait_takes_its_time_and_the_time_may_be_tuned_while_it_passes() -> None:
    stage = Stage(
        "wait: ${pause}",
        head="tunables: {pause: {default: 10 s, min: 1 s, max: 60 s, description: d}}",
    )
    assert stage.tick() == "running"
    assert stage.after(5.0) == "running"
    stage.tunables["pause"] = 6.0
    assert stage.after(0.5) == "running"
    assert stage.after(0.5) == "succeeded"


def test_wait_for_takes_the_first_message_that_fits() -> None:
    stage = Stage("wait_for: {topic: button, type: std_msgs/msg/Bool, until: msg.data}")
    assert stage.tick() == "running"
    stage.environment.arrive("button", {"data": False})
    assert stage.tick() == "running"
    stage.environment.arrive("button", {"data": True})
    assert stage.tick() == "succeeded"


def test_a_condition_can_look_at_an_item_of_a_list_and_one_too_far_is_not_there() -> None:
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


def test_the_output_of_a_skill_can_be_used_by_later_nodes() -> None:
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


def test_a_skill_whose_condition_on_the_result_is_false_fails() -> None:
    stage = Stage("ask: Where to?", answers={"ask": [ScriptedReply(result={"answer": ""})]})
    assert stage.tick() == "failed"


def test_raw_leaves_send_what_they_say() -> None:
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


def test_a_timeout_stops_the_node_and_cancels_its_goal() -> None:
    stage = Stage("say: long text\ntimeout: 2 s", answers={"say": LONG})
    assert stage.tick() == "running"
    assert stage.after(1.9) == "running"
    assert stage.after(0.1) == "failed"
    assert stage.environment.running() == []
    assert stage.run.result is not None
    assert "not done within 2 s" in stage.run.result.message


def test_retry_starts_again_until_it_succeeds() -> None:
    stage = Stage("say: x\nretry: 3", answers={"say": [*FAILS, *FAILS, ScriptedReply()]})
    assert stage.tick(2) == "running"
    assert stage.tick() == "succeeded"
    assert len(stage.said) == 3


def test_retry_gives_up_after_so_many_attempts_with_the_reason_of_the_last() -> None:
    stage = Stage("say: x\nretry: 2", answers={"say": FAILS})
    assert stage.tick(2) == "failed"
    assert len(stage.said) == 2
    assert stage.run.result is not None
    assert "motor off" in stage.run.result.message


def test_repeat_counts_successes() -> None:
    stage = Stage("say: x\nrepeat: 3")
    assert stage.tick(3) == "succeeded"
    assert len(stage.said) == 3


def test_invert_turns_success_and_failure_round() -> None:
    assert Stage("check: scene.age > 4\ninvert: true").tick() == "succeeded"
    assert Stage("check: scene.age < 4\ninvert: true").tick() == "failed"


def test_on_failure_is_done_instead_and_counts_as_handled() -> None:
    stage = Stage("drive: x\non_failure: {say: sorry}", answers={"drive": FAILS})
    assert stage.tick() == "succeeded"
    assert stage.said == ["sorry"]


def test_a_node_whose_when_is_false_is_left_out_of_a_sequence() -> None:
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


def test_a_node_whose_when_is_false_lets_a_selector_go_on() -> None:
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


def test_a_when_is_looked_at_once_when_the_node_starts() -> None:
    stage = Stage("say: x\nwhen: live.mood >= 3", answers={"say": [ScriptedReply(after_s=2.0)]})
    assert stage.tick() == "running"
    stage.set_mood(1.0)
    assert stage.after(1.0) == "running"
    assert stage.after(1.0) == "succeeded"


def test_a_subtree_sees_its_inputs_as_the_caller_meant_them() -> None:
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


def test_live_names_follow_the_live_scene_and_scene_names_do_not() -> None:
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


def test_a_cancel_stops_every_running_leaf_then_cleans_up_then_waits_for_open_goals() -> None:
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


def test_a_goal_that_ignores_the_cancel_is_reported_as_an_orphan_after_a_bounded_wait() -> None:
    stage = Stage("say: x", answers={"say": [ScriptedReply(after_s=1e9, cancel_s=1e9)]})
    stage.tick()
    stage.run.cancel("enough")
    assert stage.tick() == "running"
    assert stage.after(2.0) == "cancelled"
    assert stage.run.result is not None
    assert stage.run.result.orphans == ("tree",)


def test_a_goal_not_yet_accepted_is_cancelled_on_acceptance() -> None:
    stage = Stage("say: x", answers={"say": [ScriptedReply(accept_s=0.5, after_s=50.0)]})
    stage.tick()
    stage.run.cancel("enough")
    assert stage.tick() == "running"
    assert stage.after(0.5) == "cancelled"


def test_a_clean_up_that_does_not_end_is_bounded() -> None:
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


def test_a_stop_without_clean_up_leaves_on_cancel_out() -> None:
    stage = Stage("wait: 9 s", head="on_cancel: {say: bye}")
    stage.tick()
    stage.run.cancel("shutdown", clean_up=False)
    assert stage.outcome == "cancelled"
    assert stage.said == []


def test_only_what_changed_in_a_tick_is_told_in_the_order_it_happened() -> None:
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


def test_a_leaf_that_raises_is_a_failure_with_its_path_and_its_place_in_the_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stage = Stage("sequence:\n  - say: x")

    def broken(goal: object) -> None:
        raise RuntimeError("cable cut")

    monkeypatch.setattr(stage.environment, "send", broken)
    assert stage.tick() == "failed"
    assert stage.run.result is not None
    assert "RuntimeError: cable cut (tree/0.say, a.yaml:" in stage.run.result.message
