# SPDX-License-Identifier: Apache-2.0
"""The services of operators over real DDS: a say, previews, and strategies that are switched."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically

from bt_agents_interfaces.msg import Auction, MarketStatus, Run, Scene, SceneValue
from bt_agents_interfaces.srv import OperateMarket, PreviewAuction
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from market_harness import EXPRESS, GUIDE, SPACE, scene
from market_node_harness import Stage
from marketplace_node.node import MarketplaceNode

pytestmark = pytest.mark.ros


class Desk:
    """An operator at a market with one host."""

    def __init__(self, ros: Any, **parameters: Any) -> None:
        self.ros = ros
        self.stage = Stage(ros, **parameters)
        self.host = self.stage.host()
        make = ros.node.create_client
        self.operating = make(OperateMarket, "marketplace/operate", qos_profile=qos.SERVICE)
        self.previewing = make(PreviewAuction, "marketplace/preview", qos_profile=qos.SERVICE)
        self.setting = make(
            SetParametersAtomically,
            "marketplace/set_parameters_atomically",
            qos_profile=qos.SERVICE,
        )

    def operate(self, action: int, agent: str = "", **fields: Any) -> OperateMarket.Response:
        request = OperateMarket.Request(action=action, agent=agent, author="anna", **fields)
        return self.ros.call(self.operating, request)

    def preview(self, **fields: Any) -> PreviewAuction.Response:
        return self.ros.call(self.previewing, PreviewAuction.Request(**fields))

    def set(self, **values: str | float) -> Any:
        parameters = []
        for name, value in values.items():
            typed = (
                ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
                if isinstance(value, str)
                else ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
            )
            parameters.append(ParameterMsg(name=name.replace("__", "."), value=typed))
        request = SetParametersAtomically.Request(parameters=parameters)
        return self.ros.call(self.setting, request).result

    def play(self, scene_id: str) -> Auction:
        """Have a scene played to its end; return the decision."""
        started = len([run for run in self.stage.runs if run.event == Run.STARTED])
        self.stage.scene(scene_id)
        self.stage.until_event(Run.STARTED, count=started + 1)
        self.host.finish()
        self.stage.until_over(scene_id)
        return self.stage.auctions[-1]

    @property
    def status(self) -> MarketStatus:
        return self.stage.statuses[-1]


@pytest.fixture
def desk(ros: Any) -> Desk:
    return Desk(ros)


def test_a_pin_a_veto_and_their_ends_are_seen_by_all(desk: Desk) -> None:
    assert desk.operate(OperateMarket.Request.PIN, EXPRESS, reason="a film crew").accepted
    auction = desk.play("s1")
    assert auction.winner == EXPRESS
    assert [(bid.agent, bid.code) for bid in auction.refused] == [(GUIDE, "NOT_PINNED")]
    assert auction.intervention == "anna pins professional_express: a film crew"
    assert list(desk.host.calls[-1].excluded) == [GUIDE]

    assert desk.operate(OperateMarket.Request.UNPIN).accepted
    assert desk.operate(OperateMarket.Request.VETO, GUIDE).accepted
    desk.ros.until(lambda: list(desk.status.vetoed) == [GUIDE])
    assert desk.status.pinned == ""
    assert desk.play("s2").winner == EXPRESS
    assert desk.operate(OperateMarket.Request.ALLOW, GUIDE).accepted
    assert desk.play("s3").winner == GUIDE


def test_a_veto_stops_the_run_and_the_next_agent_takes_over(desk: Desk) -> None:
    desk.stage.scene()
    desk.stage.until_event(Run.STARTED)
    answer = desk.operate(OperateMarket.Request.VETO, GUIDE)

    assert answer.accepted
    assert "told to stop" in answer.message
    assert desk.stage.until_event(Run.STARTED, count=2).agent == EXPRESS


def test_an_award_gives_the_last_scene_to_somebody_else(desk: Desk) -> None:
    desk.play("s1")
    answer = desk.operate(OperateMarket.Request.AWARD, EXPRESS)
    started = desk.stage.until_event(Run.STARTED, count=2)

    assert answer.accepted, answer.message
    assert (started.agent, started.scene.scene_id) == (EXPRESS, "s1+award1")


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"action": 99, "agent": GUIDE}, "UNKNOWN_ACTION"),
        ({"action": OperateMarket.Request.PIN, "agent": "x" * 100_000}, "UNKNOWN_AGENT"),
        ({"action": OperateMarket.Request.AWARD, "agent": GUIDE}, "NO_SCENE"),
        (
            {
                "action": OperateMarket.Request.AWARD,
                "agent": GUIDE,
                "scene": Scene(scene_id="x", values=[SceneValue(name="age", value=math.inf)]),
            },
            "ORIGIN_MISMATCH",
        ),
        (
            {
                "action": OperateMarket.Request.AWARD,
                "agent": GUIDE,
                "scene": Scene(values=[SceneValue(name="age", value=1.0)]),
            },
            "EMPTY",
        ),
    ],
)
def test_hostile_orders_are_refused(desk: Desk, fields: dict[str, Any], code: str) -> None:
    answer = desk.operate(**fields)

    assert (answer.accepted, answer.code) == (False, code)
    assert answer.message


def test_a_preview_asks_the_hosts_and_gives_nobody_a_run(desk: Desk) -> None:
    wanted = scene_to_msg(scene("p", 3.0, 5.0, 3.5))
    answer = desk.preview(scene=wanted)

    assert answer.accepted, answer.message
    assert answer.auction.preview
    assert [bid.agent for bid in answer.auction.ranking] == [EXPRESS, GUIDE]
    assert answer.auction.explanation
    assert desk.stage.auctions == []
    assert desk.host.log == []


def test_a_preview_during_a_run_lets_it_go_on(desk: Desk) -> None:
    desk.stage.scene()
    desk.stage.until_event(Run.STARTED)
    answer = desk.preview(strategy="euclidean")

    assert answer.accepted, answer.message
    assert answer.auction.strategy == "euclidean"
    assert answer.auction.scene.scene_id == "s1"
    assert desk.status.state == MarketStatus.RUNNING
    desk.host.finish()
    assert desk.stage.until_over("s1").round == 1


def test_previews_at_once_are_all_answered(desk: Desk) -> None:
    desk.host.silent = True
    desk.ros.until(desk.previewing.service_is_ready)
    request = PreviewAuction.Request(scene=scene_to_msg(scene("p")))
    futures = [desk.previewing.call_async(request) for _ in range(12)]
    desk.ros.until(lambda: all(future.done() for future in futures))
    codes = [future.result().code for future in futures]

    assert sorted(codes) == [""] * 8 + ["BUSY"] * 4


@pytest.mark.parametrize(
    ("fields", "code"),
    [({}, "NO_SCENE"), ({"strategy": "magic", "scene": scene("p")}, "UNKNOWN_STRATEGY")],
)
def test_hostile_previews_are_refused(desk: Desk, fields: dict[str, Any], code: str) -> None:
    if "scene" in fields:
        fields = fields | {"scene": scene_to_msg(fields["scene"])}
    answer = desk.preview(**fields)

    assert (answer.accepted, answer.code) == (False, code)


def test_a_strategy_is_switched_while_the_market_works(desk: Desk) -> None:
    assert desk.play("s1").strategy == "manhattan"
    assert desk.set(strategy="softmax", softmax__temperature=0.25).successful
    auction = desk.play("s2")

    assert auction.strategy == "softmax"
    assert dict(zip(auction.option_names, auction.option_values, strict=True)) == {
        "temperature": 0.25
    }
    assert auction.seed == "epoch/2"
    assert desk.status.strategy == "softmax"


def test_what_makes_no_sense_is_refused_with_what_does(desk: Desk) -> None:
    refused = desk.set(strategy="magic")
    assert not refused.successful
    assert "expected one of manhattan" in refused.reason
    assert not desk.set(shadow_strategy="external").successful
    assert not desk.set(softmax__temperature=-1.0).successful
    assert desk.play("s1").strategy == "manhattan"


def test_every_option_is_described_with_its_range(desk: Desk) -> None:
    client = desk.ros.node.create_client(
        DescribeParameters, "marketplace/describe_parameters", qos_profile=qos.SERVICE
    )
    names = ["softmax.temperature", "ucb.c", "external.limit", "epsilon_greedy.epsilon"]
    told = desk.ros.call(client, DescribeParameters.Request(names=names)).descriptors

    assert [bool(one.description and one.floating_point_range) for one in told] == [True] * 4


def test_a_shadow_is_counted_and_seen(desk: Desk) -> None:
    desk.host.bids_of = {GUIDE: (5.0, 4.0, 3.0), EXPRESS: (3.0, 2.0, 4.0)}
    assert desk.set(shadow_strategy="euclidean").successful
    first, second = desk.play("s1"), desk.play("s2")

    assert (first.winner, first.shadow_winner) == (GUIDE, EXPRESS)
    assert (second.shadow_rounds, second.shadow_disagreements) == (2, 2)
    assert desk.status.shadow_strategy == "euclidean"


def test_a_ranked_bid_holds_all_that_replay_needs(desk: Desk) -> None:
    desk.play("s1")
    auction = desk.play("s2")
    bid = auction.ranking[0]

    assert list(bid.contributions) == [1.0, 0.5, 0.0]
    assert math.fsum(bid.contributions) == bid.distance == bid.score
    assert (bid.runs, bid.last_run, bid.bonus) == (1, 1, 0.0)
    assert auction.tie_break == "least_recently_run"
    assert [value.name for value in auction.scene.values] == list(SPACE.names)


def test_a_starved_agent_is_seen_in_the_status(ros: Any) -> None:
    desk = Desk(ros, starvation_rounds=2)
    desk.play("s1")
    desk.play("s2")

    assert list(desk.status.starved) == [EXPRESS]


def test_pins_and_vetoes_outlive_a_market(ros: Any, tmp_path: Path) -> None:
    path = tmp_path / "state" / "orders.json"
    desk = Desk(ros, overrides_file=path)
    assert desk.operate(OperateMarket.Request.VETO, GUIDE).accepted
    assert desk.operate(OperateMarket.Request.PIN, EXPRESS).accepted
    ros.remove(desk.stage.market)
    ros.add(MarketplaceNode(SPACE, "again", overrides_file=path))
    ros.until(lambda: desk.status.epoch == "again" and desk.status.pinned)

    assert (desk.status.pinned, list(desk.status.vetoed)) == (EXPRESS, [GUIDE])


def test_a_file_of_orders_that_cannot_be_read_stops_nothing(ros: Any, tmp_path: Path) -> None:
    path = tmp_path / "orders.json"
    path.write_bytes(b"\xff{")
    desk = Desk(ros, overrides_file=path)

    assert (desk.status.pinned, list(desk.status.vetoed)) == ("", [])
    assert desk.play("s1").winner == GUIDE
