# SPDX-License-Identifier: Apache-2.0
"""When: skips the child unless a condition is true at its start."""

from __future__ import annotations

from bt_agents.engine.skips import Skip


class When(Skip):
    """Skips the child unless the condition is true; with a missing value it is not true."""

    def skip_reason(self) -> str:
        return self.why_not("condition")


BEHAVIOURS = {"when": When}
