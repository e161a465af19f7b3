# SPDX-License-Identifier: Apache-2.0
"""Service calls with a deadline: each ends in exactly one callback."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from bt_agents_ros.timers import OneShot

_POLL_S = 0.02
"""Period for polling a server that is not ready [s]; rclpy has no event for that."""


@dataclass(eq=False)
class _Call:
    client: Client
    request: Any
    deadline: float
    on_answer: Callable[[Any], None]
    on_failure: Callable[[str], None]
    future: Any = field(default=None)


class Calls:
    """Client side of service calls; call it from the executor's thread only.

    A request waits for its server until the deadline, so a server that is just starting is found.
    A late answer is discarded.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._open: list[_Call] = []
        self._timer = OneShot(node, self._poll)

    def call(
        self,
        client: Client,
        request: Any,
        *,
        deadline_s: float,
        on_answer: Callable[[Any], None],
        on_failure: Callable[[str], None],
    ) -> None:
        """Send a request; exactly one of the two callbacks follows, on the executor's thread.

        The deadline [s] is for finding the server and getting the answer; ``on_failure`` takes the
        reason.
        """
        call = _Call(client, request, time.monotonic() + deadline_s, on_answer, on_failure)
        self._open.append(call)
        self._send(call)
        self._set_timer()

    def _send(self, call: _Call) -> None:
        if call.future is None and call.client.service_is_ready():
            call.future = call.client.call_async(call.request)
            call.future.add_done_callback(lambda future: self._on_response(call, future))

    def _on_response(self, call: _Call, future: Any) -> None:
        if call not in self._open:
            return
        self._open.remove(call)
        self._set_timer()
        error = future.exception()
        if error is not None:
            call.on_failure(f"{call.client.srv_name} failed: {error}")
        elif future.result() is not None:
            call.on_answer(future.result())
        else:
            call.on_failure(f"{call.client.srv_name} was cancelled")

    def _poll(self) -> None:
        now = time.monotonic()
        try:
            for call in list(self._open):
                if now < call.deadline:
                    self._send(call)
                    continue
                self._open.remove(call)
                if call.future is None:
                    call.on_failure(f"{call.client.srv_name} is not there")
                else:
                    call.client.remove_pending_request(call.future)
                    call.on_failure(f"{call.client.srv_name} did not answer in time")
        finally:
            self._set_timer()

    def _set_timer(self) -> None:
        due = min((call.deadline for call in self._open), default=math.inf)
        if any(call.future is None for call in self._open):
            due = min(due, time.monotonic() + _POLL_S)
        self._timer.set(due)
