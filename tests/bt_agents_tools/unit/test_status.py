# SPDX-License-Identifier: Apache-2.0
"""Status of a system with problems."""

from __future__ import annotations

from types import SimpleNamespace as Message

from bt_agents_tools.cli.commands.status import differing_agents, rule_problems

OF_MARKET = Message(agent="", file="market.yaml", line=4, message="rule 1 cannot be decided")
OF_MOOD = Message(agent="guide", file="", line=0, message="the mood rule cannot be decided")


def test_undecidable_market_and_mood_rules_are_reported() -> None:
    market, profiles = Message(problems=[OF_MARKET]), Message(problems=[OF_MOOD])
    assert rule_problems(market, profiles) == [OF_MARKET, OF_MOOD]
    assert rule_problems(market, None) == [OF_MARKET]


def test_agents_bidding_with_differing_profile_are_listed() -> None:
    assert differing_agents(Message(differing=["guide"])) == ["guide"]
    assert differing_agents(None) == ()
