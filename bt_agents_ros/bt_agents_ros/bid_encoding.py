# SPDX-License-Identifier: Apache-2.0
"""Serialized bids; only the round number changes between rounds, so the rest is cached."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Protocol

from rclpy.serialization import serialize_message

from bt_agents_interfaces.msg import Bids

_HEADER_BYTES = 4
"""Length of the header that states the encoding rules and the byte order of a message."""

_NUMBER_BYTES = 4
_MARKS = (0x01020304, 0xF1F2F3F4)


class HostAnswer(Protocol):
    """Answer of a host to a call for bids."""

    def fields(self) -> Mapping[str, Any]:
        """Return the fields of ``Bids.msg`` that hold the answer."""


class BidEncoder:
    """Encoder for the answers of one start of a host; it caches the last answer."""

    def __init__(self, host: str, instance: str) -> None:
        self._host = host
        self._instance = instance
        self._encoded: tuple[str, list[int], HostAnswer] | None = None
        self._rest = b""

    def message(self, epoch: str, number: int, token: list[int], answer: HostAnswer) -> bytes:
        """Return the serialized message for an answer in a round of a market."""
        if self._encoded != (epoch, token, answer):
            message = serialize_message(
                Bids(
                    epoch=epoch,
                    host=self._host,
                    host_instance=self._instance,
                    token=token,
                    **answer.fields(),
                )
            )
            self._rest = message[len(_before(epoch)) + _NUMBER_BYTES :]
            self._encoded = (epoch, token, answer)
        return _before(epoch) + number.to_bytes(_NUMBER_BYTES, sys.byteorder) + self._rest


def round_of(data: bytes, like: bytes, epoch: str) -> int | None:
    """Return the round of a serialized message; None if more than the round differs from ``like``.

    It is also None if this process has other encoding rules.
    """
    start = len(_before(epoch))
    end = start + _NUMBER_BYTES
    same = (
        len(data) == len(like)
        and data.startswith(_before(epoch)[:_HEADER_BYTES])
        and data.startswith(like[:start])
        and data.endswith(memoryview(like)[end:])
    )
    return int.from_bytes(data[start:end], sys.byteorder) if same else None


@lru_cache(maxsize=4)
def _before(epoch: str) -> bytes:
    """Return the start of every message for a market, up to the number of the round."""
    # Padding between fields is not initialized, so it differs from message to message.
    one, other = (serialize_message(Bids(epoch=epoch, round=mark)) for mark in _MARKS)
    mine, its = (mark.to_bytes(_NUMBER_BYTES, sys.byteorder) for mark in _MARKS)
    place = next(
        i for i in range(len(one)) if one.startswith(mine, i) and other.startswith(its, i)
    )
    return bytes(one[:place])
