# SPDX-License-Identifier: Apache-2.0
"""The marketplace node among hosts that behave well, badly or not at all."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
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
from market_node_harness import FAR, HOST_TIME, FakeHost, MarketNodeHarness
from marketplace_node.node import MarketplaceNode, read_configuration

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


def serve_feedback(ros: Any) -> list[CollectFeedback.Request]:
    """Answer collections from now on; return the list of their requests."""
    requests: list[CollectFeedback.Request] = []

    def collect(request: Any, response: Any) -> Any:
        requests.append(request)
        response.message = "the guide has learned"
        return response

    ros.node.create_service(CollectFeedback, "feedback/collect", collect, qos_profile=qos.SERVICE)
    return requests


def test_feedback_is_collected_from_the_service(ros: Any) -> None:
    harness = MarketNodeHarness(ros, collect_deadline=5.0)
    requests = serve_feedback(ros)
    harness.busy_host().finish(RunAgent.Result.FAILED)
    status = harness.until_over()

    assert [(r.round, r.agent, r.outcome) for r in requests] == [(1, GUIDE, Run.FAILED)]
    assert status.message.endswith("the guide has learned")


@pytest.mark.parametrize(
    ("answer", "words"), [("refuses", ""), ("explains", " (BUSY: another tree runs)")]
)
def test_refused_run_goes_to_next_best_agent(
    harness: MarketNodeHarness, answer: str, words: str
) -> None:
    host = harness.host()
    setattr(host, answer, {GUIDE})
    harness.scene()

    refused = harness.until_event(Run.REFUSED)
    assert (refused.agent, refused.message) == (GUIDE, f"/agents refused it{words}")
    assert harness.until_event(Run.STARTED).agent == EXPRESS
    host.finish()
    harness.until_over()
    assert [run.agent for run in harness.runs if run.event == Run.STARTED] == [EXPRESS]


def test_mood_change_hands_over_to_another_agent(harness: MarketNodeHarness) -> None:
    host = harness.busy_host()
    live = scene_to_msg(scene("s1", 5.0, 1.0, 1.0))
    why = {"reason": "bored", "by": Run.MOOD_RULE}
    assert harness.cancel(epoch="epoch", round=1, again=True, scene=live, **why).accepted
    assert harness.until_event(Run.STARTED, count=2).agent == EXPRESS
    host.finish()
    harness.until_over("s1")

    assert host.log == [
        "start attentive_guide",
        "end attentive_guide",
        "start professional_express",
        "end professional_express",
    ]
    assert [(run.event, run.stopped_by, run.stop_reason) for run in harness.runs[1:3]] == [
        (event, Run.MOOD_RULE, "bored") for event in (Run.CANCELLING, Run.ENDED)
    ]
    assert list(host.calls[1].excluded) == [GUIDE]
    assert harness.auctions[1].follows == 1
    assert harness.auctions[1].scene.scene_id == "s1+1"


def test_valid_scene_is_accepted_after_hostile_ones(
    ros: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    harness = MarketNodeHarness(ros, host_wait=0.5)
    good = scene_to_msg(scene("s1"))
    unknown = [SceneValue(name=name, value=1.0, origin=77) for name in SPACE.names]
    harness.scenes.publish(Scene(scene_id="unknown", values=unknown))
    harness.scenes.publish(Scene(scene_id="twice", values=[*good.values] * 2))
    harness.scenes.publish(Scene(scene_id="", values=good.values))
    harness.scenes.publish(Scene(scene_id="x" * 10_000, values=[]))
    harness.scenes.publish(Scene(scene_id="long", label="x" * 1001))
    harness.scene("s1")
    harness.scene("s1")
    harness.ros.until(lambda: len(harness.ends) == 6)

    assert [(end.scene_id, end.code) for end in harness.ends] == [
        ("unknown", "UNKNOWN_ORIGIN"),
        ("twice", "DUPLICATE_PARAMETER"),
        ("x" * 200, "TOO_LONG"),
        ("long", "TOO_LONG"),
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
        ({"heartbeat": "/" + "x" * 10_000}, "BAD_NAME"),
        ({"parameters": []}, "OTHER_PARAMETERS"),
        ({"heartbeat": "/bt_agents/scene"}, "UNREACHABLE"),
    ):
        answer = harness.ros.call(harness.registering, host.request(**changes))
        assert not answer.accepted
        assert answer.message.startswith(code), answer.message
        assert answer.epoch == "epoch"
    answer = harness.ros.call(harness.registering, host.request(agents=["Bad", GUIDE]))

    assert answer.accepted
    assert [bool(agent_id) for agent_id in answer.agent_ids] == [False, True]


def test_valid_cancel_works_after_hostile_ones(harness: MarketNodeHarness) -> None:
    assert harness.cancel().message == "nothing runs"
    host = harness.busy_host()
    assert not harness.cancel(epoch="earlier").accepted
    assert not harness.cancel(round=2**32 - 1).accepted
    assert host.log == ["start attentive_guide"]

    answer = harness.cancel(again=True, reason="x" * 10_000)
    assert answer.accepted
    assert "the scene as awarded is asked for again" in answer.message
    assert harness.until_event(Run.STARTED, count=2).agent == EXPRESS


def test_parameters_are_described_and_validated(ros: Any) -> None:
    harness = MarketNodeHarness(ros, bid_deadline=30.0)
    names = ["strategy", "bid_deadline", "on_new_scene", "tie_break", "queue_limit"]
    names += ["preempt_margin", "preempt_cooldown", "host_lease"]
    options = ["softmax.temperature", "ucb.c", "external.limit", "epsilon_greedy.epsilon"]
    service = "marketplace/describe_parameters"
    described = ros.ask(DescribeParameters, service, names=names + options).descriptors

    assert all(descriptor.description for descriptor in described)
    assert all(descriptor.floating_point_range for descriptor in described[-len(options) :])
    assert described[1].floating_point_range[0].to_value == 60.0
    assert described[2].additional_constraints == "one of: queue, reject, preempt"

    for name, value, words in (
        ("strategy", "magic", "expected one of manhattan"),
        ("shadow_strategy", "external", "NO_SHADOW"),
        ("softmax.temperature", -1.0, "-1"),
        ("bid_deadline", -1.0, "-1"),
        ("bid_deadline", math.nan, "nan"),
        ("bid_deadline", "soon", "type"),
        ("on_new_scene", "reject", ""),
        ("on_new_scene", "refuse", "refuse"),
        ("preempt_margin", 100.5, "100.5"),
        ("preempt_cooldown", 0.0, ""),
        ("bid_deadline", 0.1, ""),
    ):
        parameter = Parameter(name, value=value).to_parameter_msg()
        asked = ros.ask(SetParameters, "marketplace/set_parameters", parameters=[parameter])
        [answer] = asked.results
        assert answer.successful is (words == "")
        assert words in answer.reason

    harness.host().silent = True
    harness.scene()
    harness.until_over()
    assert 0.1 <= harness.auctions[0].duration_s < 30.0


def test_market_heartbeat_names_its_epoch(harness: MarketNodeHarness) -> None:
    heard = harness.ros.collect(MarketHeartbeat, "marketplace/heartbeat", qos.EVENTS)
    harness.ros.until(lambda: len(heard) >= 5)

    assert {beat.epoch for beat in heard} == {"epoch"}
    numbers = [beat.sequence for beat in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_challenge_with_silent_host_ends_at_deadline(ros: Any) -> None:
    harness = MarketNodeHarness(ros, on_new_scene="preempt")
    host = harness.busy_host()
    host.silent = True
    harness.scene("s2", urgent=True)
    ros.until(lambda: len(harness.auctions) == 2)

    assert harness.auctions[1].outcome == Auction.WAITS
    assert list(harness.auctions[1].silent_hosts) == ["/agents"]
    assert harness.statuses[-1].state == MarketStatus.RUNNING
    host.silent = False
    host.finish()
    assert harness.until_event(Run.STARTED, count=2).scene.scene_id == "s2"


def earlier_run(host: FakeHost, cause: int) -> Run:
    """Return a run whose end an earlier market has not received."""
    return Run(
        header=header_at(HOST_TIME),
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
    cut_off = earlier_run(host, Run.MARKET_LOST)
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
    stopped = earlier_run(host, cause)
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
    harness.busy_host().finish()
    status = harness.until_over()
    assert status.message.endswith("feedback is kept until the feedback node is back")
    requests = serve_feedback(ros)
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
