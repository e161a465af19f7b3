# SPDX-License-Identifier: Apache-2.0
"""The marketplace node among hosts that behave well, badly or not at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter

from bt_agents_core.errors import ReadError
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import (
    Auction,
    Bids,
    MarketHeartbeat,
    MarketStatus,
    Run,
    Scene,
    SceneEnd,
    SceneValue,
)
from bt_agents_interfaces.srv import CollectFeedback
from bt_agents_ros import qos
from bt_agents_ros.messages import header_at, scene_to_msg
from market_harness import EXPRESS, GUIDE, PLAIN, SPACE, scene
from market_node_harness import FAR, FakeHost, MarketNodeHarness
from marketplace_node.node import MarketplaceNode, read_configuration

pytestmark = pytest.mark.ros

SCENE = "format: 1\nparameters:\n  age: {min: 1, max: 5, default: 3}\n"


@pytest.fixture
def harness(ros: Any) -> MarketNodeHarness:
    return MarketNodeHarness(ros)


def test_scene_starts_run_of_closest_agent(harness: MarketNodeHarness) -> None:
    host = harness.host()
    harness.scene()
    started = harness.until_event(Run.STARTED)
    host.finish()
    ended = harness.until_event(Run.ENDED)
    harness.until_over()
    harness.ros.until(lambda: harness.statuses[-1].hosts == 1)
    status = harness.statuses[-1]

    auction = harness.auctions[0]
    assert auction.reason == (
        "attentive_guide 1.5 = |4−5| + |1.5−1| + |3−3|; "
        "next: professional_express 6.5 (margin 5.0)"
    )
    assert (auction.winner, auction.winner_id, auction.host) == (GUIDE, 1, "/agents")
    assert auction.ranking[1].calculation == "6.5 = |3−5| + |5−1| + |3.5−3|"
    assert auction.outcome == Auction.AWARDED
    assert auction.closed_by == Auction.ALL_ANSWERED
    assert (started.agent, started.host_instance, started.epoch) == (GUIDE, "first", "epoch")
    assert (ended.outcome, ended.ticks, ended.message) == (Run.SUCCEEDED, 3, "as told")
    assert status.state == MarketStatus.IDLE
    assert (status.hosts, status.agents) == (1, 2)
    assert host.log == ["start attentive_guide", "end attentive_guide"]


def test_feedback_is_collected_from_the_service(ros: Any) -> None:
    harness = MarketNodeHarness(ros, collect_deadline=5.0)
    requests: list[Any] = []

    def collect(
        request: CollectFeedback.Request, response: CollectFeedback.Response
    ) -> CollectFeedback.Response:
        requests.append(request)
        response.message = "the guide has learned"
        return response

    ros.node.create_service(CollectFeedback, "feedback/collect", collect, qos_profile=qos.SERVICE)
    host = harness.host()
    harness.scene()
    harness.until_event(Run.STARTED)
    host.finish(RunAgent.Result.FAILED)
    status = harness.until_over()

    assert [(r.round, r.agent, r.outcome) for r in requests] == [(1, GUIDE, Run.FAILED)]
    assert status.message.endswith("the guide has learned")


def test_refused_goal_goes_to_next_best_agent(harness: MarketNodeHarness) -> None:
    host = harness.host()
    host.refuses = {GUIDE}
    harness.scene()

    assert harness.until_event(Run.REFUSED).agent == GUIDE
    assert harness.until_event(Run.STARTED).agent == EXPRESS


def test_run_ended_as_refused_goes_to_next_best(harness: MarketNodeHarness) -> None:
    host = harness.host()
    host.explains = {GUIDE}
    harness.scene()

    refused = harness.until_event(Run.REFUSED)
    assert (refused.agent, refused.message) == (
        GUIDE,
        "/agents refused it (BUSY: another tree runs)",
    )
    assert harness.until_event(Run.STARTED).agent == EXPRESS
    host.finish()
    harness.until_over()
    assert [run.agent for run in harness.runs if run.event == Run.STARTED] == [EXPRESS]


def test_silent_host_does_not_block_round(harness: MarketNodeHarness) -> None:
    harness.host()
    silent = harness.host("others", **{PLAIN: FAR})
    silent.silent = True
    harness.scene()
    harness.until_event(Run.STARTED)

    harness.ros.until(lambda: harness.auctions)
    auction = harness.auctions[0]
    assert auction.closed_by == Auction.DEADLINE
    assert list(auction.silent_hosts) == ["/others"]
    assert auction.duration_s >= 0.5


def wrong_length(message: Bids) -> None:
    message.vectors = list(message.vectors)[:-1]


def endless(message: Bids) -> None:
    message.vectors = [1.0] * 100_000


def not_a_number(message: Bids) -> None:
    message.vectors = [math.nan] * len(message.vectors)


def infinite(message: Bids) -> None:
    message.vectors = [math.inf] * len(message.vectors)


def without_reasons(message: Bids) -> None:
    message.declined = ["somebody"]


@pytest.mark.parametrize(
    ("distort", "code"),
    [
        (wrong_length, "WRONG_LENGTH"),
        (endless, "WRONG_LENGTH"),
        (not_a_number, "NOT_FINITE"),
        (infinite, "NOT_FINITE"),
        (without_reasons, "WRONG_LENGTH"),
    ],
)
def test_malformed_bids_do_not_affect_next_round(
    harness: MarketNodeHarness, distort: Callable[[Bids], None], code: str
) -> None:
    host = harness.host()
    host.distort = distort
    harness.scene()
    harness.until_over()
    assert {bid.code for bid in harness.auctions[0].refused} == {code}
    assert harness.auctions[0].outcome == Auction.NO_BIDS

    host.distort = lambda _: None
    harness.scene("s2")
    assert harness.until_event(Run.STARTED).agent == GUIDE


def test_cancel_stops_tree_and_ends_interaction(harness: MarketNodeHarness) -> None:
    host = harness.host()
    harness.scene()
    harness.until_event(Run.STARTED)
    answer = harness.cancel(reason="button")
    ended = harness.until_event(Run.ENDED)
    harness.until_over()

    assert (answer.accepted, answer.message) == (True, "stopping attentive_guide")
    assert ended.outcome == Run.CANCELLED
    assert host.log == ["start attentive_guide", "end attentive_guide"]


def test_mood_change_hands_over_to_another_agent(harness: MarketNodeHarness) -> None:
    host = harness.host()
    harness.scene()
    harness.until_event(Run.STARTED)
    live = scene_to_msg(scene("s1", 5.0, 1.0, 1.0))
    assert harness.cancel(epoch="epoch", round=1, reason="bored", again=True, scene=live).accepted
    assert harness.until_event(Run.STARTED, count=2).agent == EXPRESS
    host.finish()
    harness.until_over("s1")

    assert host.log == [
        "start attentive_guide",
        "end attentive_guide",
        "start professional_express",
        "end professional_express",
    ]
    assert list(host.calls[1].excluded) == [GUIDE]
    assert harness.auctions[1].follows == 1
    assert harness.auctions[1].scene.scene_id == "s1+1"


def test_lost_host_ends_run_and_others_are_asked(ros: Any) -> None:
    harness = MarketNodeHarness(ros, host_lease=0.5)
    host = harness.host()
    harness.host("others", **{PLAIN: FAR})
    harness.scene()
    assert harness.until_event(Run.STARTED).agent == GUIDE
    ros.remove(host)

    ended = harness.until_event(Run.ENDED)
    assert ended.outcome == Run.LOST
    assert "no heartbeat" in ended.message
    assert harness.until_event(Run.STARTED, count=2).agent == PLAIN


def test_scene_ends_when_no_agents_are_registered(ros: Any) -> None:
    harness = MarketNodeHarness(ros, host_wait=0.2)
    harness.scene()
    harness.until_over()

    assert harness.auctions[0].reason == "no agents are registered"


def test_valid_scene_is_accepted_after_hostile_ones(
    ros: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    harness = MarketNodeHarness(ros, host_wait=0.5)
    good = scene_to_msg(scene("s1"))
    strange = SceneValue(name="x", value=1.0, origin=SceneValue.GIVEN)
    infinite = [SceneValue(name=name, value=math.inf, origin=2) for name in SPACE.names]
    unknown = [SceneValue(name=name, value=1.0, origin=77) for name in SPACE.names]
    bad = ([], [strange], good.values[:2], infinite, unknown, [*good.values] * 2)
    for number, values in enumerate(bad):
        harness.scenes.publish(Scene(scene_id=f"bad{number}", values=values))
    harness.scenes.publish(Scene(scene_id="", values=good.values))
    harness.scenes.publish(Scene(scene_id="x" * 10_000, values=[]))
    harness.scene("s1")
    harness.scene("s1")
    harness.ros.until(lambda: len(harness.ends) == len(bad) + 3)

    assert [(end.scene_id, end.code) for end in harness.ends] == [
        ("bad0", "EMPTY"),
        ("bad1", "UNKNOWN_PARAMETER"),
        ("bad2", "WRONG_LENGTH"),
        ("bad3", "NOT_FINITE"),
        ("bad4", "UNKNOWN_ORIGIN"),
        ("bad5", "DUPLICATE_PARAMETER"),
        ("x" * 200, "TOO_LONG"),
        ("s1", "DUPLICATE"),
        ("s1", "NO_BIDS"),
    ]
    assert all(end.message and end.epoch == "epoch" for end in harness.ends)
    assert [auction.scene.scene_id for auction in harness.auctions] == ["s1"]
    assert "EMPTY: scene: no scene_id; every scene needs a unique one" in capfd.readouterr().err


def test_valid_registration_is_accepted_after_hostile_ones(harness: MarketNodeHarness) -> None:
    host = harness.ros.add(FakeHost())
    for changes, code in (
        ({"host": ""}, "BAD_NAME"),
        ({"run_action": "no such name"}, "BAD_NAME"),
        ({"heartbeat": "/" + "x" * 10_000}, "BAD_NAME"),
        ({"host_instance": ""}, "EMPTY"),
        ({"parameters": []}, "OTHER_PARAMETERS"),
        ({"heartbeat": "/bt_agents/scene"}, "UNREACHABLE"),
    ):
        answer = harness.ros.call(harness.registering, host.request(**changes))
        assert not answer.accepted
        assert answer.message.startswith(code), answer.message
        assert list(answer.agent_ids) == [0, 0]
        assert answer.epoch == "epoch"
    answer = harness.ros.call(harness.registering, host.request(agents=["Bad", GUIDE]))

    assert answer.accepted
    assert [bool(agent_id) for agent_id in answer.agent_ids] == [False, True]


def test_valid_cancel_works_after_hostile_ones(harness: MarketNodeHarness) -> None:
    host = harness.host()
    assert harness.cancel().message == "nothing runs"
    harness.scene()
    harness.until_event(Run.STARTED)
    assert not harness.cancel(epoch="earlier").accepted
    assert not harness.cancel(round=2**32 - 1).accepted
    assert host.log == ["start attentive_guide"]

    answer = harness.cancel(again=True, reason="x" * 10_000)
    assert answer.accepted
    assert "the scene as awarded is asked for again" in answer.message
    assert harness.until_event(Run.STARTED, count=2).agent == EXPRESS


def test_parameters_are_described_and_validated(ros: Any) -> None:
    harness = MarketNodeHarness(ros, bid_deadline=30.0)
    describing = harness.ros.node.create_client(
        DescribeParameters, "marketplace/describe_parameters"
    )
    setting = harness.ros.node.create_client(SetParameters, "marketplace/set_parameters")
    names = ["strategy", "bid_deadline", "on_new_scene", "tie_break", "queue_limit"]
    names += ["preempt_margin", "preempt_cooldown", "host_lease"]
    described = harness.ros.call(describing, DescribeParameters.Request(names=names)).descriptors

    assert all(descriptor.description for descriptor in described)
    assert described[1].floating_point_range[0].to_value == 60.0
    assert described[2].additional_constraints == "one of: queue, reject, preempt"

    def set_to(name: str, **value: Any) -> Any:
        parameter = ParameterMsg(name=name, value=ParameterValue(**value))
        request = SetParameters.Request(parameters=[parameter])
        return harness.ros.call(setting, request).results[0]

    double, string = ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_STRING
    assert "magic" in set_to("strategy", type=string, string_value="magic").reason
    assert not set_to("bid_deadline", type=double, double_value=-1.0).successful
    assert not set_to("bid_deadline", type=double, double_value=math.nan).successful
    assert not set_to("bid_deadline", type=string, string_value="soon").successful
    assert set_to("on_new_scene", type=string, string_value="reject").successful
    assert not set_to("on_new_scene", type=string, string_value="refuse").successful
    assert not set_to("preempt_margin", type=double, double_value=100.5).successful
    assert set_to("preempt_cooldown", type=double, double_value=0.0).successful
    assert set_to("bid_deadline", type=double, double_value=0.1).successful

    harness.host().silent = True
    harness.scene()
    harness.until_over()
    assert 0.1 <= harness.auctions[0].duration_s < 30.0


def test_stopping_the_market_stops_the_tree(harness: MarketNodeHarness) -> None:
    host = harness.host()
    harness.scene()
    harness.until_event(Run.STARTED)
    assert not harness.market.stopped()
    harness.market.request_stop()
    harness.ros.until(harness.market.stopped)

    assert host.log == ["start attentive_guide", "end attentive_guide"]


def test_market_heartbeat_names_its_epoch(harness: MarketNodeHarness) -> None:
    heard = harness.ros.collect(MarketHeartbeat, "marketplace/heartbeat", qos.EVENTS)
    harness.ros.until(lambda: len(heard) >= 5)

    assert {beat.epoch for beat in heard} == {"epoch"}
    numbers = [beat.sequence for beat in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_nearer_agent_preempts_run_for_its_own_scene(ros: Any) -> None:
    harness = MarketNodeHarness(ros, on_new_scene="preempt")
    host = harness.host()
    harness.scene("s1")
    harness.until_event(Run.STARTED)
    harness.scene("s2", 3.0, 5.0, 3.5)
    started = harness.until_event(Run.STARTED, count=2)
    host.finish()
    ros.until(lambda: len(harness.ends) == 2)

    assert [auction.outcome for auction in harness.auctions] == [
        Auction.AWARDED,
        Auction.PREEMPTS,
        Auction.AWARDED,
    ]
    assert harness.auctions[1].reason == (
        "professional_express 0.0 for the new scene, attentive_guide who runs has 5.0: better by "
        "5.0, margin 1.0: attentive_guide is stopped"
    )
    assert (started.agent, started.round, started.scene.scene_id) == (EXPRESS, 3, "s2")
    assert [(end.scene_id, end.code, end.agent) for end in harness.ends] == [
        ("s1", "PREEMPTED", GUIDE),
        ("s2", "SUCCEEDED", EXPRESS),
    ]


def test_challenge_with_silent_host_ends_at_deadline(ros: Any) -> None:
    harness = MarketNodeHarness(ros, on_new_scene="preempt")
    host = harness.host()
    harness.scene("s1")
    harness.until_event(Run.STARTED)
    host.silent = True
    harness.scene("s2", urgent=True)
    ros.until(lambda: len(harness.auctions) == 2)

    assert harness.auctions[1].outcome == Auction.WAITS
    assert list(harness.auctions[1].silent_hosts) == ["/agents"]
    assert harness.statuses[-1].state == MarketStatus.RUNNING
    host.silent = False
    host.finish()
    assert harness.until_event(Run.STARTED, count=2).scene.scene_id == "s2"


def earlier_run(harness: MarketNodeHarness, host: FakeHost, cause: int) -> Run:
    """Return a run whose end an earlier market has not received."""
    return Run(
        header=header_at(harness.market.get_clock().now().to_msg()),
        epoch="earlier",
        round=7,
        event=Run.ENDED,
        outcome=Run.CANCELLED,
        stop_cause=cause,
        scene=scene_to_msg(scene("old")),
        agent=GUIDE,
        agent_id=3,
        host=host.host,
        host_instance="first",
        message="whatever its host says",
    )


def test_unreported_run_is_recorded_and_its_scene_retried(harness: MarketNodeHarness) -> None:
    host = harness.ros.add(FakeHost())
    cut_off = earlier_run(harness, host, Run.MARKET_LOST)
    spoilt = [Run(), Run(epoch="earlier", round=8, event=Run.ENDED, outcome=77, agent=GUIDE)]
    request = host.request(unreported=[*spoilt, cut_off, cut_off])
    host.take(harness.ros.call(harness.registering, request))
    harness.ros.until(lambda: harness.ends)

    (told,) = harness.runs
    assert (told.epoch, told.round, told.outcome) == ("earlier", 7, Run.CANCELLED)
    (end,) = harness.ends
    assert (end.scene_id, end.code, end.agent) == ("old", "LOST", GUIDE)
    assert end.message.endswith("asked again as scene 'old+again'")
    harness.ros.until(lambda: harness.auctions)
    assert harness.auctions[0].scene.scene_id == "old+again"


@pytest.mark.parametrize("cause", [Run.NOT_STOPPED, Run.BY_MARKET, Run.BY_HOST, 77])
def test_deliberately_stopped_run_is_not_restarted(harness: MarketNodeHarness, cause: int) -> None:
    host = harness.ros.add(FakeHost())
    stopped = earlier_run(harness, host, cause)
    stopped.stopped_by, stopped.stop_reason = Run.OPERATOR, "it is late"
    harness.ros.call(harness.registering, host.request(unreported=[stopped]))
    harness.ros.until(lambda: harness.ends and harness.runs)

    assert [(end.scene_id, end.code) for end in harness.ends] == [("old", "CANCELLED")]
    (told,) = harness.runs
    assert (told.stopped_by, told.stop_reason) == (Run.OPERATOR, "it is late")


def test_stalled_host_finds_cancel_together_with_goal(ros: Any) -> None:
    harness = MarketNodeHarness(ros, host_lease=0.5)
    host = harness.host()
    other = harness.host("others", **{PLAIN: FAR})
    bids = host.answers

    def hang(message: Bids) -> None:
        bids.publish(message)
        ros.executor.remove_node(host)
        message.epoch = "nothing more"

    host.distort = hang
    harness.scene()
    assert harness.until_event(Run.STARTED).agent == PLAIN
    ros.executor.add_node(host)
    ros.until(lambda: host.log)
    ros.until(lambda: host.goal is None)

    assert host.log == [f"never began {GUIDE}"]
    assert other.log == [f"start {PLAIN}"]
    assert [run.agent for run in harness.runs if run.event == Run.STARTED] == [PLAIN]


def test_missed_feedback_collection_waits_for_feedback_node(ros: Any) -> None:
    harness = MarketNodeHarness(
        ros, collect_deadline=600.0
    )  # it is known to be away, so the market does not wait for it
    host = harness.host()
    harness.scene()
    harness.until_event(Run.STARTED)
    host.finish()
    status = harness.until_over()
    assert status.message.endswith("feedback is kept until the feedback node is back")
    requests: list[Any] = []

    def collect(request: Any, response: Any) -> Any:
        requests.append(request)
        return response

    ros.node.create_service(CollectFeedback, "feedback/collect", collect, qos_profile=qos.SERVICE)
    ros.until(lambda: requests)
    ros.turns()

    assert [(request.epoch, request.round) for request in requests] == [("epoch", 1)]
    assert [end.code for end in harness.ends] == ["SUCCEEDED"]


def test_simultaneous_end_of_full_queue_is_announced_completely(ros: Any) -> None:
    harness = MarketNodeHarness(ros, queue_limit=100, host_lease=0.5, host_wait=0.2)
    ends = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.FACTS)
    auctions = ros.collect(Auction, "bt_agents/auctions", qos.FACTS)
    host = harness.host()
    for number in range(101):
        harness.scene(f"s{number}")
    ros.until(lambda: harness.statuses[-1].queued == 100)
    ros.remove(host)
    ros.until(lambda: len(ends) >= 101 and len(auctions) >= 102)

    assert [(end.scene_id, end.code) for end in ends] == [
        ("s0", "LOST"),
        *((f"s{number}", "NO_BIDS") for number in range(1, 101)),
    ]
    late = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.FACTS)
    ros.until(lambda: len(late) >= len(ends))
    assert late == ends


def test_run_of_supposedly_refused_goal_is_cancelled(harness: MarketNodeHarness) -> None:
    host = harness.host()
    host.refuses = {GUIDE, EXPRESS}
    harness.scene()
    assert harness.until_over().state == MarketStatus.IDLE
    host.refuses = set()
    runner = ActionClient(harness.ros.node, RunAgent, "agents/run")
    harness.ros.until(runner.server_is_ready)
    goal = runner.send_goal_async(RunAgent.Goal(epoch="epoch", round=1, agent=GUIDE))

    harness.ros.until(lambda: host.log == ["start attentive_guide", "end attentive_guide"])
    assert goal.result().accepted
    runner.destroy()


def test_bad_market_file_stops_only_market_using_it(ros: Any, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "market.yaml").write_text(
        "format: 1\nrules:\n  - {when: scene.agee < 2, agents: [ann]}\n"
    )
    configuration = read_configuration(tmp_path)
    assert ros.add(MarketplaceNode(configuration)).is_active

    for name in ("strategy", "shadow_strategy"):
        with pytest.raises(ReadError, match="agee"):
            MarketplaceNode(configuration, parameter_overrides=[Parameter(name, value="rules")])
