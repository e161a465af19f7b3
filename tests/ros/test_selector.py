# SPDX-License-Identifier: Apache-2.0
"""Market, selector and model server together: good answers, bad ones, and a dead server."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from bt_agents_interfaces.msg import AgentCard, Auction, HostCard, Scene
from bt_agents_interfaces.srv import SelectAgent
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from market_harness import EXPRESS, GUIDE, SPACE, scene
from market_node_harness import MarketNodeHarness
from marketplace_node.external_ranking.openai_protocol import Endpoint
from marketplace_node.node.selector import SelectorNode
from model_server import ModelServer, drips, model_server, says


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with model_server() as running:
        yield running


def decide(ros: Any, *, url: str = "", limit_s: float = 10.0, cards: int = 0) -> Auction:
    """Hold one round with the strategy ``external``; return the decision.

    With a ``url``, first wait until the selector has this many cards.
    """
    harness = MarketNodeHarness(ros, strategy="external", **{"external.limit": limit_s})
    if url:
        selector = ros.add(SelectorNode(SPACE, Endpoint(base_url=url, model="small")))
        ros.until(lambda: len(selector.descriptions) == cards)
        ros.until(lambda: harness.market.selector.service_is_ready())
    harness.busy_host().finish()
    harness.until_over()
    [auction] = harness.auctions
    assert harness.runs[0].agent == auction.winner
    return auction


def test_model_chooses_winner(ros: Any, server: ModelServer) -> None:
    server.reply = says(EXPRESS, GUIDE, reason="in a hurry")
    cards = ros.node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
    card = AgentCard(name=GUIDE, title="Guide", description="Slow and loud")
    cards.publish(HostCard(host="/agents", agents=[card]))
    auction = decide(ros, url=server.url, cards=1)

    assert auction.winner == EXPRESS
    assert "in a hurry" in auction.reason + auction.explanation
    told = json.loads(server.questions[0]["messages"][1]["content"])
    assert {character["name"] for character in told["characters"]} == {GUIDE, EXPRESS}
    [described] = [c["description"] for c in told["characters"] if "description" in c]
    assert described == "Guide. Slow and loud"


def test_slow_server_falls_back_to_distance(ros: Any, server: ModelServer) -> None:
    server.reply = drips(b"HTTP/1.0 200 OK\r\n" * 100, server.ended)
    auction = decide(ros, url=server.url, limit_s=0.3)

    assert auction.winner == GUIDE
    assert "did not answer" in auction.reason


def test_missing_selector_does_not_delay_round(ros: Any) -> None:
    auction = decide(ros)

    assert auction.winner == GUIDE
    assert "no selector serves 'bt_agents/select'" in auction.reason
    assert auction.duration_s < 5.0, "it waits neither for a deadline nor for a server"


def test_hostile_questions_are_refused(ros: Any, server: ModelServer) -> None:
    ros.add(SelectorNode(SPACE, Endpoint(base_url=server.url, model="small")))
    client = ros.node.create_client(SelectAgent, "bt_agents/select", qos_profile=qos.SERVICE)
    fields: dict[str, Any] = {
        "limit_s": 5.0,
        "scene": scene_to_msg(scene("s1")),
        "agents": [GUIDE, EXPRESS],
        "vectors": [1.0] * 6,
        "distances": [1.0, 2.0],
    }
    for changes in (
        {"vectors": [1.0]},
        {"distances": []},
        {"distances": [float("nan"), 1.0]},
        {"vectors": [float("nan")] * 6},
        {"limit_s": float("nan")},
        {"limit_s": 0.0},
        {"scene": Scene()},
    ):
        answer = ros.call(client, SelectAgent.Request(**(fields | changes)))
        assert not answer.accepted, changes
        assert answer.message
    assert server.questions == []
