# SPDX-License-Identifier: Apache-2.0
"""Runs of a host: ticks and their times, cancels at odd moments, markets that leave."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import py_trees
import pytest
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from py_trees.common import Status
from rcl_interfaces.msg import Log
from rclpy.clock import Clock, ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from bt_agents.engine.nodes import plugin
from bt_agents.host import market_registration
from bt_agents.host.node import HostNode
from bt_agents_core.diagnostic import Position
from bt_agents_core.run_key import RunKey
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Heartbeat, MarketHeartbeat, Run, StatusChange, TreeStatus
from bt_agents_language.model.specs import CLEAN_UP_S, NodeSpec
from bt_agents_ros import qos
from fake_market import Bag, Market, Stage, agent_text, folder, never_held_up
from scripted_server import Script, ScriptedServer

TALKER = agent_text("talker", "say: hello", "on_cancel: {say: good-bye}")
LISTENER = agent_text(
    "listener", "wait_for: {topic: button, type: std_msgs/msg/Bool, until: msg.data}"
)
SLEEPER = agent_text("sleeper", "wait: 5 s")
LINGERER = agent_text("lingerer", "wait: 5 s", "on_cancel: {wait: 5 s}")
QUICK = agent_text("quick", "wait: 0 s")
TWO_WORDS = agent_text(
    "two_words", "sequence: [{say: one}, {say: two}]", "on_cancel: {say: good-bye}"
)
NOT_ONCE_MORE = 20
GoalEvent = rclpy_implementation.GoalEvent


@pytest.fixture
def host(ros: Any, market: Market, tmp_path: Path) -> HostNode:
    path = folder(tmp_path, TALKER, LISTENER, SLEEPER, LINGERER, QUICK, TWO_WORDS)
    return market.host(path)


@pytest.fixture
def stage(ros: Any, host: HostNode, market: Market, mouth: ScriptedServer) -> Stage:
    return Stage(ros, host, market, mouth)


@pytest.fixture
def steady(host: HostNode) -> None:
    never_held_up(host)


def set_parameter(node: Any, name: str, value: Any) -> None:
    [answer] = node.set_parameters([Parameter(name, value=value)])
    assert answer.successful, answer.reason


def running(ros: Any, host: HostNode) -> Any:
    """Return the run of a host as soon as it exists."""
    ros.until(lambda: host._runs.run)
    return host._runs.run


def test_goal_result_triggers_tick_at_any_tick_rate(stage: Stage) -> None:
    stage.host._runs.set_rate(0.001)  # no regular tick after the first one
    handle = stage.begin()
    stage.mouth.goals[0].finish()
    answer = stage.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    assert answer.result.ticks <= 5


def test_cancelled_nodes_are_published_after_run_result(
    ros: Any, host: HostNode, market: Market, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[str] = []

    def noting(what: Any, name: str) -> None:
        done = getattr(what, name)
        monkeypatch.setattr(what, name, lambda *args: (done(*args), sent.append(name)))

    noting(host._runs, "_publish_stopped")
    noting(host._runs._server, "_send_result_response")
    statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
    ros.until(host._runs._status.get_subscription_count)
    handle = market.send(market.goal(host, agent="sleeper"))
    result = handle.get_result_async()
    ros.until(lambda: statuses)
    assert [change.status for change in statuses[-1].changes] == [StatusChange.RUNNING]
    handle.cancel_goal_async()
    ros.until(lambda: result.done() and len(statuses) == 2)
    assert [change.status for change in statuses[-1].changes] == [StatusChange.INVALID]
    assert sent == ["_send_result_response", "_publish_stopped"]


@pytest.mark.usefixtures("steady")
def test_cancel_takes_effect_immediately_at_any_tick_rate(stage: Stage) -> None:
    stage.host._runs.set_rate(0.001)  # no regular tick after the first one
    handle = stage.begin()
    handle.cancel_goal_async()
    stage.until(lambda: len(stage.mouth.goals) == 2)
    assert stage.mouth.goals[0].cancels == 1
    stage.mouth.goals[1].finish()
    answer = stage.market.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    # Without a tick for its result, the clean-up would take all of its time.
    assert answer.result.duration_s < CLEAN_UP_S


def test_cancel_causes_exactly_one_tick(ros: Any, host: HostNode, market: Market) -> None:
    handle = market.send(market.goal(host, agent="lingerer"))
    run = running(ros, host)
    ticks: list[int] = []
    answer = host._runs._answer_cancel

    def cancel(asked: Any) -> Any:
        ticks.append(run.ticks)
        answered = answer(asked)
        ticks.append(run.ticks)
        host._runs._timer.cancel()  # no regular tick
        return answered

    host._runs._server.register_cancel_callback(cancel)
    handle.cancel_goal_async()
    ros.until(lambda: ticks)
    ros.turns()
    assert [*ticks, run.ticks] == [ticks[0], ticks[0] + 1, ticks[0] + 1]


def test_message_flood_delays_neither_ticks_nor_heartbeats(
    ros: Any, host: HostNode, market: Market
) -> None:
    beats = ros.collect(Heartbeat, "agents/heartbeat", qos.EVENTS)
    flood = ros.node.create_publisher(Bool, "button", qos.EVENTS)
    handle = market.send(market.goal(host, agent="listener"))
    ros.until(flood.get_subscription_count)

    def pour() -> None:
        for _ in range(20):
            flood.publish(Bool(data=False))

    clock = Clock(clock_type=ClockType.STEADY_TIME)
    pouring = ros.node.create_timer(0.02, pour, clock=clock)
    run = running(ros, host)
    before, ticks, began = len(beats), run.ticks, time.monotonic()
    ros.until(lambda: len(beats) >= before + 10)
    took_s = time.monotonic() - began
    extra = run.ticks - ticks - 20 * took_s
    flood.publish(Bool(data=True))
    pouring.cancel()
    answer = market.result(handle)
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    # Each of 1,000 messages a second would cause a tick without a pause of 2 ms.
    assert 0 < extra < 500 * took_s


def test_stalled_host_waits_for_market_before_ticking(stage: Stage) -> None:
    handle = stage.begin("two_words")
    stage.mouth.goals[0].finish()
    # The cancel arrives while the host still waits, even on a slow machine.
    stage.host._runs._award_monitor.stall._settle_s = 300.0
    time.sleep(0.7)
    # A regular tick is due, the result has arrived, and the market is still silent.
    stage.until(lambda: stage.mouth.goals[0].outcome)
    handle.cancel_goal_async()
    answer = stage.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.CANCELLED
    assert "the market stopped it, after this host had been held up for" in answer.result.message
    assert answer.result.stop_cause == RunAgent.Result.BY_MARKET
    assert answer.result.host_reason, "that it was held up is news to the market"
    assert len(stage.mouth.goals) == 1


def test_stalled_host_continues_run_when_nothing_changed(stage: Stage) -> None:
    handle = stage.begin("two_words")
    stage.mouth.script = Script()
    stage.mouth.goals[0].finish()
    time.sleep(0.7)
    assert stage.market.result(handle).result.outcome == RunAgent.Result.SUCCEEDED
    assert len(stage.mouth.goals) == 2


@pytest.fixture
def beating(ros: Any, host: HostNode, market: Market) -> Market:
    """A market with a heartbeat that the host has received."""
    market.live()
    ros.until(lambda: host._runs._award_monitor._named)
    return market


@pytest.mark.usefixtures("beating")
def test_stalled_host_silently_stops_reassigned_run(stage: Stage) -> None:
    handle = stage.begin("two_words")
    stage.mouth.goals[0].finish()
    stage.market.award = (1, "talker")
    time.sleep(0.7)
    answer = stage.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.CANCELLED
    held_up = re.match(
        r"the market has given its run away, after this host had been held up for (\d+\.\d) s",
        answer.result.message,
    )
    assert held_up is not None
    assert float(held_up[1]) >= 0.7
    # Neither the second text nor the clean-up.
    assert len(stage.mouth.goals) == 1
    assert stage.run("quick", round=2).accepted


@pytest.mark.usefixtures("beating")
def test_stalled_host_continues_only_after_market_confirms_run(stage: Stage) -> None:
    set_parameter(stage.host, "market_lease", 10.0)
    handle = stage.begin("two_words")
    stage.market.fall_silent()
    stage.mouth.script = Script()
    stage.mouth.goals[0].finish()
    time.sleep(0.7)
    stage.pass_time(0.6)
    assert len(stage.mouth.goals) == 1
    stage.market.live()
    assert stage.market.result(handle).result.outcome == RunAgent.Result.SUCCEEDED
    assert len(stage.mouth.goals) == 2


@pytest.mark.usefixtures("beating")
def test_stalled_host_stops_clean_up_already_begun(stage: Stage) -> None:
    handle = stage.begin()
    handle.cancel_goal_async()
    stage.until(lambda: len(stage.mouth.goals) == 2)
    time.sleep(0.7)
    answer = stage.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.CANCELLED
    assert stage.mouth.goals[1].cancels == 1


def test_goal_of_past_round_is_refused(ros: Any, host: HostNode, market: Market) -> None:
    market.award = (3, "talker")
    ros.until(market._heart.get_subscription_count)
    market.beat()
    ros.until(lambda: host._runs._award_monitor._named)
    assert market.refusal(market.goal(host, agent="quick", round=2)) == "OVER"
    assert market.send(market.goal(host, agent="quick", round=3)).accepted


def test_stalled_host_registers_again_once(
    ros: Any, host: HostNode, market: Market, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = len(market.requests)
    time.sleep(0.7)
    ros.until(lambda: len(market.requests) > before)
    # A stall of the machine would be another one.
    monkeypatch.setattr(market_registration, "STALL_S", 300.0)
    ros.turns(NOT_ONCE_MORE)
    assert len(market.requests) == before + 1


@pytest.mark.usefixtures("beating")
def test_replaced_host_stops_its_run_silently_and_withdraws(stage: Stage) -> None:
    handle = stage.begin()
    stage.market.refuses_host = "HOST_EXISTS: another /agents is alive"
    time.sleep(0.7)
    answer = stage.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.CANCELLED
    assert answer.result.message.startswith("the market refuses this host: HOST_EXISTS")
    assert [goal.outcome for goal in stage.mouth.goals] == ["cancelled"]
    stage.until(lambda: not stage.market.action.server_is_ready())
    stage.market.refuses_host = ""
    stage.until(lambda: stage.host.registered)
    assert stage.run("quick", round=2).accepted


def test_refused_host_accepts_no_goal_while_run_ends(stage: Stage) -> None:
    stage.mouth.script = Script(finish_s=None, on_cancel="ignores")
    handle = stage.begin()
    stage.market.refuses_host = "OTHER_PARAMETERS: both must read the same scene.yaml"
    stage.market.epoch = "e2"
    stage.market.open()
    stage.until(lambda: not stage.host._registration.accepted)
    assert stage.host._runs.busy
    goal = stage.market.goal(stage.host, agent="quick", round=2)
    assert stage.market.refusal(goal) == "UNREGISTERED"
    answer = stage.market.result(handle)
    assert answer.result.message.startswith("the market refuses this host: OTHER_PARAMETERS")
    assert list(answer.result.orphans) == ["tree"]


class Sleepy(py_trees.behaviour.Behaviour):
    """Sleeps for a while in a tick."""

    nap_s = 0.06

    def update(self) -> Status:
        time.sleep(self.nap_s)
        return Status.SUCCESS


class Dead(Sleepy):
    """Blocks for ever."""

    nap_s = 60.0


def plug_in(host: HostNode, name: str, kind: type) -> None:
    """Give an agent the tree of a plug-in."""
    member = host.registry.members[name]
    position = Position(file="guide.yaml", line=12, column=5)
    spec = NodeSpec(path="tree", position=position, kind="nap", name="nap", fields={}, plugin=kind)
    member.spec = replace(member.spec, tree=spec)


def test_tick_overrun_is_counted_and_names_slowest_node(
    ros: Any, host: HostNode, market: Market, monkeypatch: pytest.MonkeyPatch
) -> None:
    # On a busy machine the nap may last so long that it counts as blocking.
    monkeypatch.setattr(plugin, "BLOCKS_S", 300.0)
    lines = ros.collect(Log, "/rosout", qos.HISTORY)
    plug_in(host, "quick", Sleepy)
    set_parameter(host, "tick_rate", 50.0)
    answer = market.result(market.send(market.goal(host, agent="quick")))
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    assert answer.result.overruns == 1
    ros.until(lambda: any("tree alone took" in line.msg for line in lines))


def test_blocking_plugin_fails_without_affecting_others(
    ros: Any, host: HostNode, market: Market
) -> None:
    plug_in(host, "quick", Dead)
    beats = ros.collect(Heartbeat, "agents/heartbeat", qos.EVENTS)
    ros.until(lambda: beats)
    answer = market.result(market.send(market.goal(host, agent="quick")))
    assert answer.result.outcome == RunAgent.Result.FAILED
    assert answer.result.message == "blocked for more than 0.25 s (tree, guide.yaml:12:5)"
    before = len(beats)
    ros.until(lambda: len(beats) > before)
    sequences = [beat.sequence for beat in beats]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
    ScriptedServer(ros)
    answer = market.result(market.send(market.goal(host, agent="talker", round=2)))
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED


def test_cancel_arriving_with_goal_starts_nothing(stage: Stage) -> None:
    begin = stage.host._runs._begin

    def cancelled_at_once(goal: Any) -> None:
        begin(goal)
        goal._update_state(GoalEvent.CANCEL_GOAL)
        stage.host._runs._answer_cancel(goal)

    stage.host._runs._server.register_handle_accepted_callback(cancelled_at_once)
    handle = stage.run("talker")
    answer = stage.market.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert (answer.result.outcome, answer.result.ticks) == (RunAgent.Result.CANCELLED, 0)
    stage.ros.turns(NOT_ONCE_MORE)
    assert stage.mouth.goals == []


def test_cancel_of_unknown_or_ended_goal_changes_nothing(stage: Stage) -> None:
    first = stage.begin()
    stage.mouth.goals[0].finish()
    assert stage.market.result(first).result.outcome == RunAgent.Result.SUCCEEDED
    second = stage.begin(round=2)
    client = stage.ros.node.create_client(CancelGoal, "agents/run/_action/cancel_goal")
    for goal_id, code in (
        ([7] * 16, CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID),
        (first.goal_id.uuid, CancelGoal.Response.ERROR_GOAL_TERMINATED),
    ):
        request = CancelGoal.Request()
        request.goal_info.goal_id.uuid = goal_id
        assert stage.ros.call(client, request).return_code == code
    stage.ros.turns(NOT_ONCE_MORE)
    assert stage.mouth.goals[1].cancels == 0
    stage.mouth.goals[1].finish()
    assert stage.market.result(second).result.outcome == RunAgent.Result.SUCCEEDED


@pytest.mark.usefixtures("steady")
def test_repeated_cancel_keeps_host_busy_until_goals_settle(stage: Stage) -> None:
    stage.mouth.script = Script(finish_s=None, cancel_s=0.3)
    handle = stage.begin()
    handle.cancel_goal_async()
    stage.until(lambda: len(stage.mouth.goals) == 2)
    again = handle.cancel_goal_async()
    assert stage.market.refusal(stage.market.goal(stage.host, agent="quick", round=2)) == "BUSY"
    stage.until(again.done)
    assert stage.mouth.goals[1].cancels == 0
    stage.mouth.goals[1].finish()
    answer = stage.market.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert list(answer.result.orphans) == []
    assert [goal.outcome for goal in stage.mouth.goals] == ["cancelled", "succeeded"]
    assert stage.run("quick", round=2).accepted


@pytest.mark.usefixtures("beating", "steady")
def test_run_of_silent_market_stops_and_is_reported(stage: Stage) -> None:
    set_parameter(stage.host, "market_lease", 0.5)
    handle = stage.begin(round=7)
    stage.pass_time(0.6)
    assert stage.mouth.goals[0].cancels == 0
    stage.market.fall_silent()
    stage.mouth.script = Script()
    answer = stage.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.CANCELLED
    assert re.match(r"its market has been silent for \d+\.\d", answer.result.message)
    assert [goal.outcome for goal in stage.mouth.goals] == ["cancelled", "succeeded"]
    assert list(stage.market.requests[-1].unreported) == []

    stage.market.epoch = "e2"
    stage.market.live()
    stage.until(lambda: stage.market.requests[-1].unreported)
    [run] = stage.market.requests[-1].unreported
    assert (run.epoch, run.round, run.agent) == ("e1", 7, "talker")
    assert (run.event, run.outcome) == (Run.ENDED, Run.CANCELLED)
    assert run.stop_cause == answer.result.stop_cause == Run.MARKET_LOST
    assert run.host_instance == stage.host.instance
    assert run.scene.scene_id == "s1"
    stage.until(lambda: stage.host._registration.epoch == "e2")
    count = len(stage.market.requests)
    stage.market.epoch = "e3"
    stage.market.open()
    stage.until(lambda: len(stage.market.requests) > count)
    assert list(stage.market.requests[-1].unreported) == []


def test_market_lost_before_first_heartbeat_is_detected(stage: Stage) -> None:
    set_parameter(stage.host, "market_lease", 0.5)
    handle = stage.begin()
    stage.mouth.script = Script()
    assert stage.market.result(handle).result.stop_cause == RunAgent.Result.MARKET_LOST


@pytest.mark.usefixtures("steady")
def test_run_of_restarted_market_stops_and_is_reported(stage: Stage) -> None:
    handle = stage.begin()
    stage.market.epoch = "e2"
    stage.market.live()
    stage.until(lambda: len(stage.mouth.goals) == 2)
    assert stage.mouth.goals[0].cancels == 1
    assert all(not request.unreported for request in stage.market.requests)
    stage.mouth.goals[1].finish()
    answer = stage.market.result(handle)
    assert answer.result.message == "its market is gone"
    stage.until(lambda: stage.market.requests[-1].unreported)
    [run] = stage.market.requests[-1].unreported
    assert (run.epoch, run.outcome, run.message) == ("e1", Run.CANCELLED, "its market is gone")
    assert run.stop_cause == answer.result.stop_cause == Run.MARKET_LOST
    assert answer.result.host_reason


def test_announced_run_is_not_reported_again(ros: Any, host: HostNode, market: Market) -> None:
    for number in (1, 2):
        goal = market.goal(host, agent="quick", round=number)
        market.result(market.send(goal))
    ros.until(market._runs.get_subscription_count)
    market.announce(1, "quick")
    closed = RunKey(epoch="e1", round=1, agent="quick")
    ros.until(lambda: closed in host._registration._unreported._closed)
    market.epoch = "e2"
    market.open()
    ros.until(lambda: market.requests[-1].unreported)
    [run] = market.requests[-1].unreported
    assert (run.round, run.outcome) == (2, Run.SUCCEEDED)


def test_host_between_two_markets_limits_its_registrations(
    ros: Any, host: HostNode, market: Market, monkeypatch: pytest.MonkeyPatch
) -> None:
    # After a stall of the machine it would register once more.
    monkeypatch.setattr(market_registration, "STALL_S", 300.0)
    before = len(market.requests)
    began = time.monotonic()
    heart = market._heart
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    stranger = ros.node.create_timer(
        0.01, lambda: heart.publish(MarketHeartbeat(epoch="other")), clock=clock
    )
    ros.until(lambda: time.monotonic() - began > 1.5)
    stranger.cancel()
    took_s = time.monotonic() - began
    assert len(market.requests) - before <= took_s + 1


@pytest.fixture
def simulated(ros: Any, market: Market, tmp_path: Path) -> HostNode:
    path = folder(tmp_path, SLEEPER, QUICK)
    overrides = [Parameter("use_sim_time", value=True)]
    return market.host(path, parameter_overrides=overrides)


def test_agents_without_simulated_time_do_not_bid(
    ros: Any, simulated: HostNode, market: Market
) -> None:
    market.call(round_number=1)
    ros.until(lambda: market.bids)
    assert list(market.bids[0].agents) == []
    reasons = ["use_sim_time is set, but nothing publishes /clock"] * 2
    assert list(market.bids[0].decline_reasons) == reasons
    Bag(ros).play(simulated, 100)
    market.call(round_number=2)
    ros.until(lambda: len(market.bids) == 2)
    assert list(market.bids[1].agents) == ["quick", "sleeper"]


def test_tree_waits_on_simulated_time_across_bag_restart(
    ros: Any, simulated: HostNode, market: Market
) -> None:
    bag = Bag(ros)
    bag.play(simulated, 100)
    handle = market.send(market.goal(simulated, agent="sleeper"))
    end = handle.get_result_async()
    run = running(ros, simulated)
    # Five seconds of the tree: three before the bag restarts, two after it.
    for seconds in (100, 103, 10, 11):
        bag.play(simulated, seconds)
        before = run.ticks
        ros.until(lambda before=before: run.ticks >= before + 2)
        assert not end.done()
    bag.play(simulated, 12)
    ros.until(end.done)
    assert end.result().result.outcome == RunAgent.Result.SUCCEEDED
    assert end.result().result.duration_s == pytest.approx(5.0)


def test_deadlines_expire_while_simulated_time_stands_still(
    ros: Any, market: Market, tmp_path: Path
) -> None:
    mouth = ScriptedServer(ros, script=Script(finish_s=None, on_cancel="ignores"))
    overrides = [Parameter("use_sim_time", value=True)]
    host = market.host(folder(tmp_path, TALKER), parameter_overrides=overrides)
    Bag(ros).play(host, 100)
    handle = market.send(market.goal(host))
    ros.until(lambda: mouth.goals)
    handle.cancel_goal_async()
    answer = market.result(handle)
    assert answer.result.outcome == RunAgent.Result.CANCELLED
    assert list(answer.result.orphans) == ["tree", "on_cancel"]
