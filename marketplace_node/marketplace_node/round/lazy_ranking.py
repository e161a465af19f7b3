# SPDX-License-Identifier: Apache-2.0
"""Ranked bids of which the best is known first, and the others when somebody looks at them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import overload

from marketplace_node.round.decision import RankedBid


class LazyRanking(Sequence[RankedBid]):
    """Bids in order, best first; equal to any sequence of equal bids.

    Args:
        best: The first.
        count: How many there are.
        rank: Returns all of them; asked once, when another than the first is looked at.
    """

    def __init__(
        self, best: RankedBid, count: int, rank: Callable[[], tuple[RankedBid, ...]]
    ) -> None:
        self._best = best
        self._count = count
        self._rank = rank

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> RankedBid: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[RankedBid, ...]: ...

    def __getitem__(self, index: int | slice) -> RankedBid | tuple[RankedBid, ...]:
        return self._best if index == 0 else self._all[index]

    def __iter__(self) -> Iterator[RankedBid]:
        return iter(self._all)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self._all == tuple(other)

    def __hash__(self) -> int:
        return hash(self._all)

    def __repr__(self) -> str:
        return repr(self._all)

    @cached_property
    def _all(self) -> tuple[RankedBid, ...]:
        return self._rank()
