# SPDX-License-Identifier: Apache-2.0
"""Measures several ways to do one thing in turn, so that each ratio comes from one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

OURS = "bt-agents"
"""Who does it in most rows."""

HOT = "hot"
"""Back to back."""

ROUND_LIMIT_S = 0.12
"""Longest time of a round with 1,000 agents [s]."""

COLD = "cold"
"""One at a time, with a pause before each."""

PAUSE_S = 0.03
"""The pause before each request of a cold measurement [s]."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much to measure.

    Attributes:
        repetitions: Number of measurements of each way.
        scale: Factor of the number of calls in each measurement.
        random: Shuffles the order.
    """

    repetitions: int = 7
    scale: float = 1.0
    random: Random

    @property
    def is_short(self) -> bool:
        """True if the measurement only shows whether the benchmark works."""
        return self.scale < 1

    def times(self, number: int) -> int:
        """Return the number of calls, given the number in a full measurement."""
        return max(1, round(number * self.scale))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One comparison.

    Attributes:
        case: The task.
        side: Who does it.
        values: Time, or another quantity, once per repetition.
        floor: Name of the comparison; empty for a figure without one.
        floor_values: Values of the comparison, in the same order.
        unit: Unit of both.
        goal: Largest ratio wanted; None for no goal.
        at_least: True if the goal is the smallest ratio wanted.
        pace: :data:`HOT` or :data:`COLD`; empty if nothing waits.
        note: Where the time goes if the figure misses its goal; or a peculiarity.
    """

    case: str
    side: str = OURS
    values: Sequence[float]
    floor: str = ""
    floor_values: Sequence[float] = ()
    unit: str = "s"
    goal: float | None = None
    at_least: bool = False
    pace: str = ""
    note: str = ""

    @classmethod
    def beside(
        cls, found: Mapping[str, Sequence[float]], side: str, floor: str, **details: Any
    ) -> Row:
        """Return the comparison of the values that were found under two names."""
        values, floor_values = found[side], found[floor]
        return cls(side=side, values=values, floor=floor, floor_values=floor_values, **details)

    @classmethod
    def within(
        cls,
        limit: float,
        *,
        values: Sequence[float],
        floor: str = "the limit",
        goal: float = 1.0,
        **details: Any,
    ) -> Row:
        """Return the comparison of figures with a limit in the same unit."""
        limits = [limit] * len(values)
        return cls(values=values, floor=floor, floor_values=limits, goal=goal, **details)

    def __post_init__(self) -> None:
        """Reject a row that cannot be compared.

        Raises:
            ValueError: It has no values, or not one value of the floor for each.
        """
        if not self.values or (self.floor and len(self.floor_values) != len(self.values)):
            raise ValueError(f"'{self.case}' of {self.side} lacks values")

    @property
    def ratios(self) -> list[float]:
        """The ratio of each repetition; none without a floor."""
        return [a / b for a, b in zip(self.values, self.floor_values, strict=False) if b > 0]

    @property
    def ratio(self) -> float | None:
        """The ratio of the medians; None without a floor, or with a floor of zero."""
        floor = statistics.median(self.floor_values) if self.floor_values else 0
        return statistics.median(self.values) / floor if floor > 0 else None

    @property
    def is_met(self) -> bool | None:
        """Whether the goal is met; None without a goal."""
        if self.goal is None or self.ratio is None:
            return None
        return self.ratio >= self.goal if self.at_least else self.ratio <= self.goal


Way = Callable[[], float]
"""Does the task several times; returns the time of one [s], or another quantity."""


def in_turn(ways: Mapping[str, Way], effort: Effort) -> dict[str, list[float]]:
    """Measure each way once per repetition, in a new random order each time."""
    found: dict[str, list[float]] = {name: [] for name in ways}
    names = list(ways)
    for _ in range(effort.repetitions):
        effort.random.shuffle(names)
        for name in names:
            found[name].append(ways[name]())
    return found


def timed(
    call: Callable[[], object], number: int, clock: Callable[[], float] = time.perf_counter
) -> Way:
    """Return a way that repeats a call back to back and takes the mean.

    Args:
        call: Call to measure.
        number: Number of calls.
        clock: :func:`time.thread_time` for pure computation, which a busy machine disturbs less.
    """

    def way() -> float:
        began = clock()
        for _ in range(number):
            call()
        return (clock() - began) / number

    return way


def median_of(call: Callable[[], float], number: int) -> Way:
    """Return a way that repeats a call and takes the median.

    Args:
        call: Returns its own time [s].
        number: Number of calls.
    """
    return lambda: statistics.median(call() for _ in range(number))


def paused(call: Callable[[], float], number: int) -> Way:
    """Return a way as :func:`median_of` does, with a pause before each call."""

    def after_pause() -> float:
        time.sleep(PAUSE_S)
        return call()

    return median_of(after_pause, number)
