# SPDX-License-Identifier: Apache-2.0
"""Settings of the market, checked as a whole before they come into force."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import TAKEOVER_S
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.diagnostics.collection import did_you_mean
from marketplace_node.strategies import STRATEGIES, TIE_BREAKS, Option

ON_NEW_SCENE: Final = ("queue", "reject", "preempt")
MAX_QUEUE: Final = 100

EXTERNAL: Final = "external"
"""The strategy that asks an external program."""

RULES: Final = "rules"
"""The strategy that reads ``market.yaml``."""

RANGES: Final[Mapping[str, tuple[float, float]]] = {
    "bid_deadline_s": (0.01, 60.0),
    "host_lease_s": (0.5, 60.0),
    "host_wait_s": (0.0, 60.0),
    "goal_deadline_s": (0.1, 60.0),
    "cancel_deadline_s": (0.1, 600.0),
    "takeover_deadline_s": (0.0, 60.0),
    "collect_deadline_s": (0.05, 600.0),
    "preempt_cooldown_s": (0.0, 600.0),
    "queue_limit": (0, MAX_QUEUE),
    "preempt_margin": (0.0, 100.0),
    "starvation_rounds": (0, 1_000_000),
}
"""Allowed range of each number; names of durations end with ``_s``, in seconds."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Immutable settings; the parameters of the node describe what each setting means.

    Attributes:
        options: Options of strategies, by names like ``softmax.temperature``; missing ones have
            their default.
        host_wait_s: How long queued scenes wait for a host whose lease has expired [s].
        cancel_deadline_s: Longer than a host needs for clean-up and open goals together [s].

    Raises:
        Refused: ``UNKNOWN_STRATEGY``, ``UNKNOWN_OPTION``, ``UNKNOWN_CHOICE``, ``NO_SHADOW`` or
            ``OUT_OF_RANGE``.
    """

    strategy: str = "bounded_ucb"
    shadow_strategy: str = ""
    options: Mapping[str, float] = field(default_factory=dict)
    bid_deadline_s: float = 0.5
    host_lease_s: float = 0.8
    host_wait_s: float = 5.0
    goal_deadline_s: float = 2.0
    cancel_deadline_s: float = 14.0
    takeover_deadline_s: float = TAKEOVER_S
    collect_deadline_s: float = 2.0
    on_new_scene: str = "queue"
    queue_limit: int = 10
    preempt_margin: float = 1.0
    preempt_cooldown_s: float = 5.0
    tie_break: str = "least_recently_run"
    starvation_rounds: int = 50

    def __post_init__(self) -> None:
        """Check every value against its range."""
        check_strategy(self.strategy)
        if self.shadow_strategy:
            check_strategy(self.shadow_strategy, "shadow_strategy")
        if self.shadow_strategy == EXTERNAL:
            raise Refused(
                RefusalCode.NO_SHADOW,
                f"shadow_strategy: '{EXTERNAL}' cannot be the shadow, as a round would wait for "
                "its answer; make it the strategy, and the other one the shadow",
            )
        self._check_options()
        _check_choice("on_new_scene", self.on_new_scene, ON_NEW_SCENE)
        _check_choice("tie_break", self.tie_break, TIE_BREAKS)
        for name, (least, most) in RANGES.items():
            unit = " s" if name.endswith("_s") else ""
            _check_range(name.removesuffix("_s"), getattr(self, name), least, most, unit)

    def options_of(self, strategy: str) -> dict[str, float]:
        """Return every option of a strategy with its value, by names like ``temperature``."""
        start = f"{strategy}."
        given = {
            name.removeprefix(start): value
            for name, value in self.options.items()
            if name.startswith(start)
        }
        return STRATEGIES[strategy].values(given) if strategy else {}

    def _check_options(self) -> None:
        known = dict(all_options())
        for name, value in self.options.items():
            option = known.get(name)
            if option is None:
                raise Refused(
                    RefusalCode.UNKNOWN_OPTION,
                    f"no option '{name}'; {did_you_mean(name, known) or 'see the strategies'}",
                )
            _check_range(name, value, option.minimum, option.maximum, "")


def all_options() -> Iterator[tuple[str, Option]]:
    """Yield every option of every strategy with its full name, like ``softmax.temperature``."""
    for strategy, spec in STRATEGIES.items():
        for option in spec.options:
            yield f"{strategy}.{option.name}", option


def check_strategy(name: str, what: str = "strategy") -> None:
    """Check that a strategy of this name exists.

    Raises:
        Refused: ``UNKNOWN_STRATEGY``, with the list of strategies.
    """
    if name not in STRATEGIES:
        raise Refused(
            RefusalCode.UNKNOWN_STRATEGY,
            f"{what}: '{name}', expected one of {', '.join(STRATEGIES)}",
        )


def _check_choice(name: str, found: str, choices: tuple[str, ...]) -> None:
    if found not in choices:
        raise Refused(
            RefusalCode.UNKNOWN_CHOICE, f"{name}: '{found}', expected one of {', '.join(choices)}"
        )


def _check_range(name: str, found: float, least: float, most: float, unit: str) -> None:
    if not (math.isfinite(found) and least <= found <= most):
        raise Refused(
            RefusalCode.OUT_OF_RANGE,
            f"{name}: {found:g}{unit}, expected {least:g} to {most:g}{unit}",
        )
