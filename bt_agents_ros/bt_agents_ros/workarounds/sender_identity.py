# SPDX-License-Identifier: Apache-2.0
"""Subscriptions and services whose callbacks get the participant that sent a message.

rclpy 7.1.6 drops the GID of the publisher and of the client, which the middleware reports with
each message. This module reads both: for a message by taking it with rcl itself, for a request
from the header that rclpy takes. Remove it when rclpy passes GIDs to callbacks.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

from rclpy import node as node_module
from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

from bt_agents_ros.workarounds.local_endpoints import ImplementationWith

UNKNOWN = ""
"""Sender if the middleware does not report it: any but Fast DDS."""

PREFIX = 12
"""Leading bytes of a GUID that all endpoints of a participant share."""

HEARTBEATS_PER_S = 100.0
"""Most heartbeats of a sender that become objects, ten times as many as it sends [1/s]."""

_GID = 16
_MOST_SENDERS = 1_000
_DROPPING_S = 0.01
_NOTHING_TAKEN = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED


class _Allocator(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_void_p)
        for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")
    ]


class _SerializedMessage(ctypes.Structure):
    _fields_ = [
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    ]


class _Gid(ctypes.Structure):
    _fields_ = [("implementation", ctypes.c_char_p), ("data", ctypes.c_uint8 * _GID)]


class _MessageInfo(ctypes.Structure):
    _fields_ = [
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_number", ctypes.c_uint64),
        ("reception_number", ctypes.c_uint64),
        ("publisher", _Gid),
        ("from_intra_process", ctypes.c_bool),
    ]


class _RequestId(ctypes.Structure):
    _fields_ = [("client", ctypes.c_uint8 * _GID), ("sequence_number", ctypes.c_int64)]


class _ServiceInfo(ctypes.Structure):
    _fields_ = [
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("request_id", _RequestId),
    ]


class _IdentifyingSubscription(rclpy_implementation.Subscription):
    """Handle whose messages carry their sender, for any executor that takes from handles."""

    accepts: Callable[[str], bool] | None = None

    def take_message(self, kind: Any, raw: bool) -> tuple[Any, dict[str, Any]] | None:
        rcl, rcutils = _libraries()
        taken = _SerializedMessage(allocator=rcutils.rcutils_get_default_allocator())
        info = _MessageInfo()
        end = 0.0
        try:
            while True:
                code = rcl.rcl_take_serialized_message(
                    self.pointer, ctypes.byref(taken), ctypes.byref(info), None
                )
                if code == _NOTHING_TAKEN:
                    return None
                if code:
                    rcutils.rcutils_reset_error()
                    raise RuntimeError(f"rcl_take_serialized_message has returned {code}")
                sender = _participant(info.publisher.data)
                if self.accepts is None or self.accepts(sender):
                    break
                end = end or time.monotonic() + _DROPPING_S
                if time.monotonic() >= end:
                    return None
            message = ctypes.string_at(taken.buffer, taken.length)
        finally:
            rcutils.rcutils_uint8_array_fini(ctypes.byref(taken))
        return (message if raw else deserialize_message(message, kind)), {"sender": sender}


class SenderRates:
    """Limit on the messages per second of each sender.

    It keeps the heartbeats of one process audible during a flood by another on the same topic.

    Args:
        per_s: Most messages of a sender [1/s].
        clock: Returns the time [s].
    """

    def __init__(
        self, per_s: float = HEARTBEATS_PER_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._period_s = 1.0 / per_s
        self._clock = clock
        self._next_s: dict[str, float] = {}

    def __call__(self, sender: str) -> bool:
        """Return whether to accept a message of a sender."""
        now = self._clock()
        if now < self._next_s.get(sender, now):
            return False
        if len(self._next_s) >= _MOST_SENDERS:
            self._next_s.clear()
        self._next_s[sender] = now + self._period_s
        return True


class IdentifiedRequest(NamedTuple):
    """Request with the participant of its client."""

    request: Any
    sender: str


class _IdentifyingService(rclpy_implementation.Service):
    """Handle whose requests carry their sender."""

    def service_take_request(self, kind: Any) -> tuple[Any, Any]:
        request, header = super().service_take_request(kind)
        if header is None:
            return request, header
        return IdentifiedRequest(request, client_guid(header)[:PREFIX].hex()), header


def create_identified_subscription(
    node: Node,
    kind: Any,
    topic: str,
    callback: Callable[[Any, str], None],
    qos_profile: QoSProfile,
    *,
    raw: bool = False,
    callback_group: CallbackGroup | None = None,
    accepts: Callable[[str], bool] | None = None,
) -> Subscription[Any]:
    """Return a subscription whose callback takes a message and the participant of its sender.

    Args:
        node: The node that listens.
        kind: Type of the messages.
        topic: Name of the topic.
        callback: Takes each message and its sender.
        qos_profile: As for any subscription.
        raw: Whether the callback takes bytes.
        callback_group: Callback group; defaults to that of the node.
        accepts: Returns whether to accept a sender's message; others are dropped at once, several
            thousand in the time of handling one, so that a flood of them does not hold up the
            messages of the right sender. Without it, all messages are accepted.
    """
    with _made_with(Subscription=_IdentifyingSubscription):
        subscription = node.create_subscription(
            kind,
            topic,
            lambda message, info: callback(message, info["sender"]),
            qos_profile,
            callback_group=callback_group,
            raw=raw,
        )
    subscription.handle.accepts = accepts
    return subscription


def create_identified_service(
    node: Node,
    kind: Any,
    name: str,
    callback: Callable[[Any, Any, str], Any],
    qos_profile: QoSProfile,
) -> Service:
    """Return a service whose callback takes a request, a response and the client's participant."""
    with _made_with(Service=_IdentifyingService):
        service = node.create_service(
            kind,
            name,
            lambda asked, response: callback(asked.request, response, asked.sender),
            qos_profile=qos_profile,
        )
    service.is_identified = True
    return service


