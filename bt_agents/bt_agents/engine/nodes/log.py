# SPDX-License-Identifier: Apache-2.0
"""Log: logs a line."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Leaf
from bt_agents.engine.light_behaviour import SUCCESS


class Log(Leaf):
    """Logs a line, which is also the node's message; always SUCCESS."""

    has_side_effects = True

    def step(self) -> Status:
        text = str(self.fields.value("message"))
        self.context.environment.log(str(self.fields.constant("level", "info")), text)
        self.feedback_message = text
        return SUCCESS


BEHAVIOURS = {"log": Log}
