# SPDX-License-Identifier: Apache-2.0
"""Distance of a bid formatted as a sum that people can check."""

from __future__ import annotations

import math

from bt_agents_core.scene import Scene
from bt_agents_core.text import format_number, join_first
from marketplace_node.formatting import FEW, distance
from marketplace_node.round.decision import RankedBid

_TERMS_SHOWN = 12


def calculation(bid: RankedBid, scene: Scene, by: str) -> str:
    """Return the distance of a bid as a sum, and what exploration takes off it.

    ``by`` is the name of the strategy that ranked it.

    Example:
        ``1.5 = |4−5| + |1.5−1|; mood is missing and left out``
    """
    known: list[int] = []
    missing: list[int] = []
    for index, value in enumerate(scene.values):
        (missing if math.isnan(value.value) else known).append(index)
    if not known:
        return f"{distance(bid.distance)}, as every value of the scene is missing"
    terms = [_term(bid, index, scene, by) for index in known[:_TERMS_SHOWN]]
    if len(known) > _TERMS_SHOWN:
        terms.append(f"{len(known) - _TERMS_SHOWN} more")
    text = " + ".join(terms)
    if by == "euclidean":
        text = f"√({text})"
    text = f"{distance(bid.distance)} = {text}"
    if bid.bonus:
        sign = "less" if bid.bonus > 0.0 else "plus"
        text += f", {sign} {format_number(abs(bid.bonus), FEW)} is {distance(bid.score, FEW)}"
    if missing:
        names = join_first(scene.values[index].name for index in missing)
        text += f"; {names} {'is' if len(missing) == 1 else 'are'} missing and left out"
    return text


def _term(bid: RankedBid, index: int, scene: Scene, by: str) -> str:
    if by == "expected_manhattan" and scene.std[index] > 0.0:
        return format_number(bid.contributions[index], FEW)
    wanted = scene.vector[index]
    shown = f"({format_number(wanted)})" if wanted < 0 else format_number(wanted)
    difference = f"|{format_number(bid.vector[index])}−{shown}|"
    if by == "weighted_manhattan" and bid.weights and bid.weights[index] != 1.0:
        return f"{format_number(bid.weights[index])}·{difference}"
    return f"{difference}²" if by == "euclidean" else difference
