# SPDX-License-Identifier: Apache-2.0
"""Case: a child of ``choose`` with its condition."""

from __future__ import annotations

from bt_agents.engine.decorator import Decorator


class Case(Decorator):
    """Passes on the status of its child; without a condition it is the one that fits otherwise."""

    def mismatch(self) -> str:
        """Return why the case does not fit now, empty when it does."""
        return self.why_not("condition") if "condition" in self.fields else ""


BEHAVIOURS = {"case": Case}
