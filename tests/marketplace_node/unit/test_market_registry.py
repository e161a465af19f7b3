# SPDX-License-Identifier: Apache-2.0
"""Registration at the market: ids and refusals."""

from __future__ import annotations

from typing import Any

import pytest

from market_harness import EXPRESS, GUIDE, PLAIN, SPACE, MarketHarness, registration
from marketplace_node.hosts.host_effects import Disconnect
from marketplace_node.hosts.registry import (
    FIRST_HEARTBEAT_S,
    MOST_AGENTS,
    MOST_HOSTS,
    TOKEN_BYTES,
    Registry,
)

LEASE_S = 1.0


@pytest.fixture
def registry() -> Registry:
    return Registry(SPACE.names, LEASE_S, b"secret")


def live(registry: Registry, now: float) -> list[str]:
    return [entry.host for entry in registry.live(now)]


def test_agent_ids_are_stable_and_never_reused(registry: Registry) -> None:
    first = registry.register(registration(), 0.0)
    registry.register(registration("/others", (PLAIN,)), 0.0)
    again = registry.register(registration(agents=(EXPRESS, "newcomer", GUIDE)), 0.5)
    restarted = registry.register(registration(instance="second"), 9.0)
    registry.remove("/agents")
    returned = registry.register(registration(), 9.1)
    registry.register(registration(agents=(GUIDE,)), 9.2)
    longer = registry.register(registration(), 9.3)

    assert first.accepted
    ids = [answer.agent_ids for answer in (first, again, restarted, returned, longer)]
    assert ids == [(1, 2), (2, 4, 1), (1, 2), (5, 6), (5, 7)]


def test_host_with_too_many_agents_is_refused_entirely(registry: Registry) -> None:
    names = tuple(f"a{number}" for number in range(MOST_AGENTS + 1))
    refused = registry.register(registration(agents=names), 0.0)
    taken = registry.register(registration(agents=names[:-1]), 0.0)

    assert (refused.accepted, taken.accepted) == (False, True)
    assert refused.message == (
        "TOO_MANY_AGENTS: /agents has 10001 agents, at most 10000 may be in one host; "
        "start more hosts"
    )
    assert taken.agent_ids == tuple(range(1, MOST_AGENTS + 1))


def test_registering_again_refreshes_agents_and_lease(registry: Registry) -> None:
    token = registry.register(registration(), 0.0).token
    registry.heartbeat("/agents", "first", 0.0)
    registry.register(registration(agents=(GUIDE,), token=token), 0.9)
    assert not registry.heartbeat("/agents", "zeroth", 1.8)
    assert not registry.heartbeat("/strangers", "first", 1.8)

    assert dict(registry.entries()[0].agents) == {GUIDE: 1}
    assert live(registry, 1.8) == ["/agents"]
    assert live(registry, 2.0) == [], "heartbeats of others and of earlier starts do not count"


def test_lease_starts_at_first_heartbeat_or_after_allowance(registry: Registry) -> None:
    registry.register(registration(), 0.0)
    token = registry.register(registration("/others", (PLAIN,)), 0.0).token
    registry.heartbeat("/others", "first", 0.1)
    registry.register(registration("/others", (PLAIN,), token=token), 0.15)

    assert [entry.host for entry in registry.with_heartbeat(0.2)] == ["/others"]
    assert live(registry, 1.2) == ["/agents"], "registering again allows no new time"
    assert live(registry, 0.99 + FIRST_HEARTBEAT_S) == ["/agents"]
    assert live(registry, 1.0 + FIRST_HEARTBEAT_S) == []
    registry.register(registration(instance="second"), 9.0)
    assert live(registry, 9.0 + FIRST_HEARTBEAT_S) == ["/agents"], "each start has its own time"


def test_live_host_is_replaced_only_with_its_token(registry: Registry) -> None:
    token = registry.register(registration(), 0.0).token
    assert registry.register(registration(), 0.1).token == token, "the answer was not read"
    other = registry.register(registration("/others", (PLAIN,)), 0.0).token
    registry.heartbeat("/agents", "first", 0.9)
    for wrong in (b"", bytes(TOKEN_BYTES), other):
        answer = registry.register(registration(instance="second", token=wrong), 1.0)
        assert "HOST_EXISTS" in answer.message

    assert registry.register(registration(instance="second", token=token), 1.0).accepted
    instances = {entry.host: entry.instance for entry in registry.entries()}
    assert instances == {"/agents": "second", "/others": "first"}


