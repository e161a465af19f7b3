# SPDX-License-Identifier: Apache-2.0
"""A ledger with two agents and the management of their profiles."""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

from bt_agents_core.feedback import FeedbackKind
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger
from feedback_node.ledger.rows import LAYER, RevisionCause
from feedback_node.management.management import Management, ManagementCommand, ManagementResult
from learning_cards import card, entry
from scene_spaces import space_of

SPACE = space_of("age", "mood")


class ManagedLedger:
    """A ledger with two agents and the management of their profiles."""

    def __init__(self) -> None:
        self.now = 1_000_000.0
        self.ledger = Ledger(":memory:", wall=lambda: self.now)
        self.profiles = Profiles(SPACE, self.ledger)
        numbers = itertools.count(1)
        self.profiles.register_card(card(entry("guide"), entry("express")))
        self._management = Management(
            self.profiles,
            self.ledger,
            wall=lambda: self.now,
            new_id=lambda: f"document-{next(numbers)}",
        )

    def execute(self, action: int, **fields: Any) -> ManagementResult:
        return self._management.execute(ManagementCommand(action=action, **fields))

    def document(self, action: int, **fields: Any) -> Any:
        return json.loads(self.execute(action, **fields).document)

    def teach_layer(self, layer: str, agent: str = "guide", age: float = 4.5) -> None:
        if self.ledger.current(agent, layer) is None:
            begins = RevisionCause(cause=LAYER)
            self.ledger.append(agent, {"age": 3.0, "mood": 3.0}, begins, layer=layer)
        row = self.ledger.append(agent, {"age": age, "mood": 3.0}, RevisionCause(), layer=layer)
        self.profiles.on_recorded([row])

    def teach(self, feedback_id: str, agent: str = "guide") -> None:
        self.profiles.apply(
            agent,
            FeedbackKind.DIRECT,
            (5.0, math.nan),
            feedback_id=feedback_id,
            source="t",
            reason="",
            run=None,
        )

    def current_profiles(self) -> dict[tuple[str, str], tuple[float, ...]]:
        return {(name, layer): vector for name, layer, _, vector in self.profiles.table()}
