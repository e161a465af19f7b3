# SPDX-License-Identifier: Apache-2.0
"""When: skips the child unless a condition is true at its start."""

from __future__ import annotations

from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.skips import Skip
from bt_agents_language.expression.expressions import MissingValue


class When(Skip):
    """Skips the child unless the condition is true; one that cannot be evaluated is not true."""

    def skip_reason(self) -> str:
        try:
            if self.fields.is_true("condition"):
                return ""
        except MissingValue as missing:
            return reason_of(missing)
        except Exception as error:
            return with_location(reason_of(error), self.spec)
        return self.fields.explain_false("condition")


BEHAVIOURS = {"when": When}
