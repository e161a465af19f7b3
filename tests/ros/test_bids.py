# SPDX-License-Identifier: Apache-2.0
"""Answers of hosts as bytes: encoding and decoding preserve their meaning."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from rclpy.serialization import deserialize_message, serialize_message

from bt_agents.host.agent_registry import AgentRegistry
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Bids
from bt_agents_ros import bid_encoding
from bt_agents_ros.bid_encoding import BidEncoder
from marketplace_node.node.messages import BidDecoder, bids_from_msg
from tree_harness import SPACE, agent, scene

EPOCHS = ("0123456789ab", "e", "another market, äöü")
WEIGHTS = {"a": (1.0, 1.0, 1.0), "b": (2.0, 1.0, 1.0)}
TOKEN = list(range(16))
ROUNDS = (1, 2, 255, 256, 2**31 + 1, 2**32 - 1)


def registry() -> AgentRegistry:
    ours = AgentRegistry(SPACE, [agent("say: x", "requires: scene.age >= 3")])
    ours.add(replace(agent("say: x", "weights: {age: 2}"), name="b"))
    ours.apply_registration(["a", "b"], [7, 8], ["", ""])
    return ours


def expected(epoch: str, number: int, answer: Any, token: list[int] = TOKEN) -> Bids:
    return Bids(
        epoch=epoch,
        round=number,
        host="/agents",
        host_instance="first",
        token=token,
        agents=[member.spec.name for member in answer.bidders.members],
        agent_ids=[member.agent_id for member in answer.bidders.members],
        vectors=[value for member in answer.bidders.members for value in member.profile],
        weights=sum((WEIGHTS[one.spec.name] for one in answer.bidders.members), ()),
        declined=list(answer.declined),
        decline_reasons=[one.reason for one in answer.declined.values()],
        unmet=[one.unmet for one in answer.declined.values()],
    )


def test_encoded_bids_match_answers_in_every_round() -> None:
    saying, ours = BidEncoder("/agents", "first"), registry()
    for age in (2, 2, 3, 3, 2):
        for epoch in EPOCHS:
            for number in ROUNDS:
                answer = ours.bids_for(scene(age=age))
                message = saying.message(epoch, number, TOKEN, answer)
                assert deserialize_message(message, Bids) == expected(epoch, number, answer)
    ours.set_profile("b", [1.0, 2.0, 3.0], 1)
    answer = ours.bids_for(scene(age=2))
    for token in (TOKEN, TOKEN[::-1]):
        message = saying.message("e", 9, token, answer)
        assert deserialize_message(message, Bids) == expected("e", 9, answer, token)


def test_padding_between_fields_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    fills = iter(range(256))

    def serialize(message: Bids) -> bytes:
        made = bytearray(serialize_message(message))
        end = 8 + made[4]  # a header of four bytes, the length of the epoch, and the epoch
        gap = -end % 4
        made[end : end + gap] = bytes([next(fills)] * gap)
        return bytes(made)

    monkeypatch.setattr(bid_encoding, "serialize_message", serialize)
    bid_encoding._before.cache_clear()
    answer = registry().bids_for(scene(age=3))
    for epoch in EPOCHS:
        message = BidEncoder("/agents", "first").message(epoch, 3, TOKEN, answer)
        assert deserialize_message(message, Bids) == expected(epoch, 3, answer)


@pytest.mark.parametrize("epoch", EPOCHS)
def test_market_decodes_repeated_bids_correctly(epoch: str) -> None:
    hearing = BidDecoder(epoch, {"/agents", "/b"}.__contains__)
    said = [
        Bids(epoch=of, round=number, host=host, agents=["a"], agent_ids=[7], vectors=[age, 2.0])
        for age in (1.0, 1.0, 4.0, 1.0)
        for host in ("/agents", "/b", "/stranger")
        for number in ROUNDS
        for of in (epoch, "of somebody else")
    ]
    for message in said:
        assert hearing.read(serialize_message(message)) == bids_from_msg(message)
    hearing.forget("/agents")
    hearing.forget("/nobody")
    assert hearing.read(serialize_message(said[0])) == bids_from_msg(said[0])


def test_bids_in_other_byte_order_are_not_compared() -> None:
    message = serialize_message(Bids(epoch="e", round=1, host="/agents"))
    assert bid_encoding.round_of(message, message, "e") == 1
    other = bytes([message[0], message[1] ^ 1]) + message[2:]
    assert bid_encoding.round_of(other, other, "e") is None


@pytest.mark.parametrize("cut", [0, 1, 4, 8, 20, 23, 40])
def test_malformed_bids_are_refused(cut: int) -> None:
    whole = serialize_message(Bids(epoch="0123456789ab", host="/agents", agents=["a"] * 99))
    hearing = BidDecoder("0123456789ab", "/agents".__eq__)
    with pytest.raises(Refused, match="MALFORMED"):
        hearing.read(whole[:cut])
    assert hearing.read(whole).agents == ("a",) * 99
