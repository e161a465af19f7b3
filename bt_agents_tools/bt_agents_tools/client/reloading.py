# SPDX-License-Identifier: Apache-2.0
"""Requests to a host about the versions of its agents, each bounded in time."""

from __future__ import annotations

from typing import Any

from bt_agents.host.reload.reload_service import ANSWER_LIMIT_S
from bt_agents_interfaces.srv import ListVersions, ReloadAgents, RollBack
from bt_agents_tools.client.observer import Observer

_LIMIT_S = ANSWER_LIMIT_S + 2.0


def reload_agents(observer: Observer, host: str, now: bool) -> Any:
    """Have a host read its changed files; return its response, None without an answer."""
    request = ReloadAgents.Request(now=now)
    return observer.call(ReloadAgents, f"{host}/reload", request, _LIMIT_S)


def list_versions(observer: Observer, host: str, agent: str) -> Any:
    """Return the host's response with the versions of an agent, None without an answer."""
    return observer.call(ListVersions, f"{host}/versions", ListVersions.Request(agent=agent))


def roll_back(observer: Observer, host: str, agent: str, version: int, now: bool) -> Any:
    """Have an agent rolled back; return the host's response, None without an answer.

    Args:
        observer: In the graph of the system.
        host: The host of the agent.
        agent: The agent.
        version: Number of the version; 0 for the one before the current.
        now: True cancels the agent's run for it.
    """
    request = RollBack.Request(agent=agent, version=version, now=now)
    return observer.call(RollBack, f"{host}/roll_back", request, _LIMIT_S)