@contextmanager
def _made_with(**handles: Any) -> Iterator[None]:
    """Let nodes make entities with these handles within this block."""
    before = node_module._rclpy
    node_module._rclpy = ImplementationWith(**handles)
    try:
        yield
    finally:
        node_module._rclpy = before


def client_guid(header: Any) -> bytes:
    """Return the GUID of a client's reader for answers, from the header of a request.

    Args:
        header: Header that rclpy takes with a request of a service or an action; both wrap a C
            structure.

    Returns:
        16 bytes; empty if the middleware does not report it, or for a request of this process.
    """
    is_of_service = isinstance(header, rclpy_implementation.rmw_service_info_t)
    is_of_action = isinstance(header, rclpy_implementation.rmw_request_id_t)
    if not (is_of_service or is_of_action) or not _has_guids():
        return b""
    # In a pybind11 object, the pointer to the wrapped object follows the Python object head.
    wrapped = ctypes.c_void_p.from_address(id(header) + object.__basicsize__).value
    if not wrapped:
        return b""
    if is_of_service:
        info = _ServiceInfo.from_address(wrapped)
        taken, request_id = info.request_id, header.request_id
        agrees = (
            info.source_timestamp == header.source_timestamp
            and info.received_timestamp == header.received_timestamp
        )
    else:
        taken, request_id = _RequestId.from_address(wrapped), header
        agrees = True
    if not agrees or taken.sequence_number != request_id.sequence_number:
        return b""
    return bytes(taken.client)


def _participant(guid: Any) -> str:
    return bytes(guid[:PREFIX]).hex() if _has_guids() else UNKNOWN


@cache
def _has_guids() -> bool:
    """Return whether GIDs of messages and requests are GUIDs, which begin with the participant."""
    return str(get_rmw_implementation_identifier()).startswith("rmw_fastrtps")


@cache
def _libraries() -> tuple[ctypes.CDLL, ctypes.CDLL]:
    """Return the libraries rcl and rcutils, which rclpy has loaded."""
    rcl, rcutils = ctypes.CDLL("librcl.so"), ctypes.CDLL("librcutils.so")
    rcutils.rcutils_get_default_allocator.restype = _Allocator
    rcl.rcl_take_serialized_message.argtypes = (ctypes.c_void_p,) * 4
    rcl.rcl_take_serialized_message.restype = ctypes.c_int
    return rcl, rcutils
