# SPDX-License-Identifier: Apache-2.0
"""Context of the nodes in a rehearsal: they take the variants that its script names."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from bt_agents.engine.context import RunContext
from bt_agents.engine.environment import Environment
from bt_agents.engine.scope import RunScope
from bt_agents_language.files.testing.path_patterns import matches
from bt_agents_language.files.testing.scenarios import VariantRule


class RehearsalContext(RunContext):
    """Context with scripted variants, each taken in turn, and the last one for ever."""

    def __init__(
        self,
        environment: Environment,
        scope: RunScope,
        random: Random,
        *,
        variants: Sequence[VariantRule] = (),
    ) -> None:
        super().__init__(environment, scope, random)
        self._variants = variants
        self._turns = [0] * len(variants)

    def pick(self, path: str, count: int, last: int | None) -> int:
        for at, rule in enumerate(self._variants):
            if matches(rule.pattern, path):
                turn = min(self._turns[at], len(rule.numbers) - 1)
                self._turns[at] += 1
                return rule.numbers[turn]
        return super().pick(path, count, last)
