# SPDX-License-Identifier: Apache-2.0
"""Outcomes of rounds and runs, separate so that viewers need not load the market."""

from __future__ import annotations

from enum import IntEnum


class AuctionOutcome(IntEnum):
    """Outcome of a round; the numbers match ``Auction.msg``."""

    AWARDED = 1
    NO_BIDS = 2
    PREEMPTS = 3
    WAITS = 4


class RunEventKind(IntEnum):
    """Event in the life of a run; the numbers match ``Run.msg``."""

    STARTED = 1
    CANCELLING = 2
    ENDED = 3
    REFUSED = 4


class RunOutcome(IntEnum):
    """Outcome of a run; the numbers match ``Run.msg``."""

    NONE = 0
    SUCCEEDED = 1
    FAILED = 2
    CANCELLED = 3
    LOST = 4
