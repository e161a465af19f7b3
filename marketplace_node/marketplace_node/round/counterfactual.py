# SPDX-License-Identifier: Apache-2.0
"""Smallest change of one scene value that would have made the runner-up of a round win."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from bt_agents_core.errors import Refused
from marketplace_node.round.decision import Counterfactual
from marketplace_node.round.round_model import RoundModel
from marketplace_node.settings import EXTERNAL
from marketplace_node.strategies import DifferenceFunction

FINEST = 80
"""Most steps in which the range of a parameter is tried."""

COARSEST = 8
"""Fewest steps; where bids are too many for them, nothing is tried."""

MOST_NUMBERS = 100_000
"""Most numbers of bids that all tries together compare with a scene."""


_Try = tuple[float, int, float]
"""Size of a change, index of the parameter, and its changed value."""


def smallest_change(model: RoundModel, runner_up: int) -> Counterfactual:
    """Return the smallest change of one parameter that makes the runner-up win.

    It ranks the round again with each parameter at each step of its range, and takes the nearest
    value.
    """
    known = [index for index, x in enumerate(model.given.scene) if not math.isnan(x)]
    external = model.external
    if not known:
        return Counterfactual(obstacle="no value of the scene is known")
    if model.spec.name == EXTERNAL and external and not external.failure:
        return Counterfactual(
            obstacle="nobody knows how the program outside would have ranked another scene"
        )
    numbers = len(model.given.bids) * len(model.given.scene) * len(known)
    steps = min(FINEST, MOST_NUMBERS // numbers)
    if steps < COARSEST:
        return Counterfactual(obstacle="there are too many bids to search for it")
    tries: list[_Try] = []
    for index in known:
        one, now = model.space.parameters[index], model.given.scene[index]
        for step in range(steps + 1):
            value = one.minimum + (one.maximum - one.minimum) * step / steps
            tries.append((abs(value - now), index, value))
    tries.sort()
    try:
        for (_, index, value), winner in zip(tries, _winners(model, tries), strict=True):
            if winner == runner_up:
                name = model.space.parameters[index].name
                return Counterfactual(names=(name,), values=(value,))
    except Refused as refused:
        return Counterfactual(obstacle=refused.reason)
    return Counterfactual()


def _winners(model: RoundModel, tries: Sequence[_Try]) -> Iterator[int]:
    """Yield the index of the winner for each change of a parameter to a value."""
    if model.spec.difference is not None:
        yield from _by_differences(model, model.spec.difference, tries)
        return
    for _, index, value in tries:
        changed = model.with_value(index, value)
        yield changed.order(changed.score().scores)[0]


def _by_differences(
    model: RoundModel, difference: DifferenceFunction, tries: Sequence[_Try]
) -> list[int]:
    """Return the same for all changes at once; see :class:`StrategySpec`."""
    # Columns are bids in the order of ties, of which argmin takes the first.
    scores = model.score().scores
    columns = model.order([score._replace(score=0.0) for score in scores])
    bids = [model.given.bids[column] for column in columns]
    parts = np.array([scores[column].contributions for column in columns])
    bonuses = np.array([scores[column].bonus for column in columns])
    indices = np.array([index for _, index, _ in tries])[:, np.newaxis]
    values = np.array([value for _, _, value in tries])[:, np.newaxis]
    distances = np.zeros((len(tries), len(columns)))
    # In the order in which a strategy adds: the last digit decides ties.
    for place, part in enumerate(parts.T):
        profiles = np.array([bid.profile[place] for bid in bids])
        weights = np.array([bid.weights[place] for bid in bids])
        changed = difference(profiles, values, weights)
        distances += np.where(indices == place, changed, part)
    return [columns[place] for place in np.argmin(distances - bonuses, axis=1)]
