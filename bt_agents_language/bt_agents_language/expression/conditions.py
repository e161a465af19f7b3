# SPDX-License-Identifier: Apache-2.0
"""Detection of conditions that are always true or always false.

A comparison with constants has the same result for all values between two adjacent constants. So a
condition with the same result for every choice of these constants, and of a value between each
two, always has that result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

from bt_agents_language.expression.ranges import Range

MOST_CHOICES = 500
"""Maximum number of combinations to try; a condition with more is skipped."""

Constant = bool | int | float | str

_OTHER = "\uffff"
"""Text that does not occur in a condition."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Truth of a part of an expression, depending on its names.

    Attributes:
        holds: Returns whether it is true for some values by name.
        compared: Name → constants that it is compared with. Parts that names and constants do not
            determine have their own names.
    """

    holds: Callable[[Mapping[str, Constant]], bool]
    compared: Mapping[str, frozenset[Constant]]


@dataclass(frozen=True, kw_only=True)
class Domain:
    """Possible values of a name: numbers in a range, or certain texts; empty for any."""

    range: Range | None = None
    texts: Sequence[str] = ()


def of_comparison(
    run: Callable[[Callable[[str], object]], object], name: str, constants: Iterable[Constant]
) -> Condition:
    """Return the condition for a comparison of a name with constants, which ``run`` evaluates."""
    return Condition(
        holds=lambda values: run(values.__getitem__) is True, compared={name: frozenset(constants)}
    )


def of_truth(name: str) -> Condition:
    """Return the condition for the truth of a name."""
    return Condition(
        holds=lambda values: values[name] is True, compared={name: frozenset((True, False))}
    )


def joined(word: str, left: Condition, right: Condition) -> Condition:
    """Return two conditions joined by ``and`` or ``or``."""
    one, other = left.holds, right.holds
    both = word == "and"
    compared = {
        name: left.compared.get(name, frozenset()) | right.compared.get(name, frozenset())
        for name in (*left.compared, *right.compared)
    }
    return Condition(
        holds=(
            (lambda values: one(values) and other(values))
            if both
            else (lambda values: one(values) or other(values))
        ),
        compared=compared,
    )


def negated(condition: Condition) -> Condition:
    """Return the negation of a condition."""
    holds = condition.holds
    return Condition(holds=lambda values: not holds(values), compared=condition.compared)


def verdict(condition: Condition, domain_of: Callable[[str], Domain]) -> bool | None:
    """Return the constant result of a condition; None if both are possible, or too many to try.

    Exceptions of the evaluation are passed on.
    """
    names = [*condition.compared]
    tried = [_samples(condition.compared[name], domain_of(name)) for name in names]
    if not all(tried) or math.prod(map(len, tried)) > MOST_CHOICES:
        return None
    found = set()
    for values in product(*tried):
        found.add(condition.holds(dict(zip(names, values, strict=True))))
        if len(found) > 1:
            return None
    return found.pop()


def _samples(compared: frozenset[Constant], domain: Domain) -> list[Constant]:
    """Return one value of each kind that comparisons distinguish; none for mixed constants."""
    if all(isinstance(one, bool) for one in compared):
        return [True, False]
    if all(isinstance(one, str) for one in compared):
        return [*domain.texts] or [*sorted(map(str, compared)), _OTHER]
    numbers = [one for one in compared if isinstance(one, int | float)]
    if len(numbers) < len(compared) or any(isinstance(one, bool) for one in compared):
        return []
    low, high = domain.range or (min(numbers) - 1, max(numbers) + 1)
    points = sorted({low, high, *(one for one in numbers if low <= one <= high)})
    return [*points, *((one + other) / 2 for one, other in pairwise(points))]
