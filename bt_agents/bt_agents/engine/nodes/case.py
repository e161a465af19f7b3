# SPDX-License-Identifier: Apache-2.0
"""Case: a child of ``choose`` with its condition."""

from __future__ import annotations

from bt_agents.engine.decorator import Decorator
from bt_agents.engine.node_errors import reason_of


class Case(Decorator):
    """Passes on the status of its child; without a condition it is the one that fits otherwise."""

    def why_not(self) -> str:
        """Return why the case does not fit now, empty when it does."""
        if "condition" not in self.fields:
            return ""
        try:
            if self.fields.is_true("condition"):
                return ""
        except Exception as error:
            return reason_of(error)
        return self.fields.explain_false("condition")


BEHAVIOURS = {"case": Case}
