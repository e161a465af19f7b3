# SPDX-License-Identifier: Apache-2.0
"""Clients of services and actions that leave before their answers are sent.

rmw_fastrtps_shared_cpp 8.4 waits for 0.1 s at each answer to a client that has left, so that 50
requests of one that leaves at once silence a node for 5 s. Here the first such wait shows that a
client has left, and its other requests stay unanswered. No upstream issue is known; remove this
module when the middleware immediately drops an answer without a reader.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

GraphNode: TypeAlias = Callable[[], Node | None]

PREFIX = 12
"""Leading bytes of a GUID that all endpoints of a participant share."""

_SLOW_S = 0.05
_SUSPECT_S = 10.0
_MOST = 1_000


class DepartedClients:
    """Clients that have left, as shown by answers to them and by the graph.

    After one has left, all clients of its participant are looked up in the graph for some time
    before they are answered; those on the graph, perhaps again after a network failure, are
    answered. A service is given by its full name, the service of an action by the end of its name
    from ``_action/`` on, because rclpy does not report the rest. Its node, or for a full name any
    node of the process, is requested only for a look at the graph; without a node, the client
    counts as present.

    Attributes:
        clock: Returns the time [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self._suspect_until: dict[bytes, float] = {}

    def have(self, node: GraphNode, service: str, header: Any) -> bool:
        """Return whether the client of a request has left."""
        if not self._suspect_until:
            return False
        client = _client_guid(header)
        participant = client[:PREFIX]
        until = self._suspect_until.get(participant)
        if until is None:
            return False
        if self.clock() >= until:
            del self._suspect_until[participant]
            return False
        return not _is_shown(node, service, client)

    def answer(
        self, node: GraphNode, service: str, header: Any, send: Callable[[], object]
    ) -> None:
        """Answer a request, unless its client has left."""
        if self.have(node, service, header):
            return
        began = self.clock()
        send()
        self.on_answered(node, service, header, began)

    def on_answered(self, node: GraphNode, service: str, header: Any, began: float) -> None:
        """Handle the end of an answer that began at a time; a slow one may have no reader."""
        if self.clock() - began < _SLOW_S:
            return
        client = _client_guid(header)
        if client and not _is_shown(node, service, client):
            self._suspect_until[client[:PREFIX]] = self.clock() + _SUSPECT_S
            if len(self._suspect_until) > _MOST:
                del self._suspect_until[next(iter(self._suspect_until))]


def _is_shown(graph_node: GraphNode, service: str, client: bytes) -> bool:
    node = graph_node()
    if node is None:
        return True
    if service.startswith("/"):
        services = [service]
    else:
        # A search by the name of the node may find another node with that name.
        known = node.get_service_names_and_types()
        services = [name for name, _ in known if name.endswith(service)]
    return any(
        bytes(reader.endpoint_gid) == client
        for name in services
        for reader in node.get_subscriptions_info_by_topic(f"rr{name}Reply", no_mangle=True)
    )


class _RequestId(ctypes.Structure):
    _fields_ = [("client", ctypes.c_uint8 * 16), ("sequence_number", ctypes.c_int64)]


class _ServiceInfo(ctypes.Structure):
    _fields_ = [
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("request_id", _RequestId),
    ]


def _client_guid(header: Any) -> bytes:
    """Return the GUID of a client's reader for answers, from the header of a request.

    rclpy 7.1.6 does not pass it on, so it is read from the C structure that the header wraps.

    Args:
        header: Header that rclpy takes with a request of a service or an action.

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


@cache
def _has_guids() -> bool:
    """Return whether the ids of clients are GUIDs, which begin with the participant."""
    return str(get_rmw_implementation_identifier()).startswith("rmw_fastrtps")
