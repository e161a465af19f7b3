# SPDX-License-Identifier: Apache-2.0
"""Service requests that must arrive: kept while the server is away, sent until it has answered."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from bt_agents_core.delivery_queue import DeliveryQueue
from bt_agents_core.errors import STORAGE_FULL
from bt_agents_ros.timers import steady_timer

ANSWER_S = 2.0
"""A request without an answer for so long is sent again; most answers take less [s]."""

MOST = 1000
"""Requests that are kept; more push the oldest ones out."""

_LOOK_S = 0.1
_REMEMBERED = 10


@dataclass(frozen=True, eq=False)
class _Letter:
    request: Any
    on_done: Callable[[Any | None], None]


class Outbox:
    """Sends requests in order, one at a time, the same one again until the server has answered.

    Server and network may swallow a request or its answer, so the server gets some requests more
    than once: each needs an id of its own by which the server knows it again. Any answer ends a
    request, a late one and a refusal too, except that the server's disk is full: then the request
    is sent again until there is room. What is kept is lost with the process.

    Args:
        node: Whose executor turns the client; call from its thread only.
        client: Client of the service.
        answer_s: A request without an answer for so long is sent again [s].
        most: Requests that are kept.
    """

    def __init__(
        self, node: Node, client: Client, *, answer_s: float = ANSWER_S, most: int = MOST
    ) -> None:
        self._node = node
        self._client = client
        self._letters: DeliveryQueue[_Letter] = DeliveryQueue(
            time.monotonic, most=most, answer_s=answer_s
        )
        self._sendings: deque[Any] = deque()
        self._late = False
        self._timer = steady_timer(node, _LOOK_S, self._send, running=False)

    @property
    def waiting(self) -> int:
        """How many requests have no answer yet."""
        return len(self._letters)

    @property
    def late(self) -> bool:
        """True while the server is away, has no room, or owes an answer for too long."""
        return self._late

    def put(self, request: Any, on_done: Callable[[Any | None], None]) -> None:
        """Keep a request until it is answered.

        Args:
            request: The request message, with an id of its own; not changed any more.
            on_done: Called once on the executor's thread, with the response, or with None when
                so many requests came that this one was dropped unanswered.
        """
        dropped = self._letters.enqueue(_Letter(request, on_done))
        if dropped is not None:
            self._forget()
        self._send()
        if self._timer.is_canceled():
            self._timer.reset()
        if dropped is not None:
            self._node.get_logger().error(
                f"{self._client.srv_name} does not answer, and {self.waiting} requests wait for "
                f"it: the oldest one is lost; start the node that serves it"
            )
            dropped.on_done(None)

    def close(self) -> None:
        """Send no more; say what is lost."""
        self._timer.cancel()
        self._forget()
        if self.waiting:
            self._node.get_logger().error(
                f"{self.waiting} requests to {self._client.srv_name} were never answered and are "
                f"lost with this process"
            )

    def _send(self) -> None:
        if not self._letters:
            self._timer.cancel()
            return
        if not self._client.service_is_ready():
            self._forget()
            self._letters.peer_lost()
            self._tell_late("is not there")
            return
        if self._letters.overdue:
            self._tell_late("has not answered in time")
        letter = self._letters.next_to_send
        if letter is None:
            return
        if len(self._sendings) == _REMEMBERED:
            self._client.remove_pending_request(self._sendings.popleft())
        self._letters.sent()
        sending = self._client.call_async(letter.request)
        self._sendings.append(sending)
        sending.add_done_callback(lambda future: self._answered(letter, future))

    def _tell_late(self, what: str) -> None:
        if not self._late:
            self._late = True
            self._node.get_logger().warning(
                f"{self._client.srv_name} {what}: {self.waiting} request(s) kept and sent again "
                f"until it answers"
            )

    def _forget(self) -> None:
        """Listen no more for answers to what was sent so far."""
        while self._sendings:
            self._client.remove_pending_request(self._sendings.popleft())

    def _answered(self, letter: _Letter, future: Any) -> None:
        if future.exception() is not None or future.result() is None:
            return
        if future.result().code == STORAGE_FULL:
            self._tell_late("has no room on its disk")
            return
        if not self._letters.acknowledge(letter):
            return
        self._forget()
        self._send()
        if self._late and not self._letters:
            self._late = False
            self._node.get_logger().info(f"{self._client.srv_name} has answered everything kept")
        letter.on_done(future.result())
