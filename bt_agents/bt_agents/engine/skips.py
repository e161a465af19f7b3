# SPDX-License-Identifier: Apache-2.0
"""Base class of the decorators that can skip their child."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.light_behaviour import FAILURE, RUNNING, SUCCESS


class Skip(Decorator):
    """Decides at each start of the child whether to skip it; a skip is a SUCCESS.

    Below a selector a skip is a FAILURE, so that the next alternative is tried.
    """

    def skip_reason(self) -> str:
        """Return why the child is skipped; empty if it is ticked; may raise."""
        raise NotImplementedError

    def short_circuit(self) -> Status | None:
        if self.status is RUNNING:
            return None
        reason = self.skip_reason()
        if not reason:
            return None
        self.feedback_message = f"left out: {reason}"
        return FAILURE if self.fields.constant("otherwise") == "failure" else SUCCESS
