# SPDX-License-Identifier: Apache-2.0
"""Case: a child of ``choose`` with its condition."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.node_errors import reason_of


class Case(Decorator):
    """Passes on the status of its child; a case without a condition always matches.

    A case whose condition cannot be decided is taken and is a FAILURE.
    """

    _undecided = ""

    def mismatch(self) -> str:
        """Return why the case does not match now; empty if it is to be taken."""
        self._undecided = ""
        try:
            return self.why_not("condition") if "condition" in self.fields else ""
        except Exception as error:
            self._undecided = reason_of(error)
            return ""

    def short_circuit(self) -> Status | None:
        return self.fail(self._undecided) if self._undecided else None


BEHAVIOURS = {"case": Case}
