# SPDX-License-Identifier: Apache-2.0
"""Health of a host: its files, its ticks, and servers that do not answer."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.host.environment.graph_problems import (
    FORGOTTEN_S,
    MOST_SERVERS,
    GraphProblems,
    SilentServers,
)
from bt_agents.host.health import TickCounts, files_health, servers_health, ticks_health
from bt_agents_core.health import Health
from bt_agents_ros.discovery import node_of


def test_file_problems_are_an_error_naming_the_files():
    assert files_health(9, ()).message == "agents: 9, all files are in order"
    health = files_health(9, [("agents/a.yaml", "no skill 'sya'"), ("b", "does not bid")])
    assert health.level is Health.ERROR
    assert health.message == "problems in files: 2, in agents/a.yaml and b"
    assert health.values["agents/a.yaml"] == "no skill 'sya'"


def test_tick_overruns_are_a_warning_naming_the_agent():
    assert ticks_health(TickCounts(agent="guide")).level is Health.OK
    health = ticks_health(TickCounts(agent="guide", overruns=3))
    assert (health.level, health.values["too long"]) == (Health.WARN, "3")
    assert "guide" in health.message


def test_unreachable_server_is_silent_until_it_answers():
    servers = SilentServers()
    servers.ended("say", GoalState.UNREACHABLE, "no server after 2 s")
    health = servers_health(servers.reasons, {})
    assert (health.level, health.message) == (Health.ERROR, "silent: say")
    assert health.values == {"say": "no server after 2 s"}
    servers.ended("say", GoalState.SUCCEEDED, "")
    assert servers_health(servers.reasons, {}).level is Health.OK


def test_duplicate_action_servers_raise_a_warning():
    changes = []
    graph = GraphProblems(clock=lambda: 0.0)
    graph.on_change = lambda: changes.append([*graph.messages])
    assert graph.look("/carry", ["/a"]) == ""
    message = graph.look("/carry", ["/a", "/b"])
    assert message.startswith("2 servers offer the action /carry, of /a, /b:")
    health = servers_health({}, graph.messages)
    assert (health.level, health.message) == (Health.WARN, "doubtful: /carry")
    graph.look("/carry", ["/a", "/b"])
    assert graph.watched == {"/carry"}
    graph.look("/carry", ["/b"])
    assert changes == [["/carry"], []]


def test_restarted_server_is_not_a_duplicate_at_first():
    now = [0.0]
    graph = GraphProblems(clock=lambda: now[0])
    assert graph.look("/carry", ["/a", "/a"]) == ""
    now[0] = FORGOTTEN_S
    assert graph.look("/carry", ["/a", "/a"])


def test_new_server_without_a_name_is_no_duplicate() -> None:
    unknown = SimpleNamespace(
        node_namespace="_NODE_NAMESPACE_UNKNOWN_", node_name="_NODE_NAME_UNKNOWN_"
    )
    known = SimpleNamespace(node_namespace="/", node_name="driver")
    servers = [node_of(one) for one in (known, unknown)]
    now = [0.0]
    graph = GraphProblems(clock=lambda: now[0])
    assert graph.look("/carry", servers) == ""
    now[0] = FORGOTTEN_S
    assert ", of /driver:" in graph.look("/carry", servers)


@pytest.mark.parametrize("state", [GoalState.CANCELLED, GoalState.TIMED_OUT])
def test_cancelled_or_timed_out_goal_keeps_server_state(state: GoalState):
    servers = SilentServers()
    servers.ended("ask", state, "")
    assert servers.reasons == {}
    servers.ended("say", GoalState.UNREACHABLE, "gone")
    servers.ended("say", state, "")
    assert servers.reasons == {"say": "gone"}


def test_number_of_remembered_silent_servers_is_bounded():
    servers = SilentServers()
    for number in range(MOST_SERVERS + 10):
        servers.ended(f"server{number}", GoalState.UNREACHABLE, "gone")
    assert len(servers.reasons) == MOST_SERVERS
