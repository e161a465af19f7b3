# SPDX-License-Identifier: Apache-2.0
"""Smallest change of one scene value that would have made the runner-up of a round win."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from bt_agents_core.errors import Refused
from marketplace_node.round.decision import Counterfactual
from marketplace_node.round.round_model import RoundModel
from marketplace_node.settings import EXTERNAL
from marketplace_node.strategies import Score, winners

FINEST = 80
"""Maximum number of steps that divide the range of a parameter."""

COARSEST = 8
"""Fewest steps; where bids are too many for them, nothing is tried."""

MOST_NUMBERS = 100_000
"""Most numbers of bids that all tries together compare with a scene."""


_Try = tuple[float, int, float]
"""Size of a change, index of the parameter, and its changed value."""


def smallest_change(model: RoundModel, scores: Sequence[Score], runner_up: int) -> Counterfactual:
    """Return the smallest change of one parameter that makes the runner-up win.

    It ranks the round again with each parameter at each step of its range, and takes the nearest
    value.

    Args:
        model: The round.
        scores: Scores of the unchanged round.
        runner_up: Index of a bid.
    """
    known = [index for index, x in enumerate(model.given.scene) if not math.isnan(x)]
    external = model.external
    if not known:
        return Counterfactual(obstacle="no value of the scene is known")
    if model.spec.name == EXTERNAL and external and not external.failure:
        return Counterfactual(obstacle="only the external program can rank another scene")
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
        for (_, index, value), winner in zip(tries, _winners(model, scores, tries), strict=True):
            if winner == runner_up:
                name = model.space.parameters[index].name
                return Counterfactual(names=(name,), values=(value,))
    except Refused as refused:
        return Counterfactual(obstacle=refused.reason)
    return Counterfactual()


def _winners(model: RoundModel, scores: Sequence[Score], tries: Sequence[_Try]) -> Iterable[int]:
    """Return the index of the winner for each change of a parameter to a value."""
    if model.spec.difference is None:
        return (_winner(model.with_value(index, value)) for _, index, value in tries)
    scenes = np.tile(model.given.scene, (len(tries), 1))
    for scene, (_, index, value) in zip(scenes, tries, strict=True):
        scene[index] = value
    bonuses = [score.bonus for score in scores]
    return winners(model.spec.difference, scenes, model.given.bids, bonuses, model.terms.tie_break)


def _winner(model: RoundModel) -> int:
    return model.order(model.score().scores)[0]
