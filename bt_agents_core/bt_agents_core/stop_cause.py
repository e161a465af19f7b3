# SPDX-License-Identifier: Apache-2.0
"""Cause of the stop of a run, as it travels between host and marketplace."""

from __future__ import annotations

from enum import IntEnum


class StopCause(IntEnum):
    """Cause of the stop of a run; the numbers are those of ``RunAgent.action`` and ``Run.msg``.

    Attributes:
        NOT_STOPPED: Its tree has ended by itself.
        BY_MARKET: The marketplace told the host to stop it.
        MARKET_LOST: Its marketplace was silent for too long, or another one has taken its place.
        BY_HOST: The host had a reason of its own.
    """

    NOT_STOPPED = 0
    BY_MARKET = 1
    MARKET_LOST = 2
    BY_HOST = 3
