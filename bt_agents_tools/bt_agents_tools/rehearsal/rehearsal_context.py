# SPDX-License-Identifier: Apache-2.0
"""Context of the nodes in a rehearsal, which scripts their choices of children and texts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Sequence
from random import Random

from bt_agents.engine.context import RunContext
from bt_agents.engine.environment import Environment
from bt_agents.engine.scope import RunScope
from bt_agents_language.files.testing.path_patterns import branches_of, matches
from bt_agents_language.files.testing.scenarios import VariantRule
from bt_agents_language.model.specs import NodeSpec


class RehearsalContext(RunContext):
    """Context with scripted picks and variants, used in turn; the last one repeats."""

    def __init__(
        self,
        environment: Environment,
        scope: RunScope,
        random: Random,
        *,
        picks: Sequence[str] = (),
        variants: Sequence[VariantRule] = (),
    ) -> None:
        super().__init__(environment, scope, random)
        self._picks = picks
        self._variants = variants
        self._turns: defaultdict[Hashable, int] = defaultdict(int)

    def pick(self, path: str, count: int, last: int | None) -> int:
        for at, rule in enumerate(self._variants):
            if matches(rule.pattern, path):
                return self._in_turn(at, rule.numbers)
        return super().pick(path, count, last)

    def picked_child(self, spec: NodeSpec) -> int | None:
        branches = branches_of(spec)
        fitting = [
            [place for place, path in enumerate(branches) if matches(one, path)]
            for one in self._picks
        ]
        places = [found[0] for found in fitting if found]
        return self._in_turn(spec.path, places) if places else None

    def _in_turn(self, whose: Hashable, numbers: Sequence[int]) -> int:
        turn = min(self._turns[whose], len(numbers) - 1)
        self._turns[whose] += 1
        return numbers[turn]
