# SPDX-License-Identifier: Apache-2.0
"""Endpoints of nodes in one process, which exchange messages without middleware.

rclpy 7.1.6 sends each message through the middleware, even to a node of the same process: it
serializes the message, queues it, waits for it and makes it an object again. Here publishers,
subscriptions, services, clients and both ends of actions of a process find each other on its bus;
the middleware, which ignores endpoints of the same process, carries only messages from and to
other processes. Remove this module when rclpy passes messages within a process, as rclcpp does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.action import ActionClient, ActionServer
from rclpy.action import client as client_module
from rclpy.action import server as server_module
from rclpy.client import Client
from rclpy.exceptions import InvalidHandle
from rclpy.executors import await_or_execute
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future

from bt_agents_ros.local_bus import (
    Channel,
    LocalBus,
    LocalMessage,
    LocalQueue,
    LocalReader,
    LocalRequest,
    LocalServer,
    LocalWriter,
)
from bt_agents_ros.message_copy import copied, copier
from bt_agents_ros.workarounds.quiet_action_server import QuietActionServer

_buses: WeakKeyDictionary[Any, LocalBus] = WeakKeyDictionary()


@contextmanager
def handing_over(context: Any, bus: LocalBus) -> Iterator[None]:
    """Connect to a bus all endpoints that nodes of a context make within this block."""
    before = server_module._rclpy, client_module._rclpy
    _buses[context] = bus
    server_module._rclpy = ImplementationWith(ActionServer=_ServerHandle)
    client_module._rclpy = ImplementationWith(ActionClient=_ClientHandle)
    try:
        yield
    finally:
        server_module._rclpy, client_module._rclpy = before
        del _buses[context]


class ImplementationWith:
    """The implementation of rclpy with some of its classes replaced."""

    def __init__(self, **replaced: Any) -> None:
        self.__dict__.update(replaced)

    def __getattr__(self, name: str) -> Any:
        return getattr(rclpy_implementation, name)


class LocalNode(Node):
    """Node whose endpoints connect to the bus of its context, if there is one."""

    def create_publisher(self, *args: Any, **options: Any) -> Publisher[Any]:
        bus = _bus_of(self)
        if bus is None:
            return super().create_publisher(*args, **options)
        made = super().create_publisher(*args, **options, publisher_class=LocalPublisher)
        made.connect(bus)
        return made

    def create_subscription(self, *args: Any, **options: Any) -> Subscription[Any]:
        return _connected(self, super().create_subscription(*args, **options))

    def create_client(self, *args: Any, **options: Any) -> Client:
        return _connected(self, super().create_client(*args, **options))

    def create_service(self, *args: Any, **options: Any) -> Service:
        return _connected(self, super().create_service(*args, **options))

    def add_waitable(self, waitable: Any) -> None:
        super().add_waitable(waitable)
        bus = _bus_of(self)
        if bus is None:
            return
        if isinstance(waitable, ActionServer):
            waitable._handle.connect(bus, self, waitable)
        elif isinstance(waitable, ActionClient):
            waitable._client_handle.connect(bus, self, waitable)


def _connected(node: LocalNode, entity: Any) -> Any:
    """Return a subscription, client or service of a node, on the bus if there is one."""
    bus = _bus_of(node)
    if bus is None:
        return entity
    if isinstance(entity, Subscription):
        entity.__class__ = LocalSubscription
    elif isinstance(entity, Client):
        entity.__class__ = LocalClient
    else:
        entity.__class__ = LocalService
    entity.connect(bus)
    return entity


def _bus_of(node: Node) -> LocalBus | None:
    return _buses.get(node.context)


class LocalPublisher(Publisher):
    """Publisher whose messages go to the subscriptions of the bus, then to other processes.

    A volatile message is written only while another process listens.
    """

    _bus: LocalBus
    _writer: LocalWriter

    def connect(self, bus: LocalBus) -> None:
        """Put it on the bus."""
        self._bus = bus
        channel = _channel(self.msg_type, self.qos_profile)
        self._writer = bus.add_writer(self.topic_name, channel, copier(self.msg_type))

    def publish(self, msg: Any) -> None:
        if isinstance(msg, bytes):
            msg = deserialize_message(msg, self.msg_type)
        if not isinstance(msg, self.msg_type):
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        self._bus.publish(self._writer, msg)
        if self._writer.channel.is_latched:
            # Kept messages are never changed.
            write = partial(self._write, self._writer.kept[-1].message)
            self._bus.send_out(write, self if self._writer.channel.depth == 1 else None)
        elif super().get_subscription_count():
            self._bus.send_out(partial(self._write, self._writer.copy(msg)))

    def _write(self, message: Any) -> None:
        super().publish(message)

    def get_subscription_count(self) -> int:
        return int(super().get_subscription_count()) + len(self._bus.readers_of(self._writer))

    def destroy(self) -> None:
        self._bus.write_out()
        self._bus.remove(self._writer)
        super().destroy()


class LocalSubscription(Subscription):
    """Subscription that also receives messages from publishers on the bus."""

    _bus: LocalBus
    _reader: LocalReader

    def connect(self, bus: LocalBus) -> None:
        """Put it on the bus."""
        self._bus = bus
        channel = _channel(self.msg_type, self.qos_profile)
        queue = LocalQueue(bus, self, channel.depth)
        self._reader = bus.add_reader(self.topic_name, channel, queue)

    def get_publisher_count(self) -> int:
        return int(super().get_publisher_count()) + len(self._bus.writers_of(self._reader))

    def destroy(self) -> None:
        self._bus.remove(self._reader)
        super().destroy()


class LocalService(Service):
    """Service that also answers clients on the bus."""

    _bus: LocalBus
    _server: LocalServer

    def connect(self, bus: LocalBus) -> None:
        """Put it on the bus."""
        self._bus = bus
        queue = LocalQueue(bus, self, _depth(self.qos_profile))
        self._server = bus.add_server(self.service_name, self.srv_type, queue)

    def call_of(self, asked: LocalRequest, _executor: Any) -> Callable[[], Any]:
        """Return a function that calls the callback with a request, and answers it."""

        async def execute() -> None:
            response = await await_or_execute(
                self.callback, asked.request, self.srv_type.Response()
            )
            if not isinstance(response, self.srv_type.Response):
                raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
            asked.answer(copier(self.srv_type.Response)(response))

        return execute

    def destroy(self) -> None:
        self._bus.remove(self._server)
        super().destroy()


class LocalClient(Client):
    """Client that calls a service on the bus, or if there is none, in another process."""

    _bus: LocalBus
    _queue: LocalQueue
    _name: str

    def connect(self, bus: LocalBus) -> None:
        """Put it on the bus."""
        self._bus = bus
        self._name = self.service_name
        self._queue = LocalQueue(bus, self, _depth(self.qos_profile))

    def call_async(self, request: Any) -> Future:
        server = self._server()
        if server is None:
            return super().call_async(request)
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        copied = copier(self.srv_type.Request)(request)
        future = Future()
        number = self._bus.call(server, copied, lambda *answer: self._queue.put(answer))
        with self._lock:
            self._pending_requests[number] = future
        future.add_done_callback(self.remove_pending_request)
        return future

    def call_of(self, answer: tuple[int, Any], executor: Any) -> Callable[[], Any]:
        """Return a function that passes an answer to its future."""

        async def execute() -> None:
            number, response = answer
            future = self._pending_requests.get(number)
            if future is not None:  # something still waits for it
                future._set_executor(executor)
                future.set_result(response)

        return execute

    def service_is_ready(self) -> bool:
        return self._server() is not None or bool(super().service_is_ready())

    def destroy(self) -> None:
        self._queue.close()
        super().destroy()

    def _server(self) -> LocalServer | None:
        return self._bus.server_of(self._name, self.srv_type)


_REQUESTS = {
    "goal": ("send_goal", "SendGoalService"),
    "result": ("get_result", "GetResultService"),
    "cancel": ("cancel_goal", "CancelGoalService"),
}
"""Part of an action, as in the data of its ends → its service, and the attribute with its type.

