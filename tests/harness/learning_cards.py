# SPDX-License-Identifier: Apache-2.0
"""Cards of a host whose agents learn."""

from __future__ import annotations

from typing import Any

from feedback_node.learning.cards import AgentEntry, LearningCard
from scene_spaces import AGE_AND_MOOD


def entry(
    name: str = "guide", profile: tuple[float, ...] = (3.0, 3.0), **fields: Any
) -> AgentEntry:
    """Return an agent that goes half of the way to a wanted profile."""
    usual = {"revision": 0, "learning_rate": 0.5}
    return AgentEntry(name=name, profile=profile, **usual | fields)


def card(*agents: AgentEntry, **fields: Any) -> LearningCard:
    """Return the card of a host of these agents."""
    usual = {"host": "/agents", "instance": "i1", "parameters": AGE_AND_MOOD.names}
    return LearningCard(agents=agents, **usual | fields)
