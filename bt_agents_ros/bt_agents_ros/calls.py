# SPDX-License-Identifier: Apache-2.0
"""Service calls with a deadline: each ends in exactly one callback."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from bt_agents_ros.timers import OneShot

_POLL_S = 0.02
"""Period for polling a server that is not ready [s]; rclpy has no event for that."""

REPEAT_S = 0.5
"""Period for resending a request with an id until it is answered [s]."""

_ID_FIELDS = ("request_id", "feedback_id")


def identify(request: Any) -> bool:
    """Return whether a request may be sent again; it gets an id if its type has one.

    A server accepts the same id once. The graph shows a killed server until its lease ends: a
    request that is sent before the restarted server is discovered gets lost.
    """
    for name in _ID_FIELDS:
        if hasattr(request, name):
            setattr(request, name, getattr(request, name) or uuid.uuid4().hex)
            return True
    return False


@dataclass(eq=False)
class _Call:
    client: Client
    request: Any
    deadline: float
    discover_by: float
    on_answer: Callable[[Any], None]
    on_failure: Callable[[str], None]
    send_at: float = 0.0
    futures: list[Any] = field(default_factory=list)

    @property
    def ends_at(self) -> float:
        """Time at which it fails: earlier while its server has not been found."""
        return self.deadline if self.futures else self.discover_by


class Calls:
    """Client side of service calls; use it from the executor's thread only.

    A request waits for its server until the deadline, so it reaches a server that is just
    starting. One with an id is sent again until its first answer. Late answers are discarded.
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
        discovery_s: float = math.inf,
    ) -> None:
        """Send a request; exactly one of the two callbacks follows, on the executor's thread.

        The deadline [s] covers finding the server and getting the answer; a server that is not
        found within ``discovery_s`` ends the call earlier. ``on_failure`` takes the reason.
        """
        now = time.monotonic()
        discover_by = now + min(discovery_s, deadline_s)
        call = _Call(client, request, now + deadline_s, discover_by, on_answer, on_failure)
        self._open.append(call)
        self._send(call)
        self._set_timer()

    def fail(self, client: Client, reason: str) -> None:
        """End all calls of a client that is about to be destroyed, with a reason."""
        for call in [one for one in self._open if one.client is client]:
            self._end(call)
            call.on_failure(reason)
        self._set_timer()

    def _send(self, call: _Call) -> None:
        now = time.monotonic()
        if now < call.send_at or not call.client.service_is_ready():
            return
        call.send_at = now + REPEAT_S if identify(call.request) else math.inf
        try:
            future = call.client.call_async(call.request)
        except Exception as error:
            # A request that cannot be sent, such as half a character, must not block the others.
            self._end(call)
            call.on_failure(f"{call.client.srv_name} cannot be asked: {error}")
            return
        call.futures.append(future)
        future.add_done_callback(lambda future: self._on_response(call, future))

    def _on_response(self, call: _Call, future: Any) -> None:
        if call not in self._open:
            return
        self._end(call)
        self._set_timer()
        error = future.exception()
        if error is not None:
            call.on_failure(f"{call.client.srv_name} failed: {error}")
        elif future.result() is not None:
            call.on_answer(future.result())
        else:
            call.on_failure(f"{call.client.srv_name} was cancelled")

    def _end(self, call: _Call) -> None:
        self._open.remove(call)
        for future in call.futures:
            call.client.remove_pending_request(future)

    def _poll(self) -> None:
        now = time.monotonic()
        try:
            for call in list(self._open):
                if now < call.ends_at:
                    self._send(call)
                    continue
                self._end(call)
                if call.futures:
                    call.on_failure(f"{call.client.srv_name} did not answer in time")
                else:
                    call.on_failure(f"{call.client.srv_name} is not there")
        finally:
            self._set_timer()

    def _set_timer(self) -> None:
        due = min((min(call.ends_at, call.send_at) for call in self._open), default=math.inf)
        self._timer.set(max(due, time.monotonic() + _POLL_S))
