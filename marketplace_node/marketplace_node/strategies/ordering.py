# SPDX-License-Identifier: Apache-2.0
"""Puts scored bids in order, ties as declared."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from marketplace_node.strategies.arrays import Floats, Integers

TIE_BREAKS: Final = ("least_recently_run", "name")


def order(
    scores: Floats,
    last_run: Any,
    names: Sequence[str] | None,
    tie_break: str = "least_recently_run",
) -> Integers:
    """Return the indices of bids, best first.

    Args:
        scores: [..., N]; smaller is better.
        last_run: Number of the last run of each bidder, [..., N] or [N]; 0 when it never ran.
        names: Name of each bidder, N; no two alike. None when they stand in the order of their
            names.
        tie_break: ``least_recently_run``: of equal scores the one that ran least recently comes
            first, then by name; ``name``: by name alone.

    Returns:
        Indices along the last axis, [..., N].
    """
    keys: list[Any] = [scores]
    if tie_break == "least_recently_run":
        keys.insert(0, np.broadcast_to(np.asarray(last_run), scores.shape))
    if names is not None:
        by_name = np.empty(len(names), dtype=np.int64)
        by_name[sorted(range(len(names)), key=names.__getitem__)] = np.arange(len(names))
        keys.insert(0, np.broadcast_to(by_name, scores.shape))
    return np.lexsort(keys, axis=-1)  # stable: what is equal stays as it stands
