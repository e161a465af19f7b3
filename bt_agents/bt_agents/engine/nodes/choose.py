# SPDX-License-Identifier: Apache-2.0
"""Choose: only the first case whose condition is true."""

from __future__ import annotations

from py_trees.behaviour import Behaviour

from bt_agents.engine.bases import ChooseOne
from bt_agents.engine.nodes.case import Case
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode


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


BEHAVIOURS = {"choose": Choose}
