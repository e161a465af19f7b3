# SPDX-License-Identifier: Apache-2.0
"""Subscriptions and services whose callbacks are told which participant a message is from.

rclpy 7.1.6 drops the GID of the publisher and of the client, which the middleware reports with
each message. Both are read here: of a message by taking it with rcl itself, of a request from the
header that rclpy takes. This module can go when rclpy passes GIDs to callbacks.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type
from rclpy.utilities import get_rmw_implementation_identifier

UNKNOWN = ""
"""Sender where the middleware does not say who it is: any but Fast DDS."""

PREFIX = 12
"""Leading bytes of a GUID that all endpoints of a participant share."""

_GID = 16
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


class _ServiceInfo(ctypes.Structure):
    _fields_ = [
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("client", ctypes.c_uint8 * _GID),
        ("sequence_number", ctypes.c_int64),
    ]


class _IdentifyingSubscription(rclpy_implementation.Subscription):
    """Handle whose messages come with their sender, for any executor that takes from handles."""

    def take_message(self, kind: Any, raw: bool) -> tuple[Any, dict[str, Any]] | None:
        rcl, rcutils = _libraries()
        taken = _SerializedMessage(allocator=rcutils.rcutils_get_default_allocator())
        info = _MessageInfo()
        try:
            code = rcl.rcl_take_serialized_message(
                self.pointer, ctypes.byref(taken), ctypes.byref(info), None
            )
            if code == _NOTHING_TAKEN:
                return None
            if code:
                rcutils.rcutils_reset_error()
                raise RuntimeError(f"rcl_take_serialized_message has returned {code}")
            message = ctypes.string_at(taken.buffer, taken.length)
        finally:
            rcutils.rcutils_uint8_array_fini(ctypes.byref(taken))
        sender = _participant(info.publisher.data)
        return (message if raw else deserialize_message(message, kind)), {"sender": sender}


class IdentifiedRequest(NamedTuple):
    """Request with the participant of the client that has sent it."""

    request: Any
    sender: str


class _IdentifyingService(rclpy_implementation.Service):
    """Handle whose requests come with their sender."""

    def service_take_request(self, kind: Any) -> tuple[Any, Any]:
        request, header = super().service_take_request(kind)
        if header is None:
            return request, header
        return IdentifiedRequest(request, _client_of(header)), header


def create_identified_subscription(
    node: Node,
    kind: Any,
    topic: str,
    callback: Callable[[Any, str], None],
    qos_profile: QoSProfile,
    *,
    raw: bool = False,
) -> Subscription[Any]:
    """Return a subscription whose callback takes a message and the participant it is from."""
    check_is_valid_msg_type(kind)
    with node.handle:
        handle = _IdentifyingSubscription(
            node.handle, kind, topic, qos_profile.get_c_qos_profile()
        )
    group = node.default_callback_group
    subscription = Subscription(
        handle,
        kind,
        topic,
        lambda message, info: callback(message, info["sender"]),
        group,
        qos_profile,
        raw,
        event_callbacks=SubscriptionEventCallbacks(),
    )
    group.add_entity(subscription)
    node._subscriptions.append(subscription)
    node._wake_executor()
    for handler in subscription.event_handlers:
        node.add_waitable(handler)
    return subscription


def create_identified_service(
    node: Node,
    kind: Any,
    name: str,
    callback: Callable[[Any, Any, str], Any],
    qos_profile: QoSProfile,
) -> Service:
    """Return a service whose callback takes request, response and the client's participant."""
    check_is_valid_srv_type(kind)
    with node.handle:
        handle = _IdentifyingService(node.handle, kind, name, qos_profile.get_c_qos_profile())
    group = node.default_callback_group
    service = Service(
        handle,
        kind,
        name,
        lambda asked, response: callback(asked.request, response, asked.sender),
        group,
        qos_profile,
    )
    group.add_entity(service)
    node._services.append(service)
    node._wake_executor()
    return service


def _client_of(header: Any) -> str:
    """Return the participant of a client, from the C structure that a request's header wraps."""
    # Of a pybind11 object, the pointer to what it wraps follows the head of the Python object.
    wrapped = ctypes.c_void_p.from_address(id(header) + object.__basicsize__).value
    if not wrapped:
        return UNKNOWN
    info = _ServiceInfo.from_address(wrapped)
    agrees = (
        info.source_timestamp == header.source_timestamp
        and info.received_timestamp == header.received_timestamp
        and info.sequence_number == header.request_id.sequence_number
    )
    return _participant(info.client) if agrees else UNKNOWN


def _participant(guid: Any) -> str:
    return bytes(guid[:PREFIX]).hex() if _has_guids() else UNKNOWN


@cache
def _has_guids() -> bool:
    """Whether GIDs of messages and requests are GUIDs, which begin with their participant."""
    return str(get_rmw_implementation_identifier()).startswith("rmw_fastrtps")


@cache
def _libraries() -> tuple[ctypes.CDLL, ctypes.CDLL]:
    """Return rcl and rcutils, which rclpy has loaded."""
    rcl, rcutils = ctypes.CDLL("librcl.so"), ctypes.CDLL("librcutils.so")
    rcutils.rcutils_get_default_allocator.restype = _Allocator
    rcl.rcl_take_serialized_message.argtypes = (ctypes.c_void_p,) * 4
    rcl.rcl_take_serialized_message.restype = ctypes.c_int
    return rcl, rcutils
