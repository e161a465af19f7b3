# SPDX-License-Identifier: Apache-2.0
"""What changes of agent files lead to."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from bt_agents_language.model.specs import AgentSpec


class ReloadAction(Enum):
    """Kind of an effect."""

    ADD = "add"
    REMOVE = "remove"
    REPLACE_TREE = "replace"
    """Give it another tree for its next run."""
    UPDATE_VALUES = "update"
    """Give it other values, also while it runs; its tree is the same."""
    REPORT = "report"
    """Report to people; nothing else changes."""


@dataclass(frozen=True, kw_only=True)
class ReloadEffect:
    """Effect of a changed file on one agent.

    Attributes:
        act: What is to be done.
        name: With which agent.
        agent: What its file says; None for one that is removed or only spoken of.
        words: The same for people.
        bad: True when somebody has to mend something.
    """

    act: ReloadAction
    name: str
    words: str
    agent: AgentSpec | None = None
    bad: bool = False
