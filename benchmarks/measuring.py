# SPDX-License-Identifier: Apache-2.0
"""Measures several ways to do one thing in turn, so that each figure is a ratio of one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from random import Random

HOT = "hot"
"""Back to back."""

ROUND_LIMIT_S = 0.12
"""A round with 1,000 agents takes no longer [s]."""

COLD = "cold"
"""One at a time, with a pause before each."""

PAUSE_S = 0.03
"""The pause before each request of a cold measurement [s]."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is measured.

    Attributes:
        repetitions: How often each way is measured.
        scale: What the number of calls in each measurement is multiplied by.
        random: Shuffles the order.
    """

    repetitions: int = 7
    scale: float = 1.0
    random: Random

    @property
    def is_short(self) -> bool:
        """True when it is only seen whether the benchmark works."""
        return self.scale < 1

    def times(self, number: int) -> int:
        """Return how often something is done that is done so often in a whole measurement."""
        return max(1, round(number * self.scale))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One comparison.

    Attributes:
        case: What is done.
        side: Who does it.
        values: How long it takes, or how much of something, once a repetition.
        floor: Whom it is compared with; empty for a figure that stands alone.
        floor_values: The same of the floor, in the same order.
        unit: Of both.
        goal: The ratio that is wanted, at most; None for none.
        at_least: True when the ratio is wanted to be so large at least.
        pace: :data:`HOT` or :data:`COLD`; empty where nothing waits.
        note: Where the figure misses its goal, where the time goes; or what is special.
    """

    case: str
    side: str
    values: Sequence[float]
    floor: str = ""
    floor_values: Sequence[float] = ()
    unit: str = "s"
    goal: float | None = None
    at_least: bool = False
    pace: str = ""
    note: str = ""

    @classmethod
    def within(
        cls,
        limit: float,
        *,
        case: str,
        side: str,
        values: Sequence[float],
        floor: str = "the limit",
        unit: str = "s",
        goal: float = 1.0,
        pace: str = "",
    ) -> Row:
        """Return the comparison of figures with a limit, in their unit."""
        return cls(
            case=case,
            side=side,
            values=values,
            floor=floor,
            floor_values=[limit] * len(values),
            unit=unit,
            goal=goal,
            pace=pace,
        )

    def __post_init__(self) -> None:
        """Refuse a row that cannot be compared.

        Raises:
            ValueError: It has no values, or the floor has not one for each.
        """
        if not self.values or (self.floor and len(self.floor_values) != len(self.values)):
            raise ValueError(f"'{self.case}' of {self.side} lacks values")

    @property
    def ratios(self) -> list[float]:
        """The ratio of each repetition; none without a floor."""
        return [a / b for a, b in zip(self.values, self.floor_values, strict=False) if b > 0]

    @property
    def ratio(self) -> float | None:
        """The ratio of the medians; None without a floor, or with one of zero."""
        floor = statistics.median(self.floor_values) if self.floor_values else 0
        return statistics.median(self.values) / floor if floor > 0 else None

    @property
    def is_met(self) -> bool | None:
        """Whether the goal is reached; None without one."""
        if self.goal is None or self.ratio is None:
            return None
        return self.ratio >= self.goal if self.at_least else self.ratio <= self.goal


Way = Callable[[], float]
"""Does the thing some times; returns how long it took each time [s], or how much of something."""


def in_turn(ways: Mapping[str, Way], effort: Effort) -> dict[str, list[float]]:
    """Measure each way once a repetition, in an order that is shuffled anew each time."""
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
    """Return a way that does a call so often, back to back, and takes the mean.

    Args:
        call: What is measured.
        number: How often.
        clock: :func:`time.thread_time` for what only computes: a busy machine disturbs it less.
    """

    def way() -> float:
        began = clock()
        for _ in range(number):
            call()
        return (clock() - began) / number

    return way


def paused(call: Callable[[], float], number: int) -> Way:
    """Return a way that does a call so often, each after a pause, and takes the median.

    Args:
        call: Returns how long it took itself [s].
        number: How often.
    """

    def way() -> float:
        took = []
        for _ in range(number):
            time.sleep(PAUSE_S)
            took.append(call())
        return statistics.median(took)

    return way