rclpy passes their profiles in this order, before the profiles of feedback and status.
"""


class _ServerHandle(rclpy_implementation.ActionServer):
    """Handle of an action server that also serves clients on the bus."""

    _bus: LocalBus | None = None

    def __init__(self, node: Any, clock: Any, kind: Any, name: str, *others: Any) -> None:
        super().__init__(node, clock, kind, name, *others)
        self._kind, self._name = kind, name
        self._profiles = [one.to_dict() for one in others[:5]]
        self._ends: list[LocalServer | LocalWriter] = []
        self._states: dict[bytes, GoalStatus] = {}

    def connect(self, bus: LocalBus, node: Node, server: ActionServer) -> None:
        """Put it on the bus."""
        self._bus = bus
        self._server = server
        services = zip(_REQUESTS.items(), self._profiles, strict=False)
        for (part, (service, kind)), profile in services:
            self._ends.append(
                bus.add_server(
                    node.resolve_service_name(f"{self._name}/_action/{service}"),
                    getattr(self._kind.Impl, kind),
                    LocalQueue(bus, server, _depth_in(profile), part),
                )
            )
        self._feedback, self._status = (
            bus.add_writer(
                node.resolve_topic_name(f"{self._name}/_action/{topic}"),
                _channel_in(kind, profile),
                copier(kind),
            )
            for topic, kind, profile in (
                ("feedback", self._kind.Impl.FeedbackMessage, self._profiles[3]),
                ("status", GoalStatusArray, self._profiles[4]),
            )
        )
        self._ends += [self._feedback, self._status]

    def send_goal_response(self, header: Any, response: Any) -> None:
        self._answer(super().send_goal_response, header, response)

    def send_cancel_response(self, header: Any, response: Any) -> None:
        self._answer(super().send_cancel_response, header, response)

    def send_result_response(self, header: Any, response: Any) -> None:
        self._answer(super().send_result_response, header, response)

    def _answer(self, send: Callable[[Any, Any], None], header: Any, response: Any) -> None:
        if isinstance(header, LocalRequest):
            header.answer(copied(response))
        else:
            send(header, response)

    def publish_feedback(self, message: Any) -> None:
        if self._bus is None:
            super().publish_feedback(message)
            return
        self._bus.publish(self._feedback, message)
        self._bus.send_out(partial(super().publish_feedback, copied(message)))

    def publish_status(self) -> None:
        """Publish the latest state of all goals after the nodes have received their messages."""
        if self._bus is None:
            super().publish_status()
        else:
            self._bus.send_out(partial(self._write_status, self._bus), self)

    def _write_status(self, bus: LocalBus) -> None:
        goals = self._server._goal_handles
        states: dict[bytes, GoalStatus] = {}
        for key, goal in goals.items():
            if goal._goal_handle is not None:
                # The property ``status`` takes a lock that the caller may hold.
                status, known = goal._goal_handle.get_status(), self._states.get(key)
                states[key] = (
                    known
                    if known is not None and known.status == status
                    else GoalStatus(goal_info=goal._goal_info, status=status)
                )
        self._states = states
        message = GoalStatusArray(status_list=list(states.values()))
        bus.publish(self._status, message, is_kept=True)
        with suppress(InvalidHandle):
            super().publish_status()

    def destroy_when_not_in_use(self) -> None:
        if self._bus is not None:
            self._bus.write_out()
            for end in self._ends:
                self._bus.remove(end)
            self._ends.clear()
        super().destroy_when_not_in_use()


class _ClientHandle(rclpy_implementation.ActionClient):
    """Handle of an action client that calls the server on the bus, if there is one."""

    _bus: LocalBus | None = None

    def __init__(self, node: Any, kind: Any, name: str, *others: Any) -> None:
        super().__init__(node, kind, name, *others)
        self._kind, self._name = kind, name
        self._profiles = [one.to_dict() for one in others]
        self._names: dict[str, str] = {}
        self._queues: dict[str, LocalQueue] = {}
        self._readers: list[LocalReader] = []

    def connect(self, bus: LocalBus, node: Node, client: ActionClient) -> None:
        """Put it on the bus."""
        self._bus = bus
        for (part, (service, _)), profile in zip(_REQUESTS.items(), self._profiles, strict=False):
            self._names[part] = node.resolve_service_name(f"{self._name}/_action/{service}")
            self._queues[part] = LocalQueue(bus, client, _depth_in(profile), part)
        for topic, kind, profile, copy in (
            ("feedback", self._kind.Impl.FeedbackMessage, self._profiles[3], None),
            ("status", GoalStatusArray, self._profiles[4], partial(_own_states, client)),
        ):
            channel = _channel_in(kind, profile)
            queue = LocalQueue(bus, client, channel.depth, topic)
            name = node.resolve_topic_name(f"{self._name}/_action/{topic}")
            self._readers.append(bus.add_reader(name, channel, queue, copy))

    def send_goal_request(self, request: Any) -> int:
        return self._send("goal", super().send_goal_request, request)

    def send_cancel_request(self, request: Any) -> int:
        return self._send("cancel", super().send_cancel_request, request)

    def send_result_request(self, request: Any) -> int:
        return self._send("result", super().send_result_request, request)

    def _send(self, part: str, send: Callable[[Any], int], request: Any) -> int:
        server = self._server_of(part)
        if self._bus is None or server is None:
            return send(request)
        queue = self._queues[part]
        return self._bus.call(server, copied(request), lambda *answer: queue.put(answer))

    def is_action_server_available(self) -> bool:
        return self._server_of("goal") is not None or bool(super().is_action_server_available())

    def _server_of(self, part: str) -> LocalServer | None:
        if self._bus is None:
            return None
        return self._bus.server_of(self._names[part], getattr(self._kind.Impl, _REQUESTS[part][1]))

    def destroy_when_not_in_use(self) -> None:
        if self._bus is not None:
            for reader in self._readers:
                self._bus.remove(reader)
            for queue in self._queues.values():
                queue.close()
            self._readers.clear()
        super().destroy_when_not_in_use()


def _own_states(client: ActionClient, message: GoalStatusArray) -> GoalStatusArray:
    """Return a copy of the states of the goals that a client follows."""
    followed = client._goal_handles
    states = message.status_list if followed else ()
    return GoalStatusArray(
        status_list=[
            copied(one) for one in states if one.goal_info.goal_id.uuid.tobytes() in followed
        ]
    )


def action_data(queue: LocalQueue, item: Any) -> dict[str, Any]:
    """Return an item for an action server or client as the data it takes from the middleware."""
    match item:
        case LocalRequest():
            data = {queue.part: (item, item.request)}
            if isinstance(queue.entity, QuietActionServer):
                queue.entity.quicken(data)
            return data
        case LocalMessage():
            return {queue.part: item.message}
    return {queue.part: item}


def _channel(kind: Any, profile: QoSProfile) -> Channel:
    return _channel_in(kind, profile.get_c_qos_profile().to_dict())


def _channel_in(kind: Any, profile: Mapping[str, int]) -> Channel:
    return Channel(
        kind=kind,
        depth=_depth_in(profile),
        is_reliable=profile["reliability"] != ReliabilityPolicy.BEST_EFFORT,
        is_latched=profile["durability"] == DurabilityPolicy.TRANSIENT_LOCAL,
    )


def _depth(profile: QoSProfile) -> int | None:
    return _depth_in(profile.get_c_qos_profile().to_dict())


def _depth_in(profile: Mapping[str, int]) -> int | None:
    return None if profile["history"] == HistoryPolicy.KEEP_ALL else max(1, profile["depth"])