def test_name_of_live_host_is_refused_with_holder(registry: Registry) -> None:
    registry.register(registration(), 0.0)
    answer = registry.register(registration("/others", (GUIDE, PLAIN)), 0.5)

    assert (answer.accepted, answer.agent_ids) == (True, (0, 3))
    assert answer.reasons[0].startswith("AGENT_EXISTS: 'attentive_guide' is held by /agents")
    assert answer.reasons[1] == ""
    later = registry.register(registration("/others", (GUIDE,)), 5.0)
    assert later.agent_ids == (1,), "that of a dead host can be taken over"
    assert [dict(entry.agents) for entry in registry.entries()] == [{EXPRESS: 2}, {GUIDE: 1}]


@pytest.mark.parametrize(
    "name", ["", "Guide", "9lives", "a b", "näme", "a/b", "a\n", "x" * 5000 + "!", "x" * 181]
)
def test_invalid_agent_names_are_refused_individually(registry: Registry, name: str) -> None:
    answer = registry.register(registration(agents=(name, GUIDE, GUIDE)), 0.0)

    assert answer.accepted
    assert answer.agent_ids == (0, 1, 0)
    assert answer.reasons[0].startswith("BAD_NAME")
    assert answer.reasons[2].startswith("DUPLICATE")
    assert max(map(len, answer.reasons)) < 500


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"host": "agents"}, "BAD_NAME"),
        ({"host": "/a//b"}, "BAD_NAME"),
        ({"host": "/a/"}, "BAD_NAME"),
        ({"run_action": "/agents/run now"}, "BAD_NAME"),
        ({"run_action": "/a__b"}, "BAD_NAME"),
        ({"heartbeat": "/9"}, "BAD_NAME"),
        ({"heartbeat": "/x\n"}, "BAD_NAME"),
        ({"heartbeat": "/" + "x" * 300}, "BAD_NAME"),
        ({"instance": ""}, "EMPTY"),
        ({"parameters": ()}, "OTHER_PARAMETERS"),
        ({"parameters": ("familiarity", "age", "mood")}, "OTHER_PARAMETERS"),
    ],
)
def test_incompatible_hosts_are_refused_without_side_effects(
    registry: Registry, changes: dict[str, Any], code: str
) -> None:
    answer = registry.register(registration(**changes), 0.0)

    assert not answer.accepted
    assert answer.message.startswith(code)
    assert [one.split(": ")[1] for one in registry.refused(4.0)] == [code]
    assert (registry.refused(6.0), answer.agent_ids, registry.entries()) == ((), (), ())


def test_stall_extends_live_leases_but_revives_no_host(registry: Registry) -> None:
    registry.register(registration(), 0.0)
    registry.register(registration("/others", (PLAIN,)), 4.5)
    registry.extend_after_stall(5.0, 9.0)

    assert [live(registry, now) for now in (9.0, 9.6)] == [["/others"], []]


def test_delays_of_market_do_not_count_as_silence(registry: Registry) -> None:
    registry.register(registration(), 0.0)
    registry.heartbeat("/agents", "first", 10.0)
    registry.extend_leases(10.2, 10.55)

    assert registry.is_live("/agents", "first", 10.0 + LEASE_S + 0.1)
    assert not registry.is_live("/agents", "first", 10.0 + LEASE_S + 0.2)


def test_host_above_limit_replaces_only_longest_dead_one() -> None:
    market = MarketHarness()
    for number in range(MOST_HOSTS):
        market.register(f"/h{number}", f"a{number}")

    answer = market.register("/more", "more")
    assert not answer.accepted
    assert answer.message.startswith(f"TOO_MANY_HOSTS: {MOST_HOSTS} hosts are alive")
    assert market.register("/h0", "a0").accepted, "who is in may register again"
    market.lose("/h7")
    market.lose("/h3")
    assert market.register("/more", "more").accepted
    assert market.all(Disconnect) == [Disconnect(host="/h7")]


def test_live_host_keeps_registration_without_its_token(registry: Registry) -> None:
    token = registry.register(registration(), 0.0).token
    registry.heartbeat("/agents", "first", 0.5)
    stolen = registry.register(registration(run_action="/q/run"), 1.0)
    assert stolen.message.startswith("WRONG_TOKEN")
    assert stolen.token == b""
    (entry,) = registry.entries()
    assert entry.run_action == "/agents/run"
    entry.check_token(token)


def test_each_host_start_has_own_secret_token(registry: Registry) -> None:
    first = registry.register(registration(), 0.0).token
    other = registry.register(registration("/others", (PLAIN,)), 0.0).token
    second = registry.register(registration(instance="second"), 9.0)
    elsewhere = Registry(SPACE.names, 1.0, b"another secret").register(registration(), 0.0).token
    assert len({first, other, second.token, elsewhere}) == 4
    assert {len(token) for token in (first, other)} == {TOKEN_BYTES}
    assert "token" not in repr((second, registry.entries(), registration(token=first)))
