# SPDX-License-Identifier: Apache-2.0
"""Services of operators over real DDS: orders, previews, and switches of strategy."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from bt_agents_core.scene import Origin, SceneSpace
from bt_agents_interfaces.msg import Auction, MarketStatus, Run, Scene, SceneValue
from bt_agents_interfaces.srv import OperateMarket, PreviewAuction
from bt_agents_ros.messages import scene_to_msg
from market_harness import EXPRESS, GUIDE, SPACE, scene
from market_node_harness import MarketNodeHarness
from marketplace_node.node.messages import scene_or_last


class OperatorClient:
    """An operator at a market with one host."""

    def __init__(self, ros: Any, **parameters: Any) -> None:
        self.ros = ros
        self.harness = MarketNodeHarness(ros, **parameters)
        self.host = self.harness.host()

    def operate(self, action: int, agent: str = "", **fields: Any) -> OperateMarket.Response:
        order = {"action": action, "agent": agent, "author": "anna", **fields}
        return self.ros.ask(OperateMarket, "marketplace/operate", **order)

    def preview(self, **fields: Any) -> PreviewAuction.Response:
        return self.ros.ask(PreviewAuction, "marketplace/preview", **fields)

    def set(self, **values: str | float) -> Any:
        parameters = [
            Parameter(name.replace("__", "."), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
        service = "marketplace/set_parameters_atomically"
        return self.ros.ask(SetParametersAtomically, service, parameters=parameters).result

    def play(self, scene_id: str) -> Auction:
        """Play a scene to its end; return the decision."""
        started = len([run for run in self.harness.runs if run.event == Run.STARTED])
        self.harness.scene(scene_id)
        self.harness.until_event(Run.STARTED, count=started + 1)
        self.host.finish()
        self.harness.until_over(scene_id)
        return self.harness.auctions[-1]

    @property
    def status(self) -> MarketStatus:
        return self.harness.statuses[-1]


@pytest.fixture
def operator(ros: Any) -> OperatorClient:
    return OperatorClient(ros)


def test_pins_vetoes_and_their_ends_are_published(operator: OperatorClient) -> None:
    assert operator.operate(OperateMarket.Request.PIN, EXPRESS, reason="a film crew").accepted
    auction = operator.play("s1")
    assert auction.winner == EXPRESS
    assert [(bid.agent, bid.code) for bid in auction.refused] == [(GUIDE, "NOT_PINNED")]
    assert auction.intervention == "anna pins professional_express: a film crew"
    assert list(operator.host.calls[-1].excluded) == [GUIDE]

    assert operator.operate(OperateMarket.Request.UNPIN).accepted
    assert operator.operate(OperateMarket.Request.VETO, GUIDE).accepted
    operator.ros.until(lambda: list(operator.status.vetoed) == [GUIDE])
    assert operator.status.pinned == ""
    assert operator.play("s2").winner == EXPRESS
    assert operator.operate(OperateMarket.Request.ALLOW, GUIDE).accepted
    assert operator.play("s3").winner == GUIDE


def test_award_gives_last_scene_to_chosen_agent(operator: OperatorClient) -> None:
    operator.play("s1")
    answer = operator.operate(OperateMarket.Request.AWARD, EXPRESS)
    started = operator.harness.until_event(Run.STARTED, count=2)

    assert answer.accepted, answer.message
    assert (started.agent, started.scene.scene_id) == (EXPRESS, "s1+award1")


def test_hostile_orders_are_refused(operator: OperatorClient) -> None:
    pin, award = OperateMarket.Request.PIN, OperateMarket.Request.AWARD
    infinite = Scene(scene_id="x", values=[SceneValue(name="age", value=math.inf)])
    nameless = Scene(values=[SceneValue(name="age", value=1.0)])
    for fields, code in (
        ({"action": 99, "agent": GUIDE}, "UNKNOWN_ACTION"),
        ({"action": pin, "agent": "x" * 10_000}, "UNKNOWN_AGENT"),
        ({"action": award, "agent": GUIDE}, "NO_SCENE"),
        ({"action": award, "agent": GUIDE, "scene": infinite}, "ORIGIN_MISMATCH"),
        ({"action": award, "agent": GUIDE, "scene": nameless}, "EMPTY"),
    ):
        answer = operator.operate(**fields)
        assert (answer.accepted, answer.code) == (False, code)
        assert answer.message


def test_preview_asks_hosts_and_changes_no_run(operator: OperatorClient) -> None:
    operator.harness.scene()
    operator.harness.until_event(Run.STARTED)
    answer = operator.preview(scene=scene_to_msg(scene("p", 3.0, 5.0, 3.5)))
    of_last = operator.preview(strategy="euclidean")

    assert answer.accepted, answer.message
    assert answer.auction.preview
    assert [bid.agent for bid in answer.auction.ranking] == [EXPRESS, GUIDE]
    assert answer.auction.explanation
    assert of_last.accepted, of_last.message
    assert (of_last.auction.strategy, of_last.auction.scene.scene_id) == ("euclidean", "s1")
    assert operator.status.state == MarketStatus.RUNNING
    assert [auction.winner for auction in operator.harness.auctions] == [GUIDE]
    operator.host.finish()
    assert operator.harness.until_over("s1").round == 1
    assert operator.host.log == ["start attentive_guide", "end attentive_guide"]


def test_preview_fills_missing_values_like_scene_layer() -> None:
    age, *others = SPACE.parameters
    space = SceneSpace(parameters=(replace(age, assumed=2.0), *others), mood="mood")
    asked = scene_or_last(scene_to_msg(scene("p", math.nan, math.nan, 3.5)), space)

    assert asked is not None
    origins = [value.origin for value in asked.values]
    assert origins == [Origin.DEFAULT, Origin.MISSING, Origin.GIVEN]
    assert asked.get("age") == 2.0


def test_concurrent_previews_are_all_answered(ros: Any) -> None:
    operator = OperatorClient(ros, bid_deadline=30.0)
    operator.host.silent = True
    client = ros.node.create_client(PreviewAuction, "marketplace/preview")
    ros.until(client.service_is_ready)
    request = PreviewAuction.Request(scene=scene_to_msg(scene("p")))
    futures = [client.call_async(request) for _ in range(12)]
    # No preview ends before all are asked for.
    ros.until(lambda: sum(future.done() for future in futures) == 4)
    ros.until(lambda: len(operator.host.calls) == 8)
    operator.host.silent = False
    for call in list(operator.host.calls):
        operator.host.answer(call)
    ros.until(lambda: all(future.done() for future in futures))
    codes = [future.result().code for future in futures]

    assert sorted(codes) == [""] * 8 + ["BUSY"] * 4


def test_strategy_can_be_switched_at_runtime(operator: OperatorClient) -> None:
    assert operator.play("s1").strategy == "manhattan"
    assert operator.set(strategy="softmax", softmax__temperature=0.25).successful
    auction = operator.play("s2")

    assert auction.strategy == "softmax"
    assert dict(zip(auction.option_names, auction.option_values, strict=True)) == {
        "temperature": 0.25
    }
    assert auction.seed == "epoch/2"
    assert operator.status.strategy == "softmax"
    told = operator.status.strategies
    options = {strategy.name: list(strategy.options) for strategy in told}
    assert (options["softmax"], options["manhattan"]) == (["temperature"], [])
    assert all(strategy.description for strategy in told)


def test_shadow_strategy_rounds_and_disagreements_are_published(operator: OperatorClient) -> None:
    operator.host.bids_of = {GUIDE: (5.0, 4.0, 3.0), EXPRESS: (3.0, 2.0, 4.0)}
    assert operator.set(shadow_strategy="euclidean").successful
    first, second = operator.play("s1"), operator.play("s2")

    assert (first.winner, first.shadow_winner) == (GUIDE, EXPRESS)
    assert (second.shadow_rounds, second.shadow_disagreements) == (2, 2)
    assert operator.status.shadow_strategy == "euclidean"


def test_ranked_bid_contains_everything_replay_needs(ros: Any) -> None:
    operator = OperatorClient(ros, starvation_rounds=2)
    operator.play("s1")
    auction = operator.play("s2")
    bid = auction.ranking[0]

    assert list(bid.contributions) == [1.0, 0.5, 0.0]
    assert math.fsum(bid.contributions) == bid.distance == bid.score
    assert (bid.runs, bid.last_run, bid.bonus) == (1, 1, 0.0)
    assert auction.tie_break == "least_recently_run"
    assert [value.name for value in auction.scene.values] == list(SPACE.names)
    assert list(operator.status.starved) == [EXPRESS]


@pytest.mark.parametrize("stored", [b"\xff{", b"{", b" " * (16 * 1024 * 1024 + 1)])
def test_unreadable_files_do_not_stop_market(ros: Any, tmp_path: Path, stored: bytes) -> None:
    path, orders = tmp_path / "scenes.json", tmp_path / "orders.json"
    path.write_bytes(stored)
    orders.write_bytes(stored)
    operator = OperatorClient(ros, scenes_file=path, overrides_file=orders)
    assert (operator.status.pinned, list(operator.status.vetoed)) == ("", [])
    assert operator.play("s1").winner == GUIDE
    ros.until(lambda: b'"scenes": [], "taken": ["s1"]' in path.read_bytes())
