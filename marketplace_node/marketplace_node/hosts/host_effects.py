# SPDX-License-Identifier: Apache-2.0
"""Effects on hosts: connect, disconnect, cancel; and the identity of an award."""

from __future__ import annotations

from dataclasses import dataclass

from bt_agents_core.open_goals import OpenGoal
from marketplace_node.hosts.registry import HostEntry


@dataclass(frozen=True, kw_only=True)
class RunGoal:
    """Identity of an award: an agent gets at most one goal per round."""

    round: int
    agent: str
    agent_id: int
    host: str
    instance: str


class Effect:
    """Base of the effects: something that the market wants done."""


@dataclass(frozen=True, kw_only=True)
class Connect(Effect):
    """Connect to a host that is new, was restarted or has moved its interfaces."""

    entry: HostEntry


@dataclass(frozen=True, kw_only=True)
class Disconnect(Effect):
    """Disconnect from a host that the market has forgotten."""

    host: str


@dataclass(frozen=True, kw_only=True)
class CancelGoal(Effect):
    """Cancel a goal, or drop it if it has not been sent yet."""

    goal: RunGoal


@dataclass(frozen=True, kw_only=True)
class CancelAll(Effect):
    """Cancel everything that runs at a host, because the market knows none of it."""

    host: str


@dataclass(frozen=True, kw_only=True)
class CancelOpenGoals(Effect):
    """Cancel the goals that a start of a host left open, then report ``goals_cancelled``."""

    host: str
    instance: str
    goals: tuple[OpenGoal, ...]
    within_s: float
