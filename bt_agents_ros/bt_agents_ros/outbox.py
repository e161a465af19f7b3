# SPDX-License-Identifier: Apache-2.0
"""Outbox of service requests: at-least-once delivery in order, even while a server is away."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from bt_agents_core.delivery_queue import DeliveryQueue
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_ros.timers import steady_timer

ANSWER_S = 2.0
"""Time after which an unanswered request is sent again [s]; most answers take less."""

MOST = 1000
"""Maximum number of stored requests; more push the oldest ones out."""

_POLL_S = 0.1
_AWAITED = 10
"""Number of latest attempts to send one request whose answers still count."""


@dataclass(frozen=True, eq=False)
class _Request:
    message: Any
    on_done: Callable[[Any | None], None]


class Outbox:
    """Queue of requests to one service: one in flight, resent until the server has answered.

    A request or its answer may get lost, so the server gets some requests more than once: each
    needs an id by which the server recognises it. Any answer ends a request, even a late one or a
    refusal, unless the server's disk is full: then the request is sent again until there is room.
    The queue is lost with the process. Use it from the thread of the node's executor only.
    """

    def __init__(
        self, node: Node, client: Client, *, answer_s: float = ANSWER_S, most: int = MOST
    ) -> None:
        self._node = node
        self._client = client
        self._queue: DeliveryQueue[_Request] = DeliveryQueue(
            time.monotonic, most=most, answer_s=answer_s
        )
        self._sendings: deque[Any] = deque()
        self._late = False
        self._timer = steady_timer(node, _POLL_S, self._send, running=False)

    @property
    def waiting(self) -> int:
        """Number of unanswered requests."""
        return len(self._queue)

    @property
    def late(self) -> bool:
        """True while the server is away, has no room or is late with an answer."""
        return self._late

    def put(self, request: Any, on_done: Callable[[Any | None], None]) -> None:
        """Enqueue a request with its own id; the caller does not change it any more.

        ``on_done`` is called once on the executor's thread, with the response, or with None if the
        request was dropped because the queue was full.
        """
        dropped = self._queue.enqueue(_Request(request, on_done))
        if dropped is not None:
            self._forget_sendings()
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
        """Stop sending; log the number of lost requests."""
        self._timer.cancel()
        self._forget_sendings()
        if self.waiting:
            self._node.get_logger().error(
                f"{self.waiting} requests to {self._client.srv_name} were never answered and are "
                f"lost with this process"
            )

    def _send(self) -> None:
        if not self._queue:
            self._timer.cancel()
            return
        if not self._client.service_is_ready():
            self._forget_sendings()
            self._queue.peer_lost()
            self._warn_late("is not there")
            return
        if self._queue.overdue:
            self._warn_late("has not answered in time")
        request = self._queue.next_to_send
        if request is None:
            return
        if len(self._sendings) == _AWAITED:
            self._client.remove_pending_request(self._sendings.popleft())
        self._queue.sent()
        sending = self._client.call_async(request.message)
        self._sendings.append(sending)
        sending.add_done_callback(lambda future: self._on_response(request, future))

    def _warn_late(self, what: str) -> None:
        if not self._late:
            self._late = True
            self._node.get_logger().warning(
                f"{self._client.srv_name} {what}: {self.waiting} request(s) stored and sent again "
                f"until it answers"
            )

    def _forget_sendings(self) -> None:
        """Drop the futures of everything sent so far to ignore late answers."""
        while self._sendings:
            self._client.remove_pending_request(self._sendings.popleft())

    def _on_response(self, request: _Request, future: Any) -> None:
        if future.exception() is not None or future.result() is None:
            return
        if future.result().code == RefusalCode.STORAGE_FULL:
            self._warn_late("has no room on its disk")
            return
        if not self._queue.acknowledge(request):
            return
        self._forget_sendings()
        self._send()
        if self._late and not self._queue:
            self._late = False
            self._node.get_logger().info(f"{self._client.srv_name} has answered all of them")
        request.on_done(future.result())
