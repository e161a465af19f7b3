# SPDX-License-Identifier: Apache-2.0
"""Checks what a program outside says about the ranking of bids; it may be anything."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_core.errors import Refused
from bt_agents_core.text import ellipsize, printable_line

_SHOWN = 300  # characters of its words
_NAMES = 5


def check_ranking(ranking: Sequence[str], bidders: Sequence[str]) -> tuple[str, ...]:
    """Return a ranking from outside, best first, when it names bidders only and none twice.

    Args:
        ranking: Names of agents; those that it leaves out come after these by distance.
        bidders: Who has bid.

    Raises:
        Refused: ``EMPTY``, ``UNKNOWN_AGENT`` or ``DUPLICATE``.
    """
    if not ranking:
        raise Refused("EMPTY", "it ranks nobody, expected the names of bidders, best first")
    known = set(bidders)
    named: set[str] = set()
    for agent in ranking:
        if agent not in known:
            few = ", ".join(bidders[:_NAMES]) + (" …" if len(bidders) > _NAMES else "")
            raise Refused(
                "UNKNOWN_AGENT", f"it ranks '{shown(agent)}', which has not bid; there are {few}"
            )
        if agent in named:
            raise Refused("DUPLICATE", f"it ranks '{agent}' twice, expected each bidder once")
        named.add(agent)
    return tuple(ranking)


def shown(text: str) -> str:
    """Return words from outside as one line that is not too long."""
    return ellipsize(printable_line(text), _SHOWN)
