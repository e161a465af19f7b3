# SPDX-License-Identifier: Apache-2.0
"""Records the answers of behaviours of packages, and replays them without the packages."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import cast

from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.leaf import Leaf
from bt_agents.engine.nodes.plugin import PluginLeaf
from bt_agents.engine.scope import Scope
from bt_agents.recording.format import Entry
from bt_agents.recording.steps import StepLog
from bt_agents_language.model.specs import NodeSpec


class RecordingPlugin(PluginLeaf):
    """A behaviour of a package with recorded answers."""

    def __init__(self, spec: NodeSpec, context: RunContext, scope: Scope, log: StepLog) -> None:
        super().__init__(spec, context, scope)
        self._log = log

    def update(self) -> Status:
        status = super().update()
        entry: Entry = {
            "path": self.spec.path,
            "status": status.name,
            "message": self.feedback_message,
        }
        if self.written:
            entry["writes"] = dict(self.written)
        self._log.add("plugins", entry)
        return status

    def terminate(self, new_status: Status) -> None:
        before = self.feedback_message
        super().terminate(new_status)
        if self.feedback_message != before:
            self._log.add("plugins", {"path": self.spec.path, "message": self.feedback_message})


class ReplayPlugin(Leaf):
    """A leaf with the recorded answers of a behaviour.

    ``answers`` are the entries of this step that were not used yet, by node path.
    """

    has_side_effects = True

    def __init__(
        self,
        spec: NodeSpec,
        context: RunContext,
        scope: Scope,
        answers: Mapping[str, deque[Entry]],
    ) -> None:
        super().__init__(spec, context, scope)
        self._answers = answers

    def update(self) -> Status:
        answer = self._answers[self.spec.path].popleft()
        self.feedback_message = answer["message"]
        for name, value in answer.get("writes", {}).items():
            self.scope.write(name, value)
        return cast(Status, Status[answer["status"]])

    def terminate(self, new_status: Status) -> None:
        """Use the recorded error of its end as the message, if there was one."""
        answers = self._answers[self.spec.path]
        if answers and "status" not in answers[0]:
            self.feedback_message = answers.popleft()["message"]
