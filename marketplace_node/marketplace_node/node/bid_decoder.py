# SPDX-License-Identifier: Apache-2.0
"""Decoder of bids, with a cache: an answer equal to the host's last one is not decoded again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from rclpy.serialization import deserialize_message

from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Bids as BidsMsg
from bt_agents_ros import bid_encoding
from marketplace_node.node.messages import bids_from_msg
from marketplace_node.round.decision import Bids


class BidDecoder:
    """Decoder that caches the last answer of each host, of those that ``is_known`` accepts."""

    def __init__(self, epoch: str, is_known: Callable[[str], bool]) -> None:
        self._epoch = epoch
        self._is_known = is_known
        self._last: dict[str, tuple[bytes, Bids]] = {}

    def read(self, message: bytes) -> Bids:
        """Return the answer in a serialised message; the auction checks it.

        Raises:
            Refused: ``MALFORMED``.
        """
        for last, bids in self._last.values():
            number = bid_encoding.round_of(message, last, self._epoch)
            if number is not None:
                return replace(bids, round=number)
        try:
            bids = bids_from_msg(deserialize_message(message, BidsMsg))
        except Exception as error:
            raise Refused("MALFORMED", f"bids that are no message: {error}") from None
        if bids.epoch == self._epoch and self._is_known(bids.host):
            self._last[bids.host] = (message, bids)
        return bids

    def forget(self, host: str) -> None:
        """Drop what is cached of a host."""
        self._last.pop(host, None)
