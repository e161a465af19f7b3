# SPDX-License-Identifier: Apache-2.0
"""Choose, and its children: only the first case whose condition is true."""

from __future__ import annotations

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.composite import ChooseOne
from bt_agents.engine.decorator import Decorator
from bt_agents.engine.node_errors import reason_of
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode


class Case(Decorator):
    """Passes on the status of its child; a case without a condition always matches.

    A case whose condition cannot be decided is taken and is a FAILURE.
    """

    _undecided = ""

    def mismatch(self) -> str:
        """Return why the case does not match now; empty if it is to be taken."""
        self._undecided = ""
        try:
            return self.why_not() if "condition" in self.fields else ""
        except Exception as error:
            self._undecided = reason_of(error)
            return ""

    def short_circuit(self) -> Status | None:
        return self.fail(self._undecided) if self._undecided else None


class Choose(ChooseOne):
    """Ticks the first case that matches at the start; it tries no other if that one fails."""

    def pick(self) -> Behaviour:
        mismatches = []
        for case in self.children:
            assert isinstance(case, Case)
            mismatch = case.mismatch()
            if not mismatch:
                self.feedback_message = f"case '{case.name}'"
                return case
            mismatches.append(f"{case.name}: {mismatch}")
        raise Refused(RefusalCode.NO_CASE, f"no case fits; {'; '.join(mismatches)}")


BEHAVIOURS = {"choose": Choose, "case": Case}
