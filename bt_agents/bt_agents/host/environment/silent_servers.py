# SPDX-License-Identifier: Apache-2.0
"""Servers of skills that have not answered the last goal."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents.engine.environment import GoalState

MOST_SERVERS = 200

_ANSWERS = (GoalState.SUCCEEDED, GoalState.ABORTED, GoalState.REJECTED)


class SilentServers:
    """Servers whose last goal was unreachable, until they answer one.

    Attributes:
        reasons: Name of the action or service → the reason that its leaf gives.
    """

    def __init__(self) -> None:
        self.reasons: Mapping[str, str] = {}

    def ended(self, server: str, state: GoalState, message: str) -> None:
        """Handle the end of a goal; a cancel or a timeout says nothing about its server."""
        others = {name: reason for name, reason in self.reasons.items() if name != server}
        if state is GoalState.UNREACHABLE and len(others) < MOST_SERVERS:
            self.reasons = {**others, server: message}
        elif state in _ANSWERS:
            self.reasons = others
