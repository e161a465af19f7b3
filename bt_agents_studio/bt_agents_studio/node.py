# SPDX-License-Identifier: Apache-2.0
"""Studio node: messages of a running system are handed to the studio, its requests to services."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException
from rclpy.parameter import parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Empty, String

import bt_agents_interfaces.srv as services
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import (
    AgentFiles,
    Auction,
    Feedback,
    Heartbeat,
    HostCard,
    MarketHeartbeat,
    MarketStatus,
    OpenQuestions,
    Profiles,
    Run,
    Scene,
    SceneEnd,
    Trees,
    TreeStatus,
    Tunables,
    Tunings,
)
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.calls import Calls
from bt_agents_ros.spinner import Spinner

MOST_HOSTS = 100
"""Hosts that are watched, at most."""

_JOIN_S = 3.0

Receive = Callable[[str, Any, float, bool], None]
"""Called with type, message, time of sending [s since 1970] and whether it is the live scene."""


class StudioNode(BaseNode):
    """Subscriptions to all that a studio shows, and clients of all that it asks.

    Args:
        receive: Called with each message.
        beat: Called with the name of a part for each of its heartbeats.
        value: Called with host, name and value of each tunable when it may have changed.
        node_kwargs: For :class:`rclpy.node.Node`.
    """

    def __init__(
        self,
        receive: Receive,
        beat: Callable[[str], None],
        value: Callable[[str, str, Any], None],
        **node_kwargs: Any,
    ) -> None:
        super().__init__("studio", **node_kwargs)
        self._receive = receive
        self._beat = beat
        self._value = value
        self._hosts: set[str] = set()
        self._names: dict[str, list[str]] = {}
        self._calls = Calls(self)
        self._service_clients: dict[str, Client] = {}
        for kind, topic, profile in (
            (Auction, "auctions", qos.FACTS),
            (Feedback, "feedback", qos.FACTS),
            (MarketStatus, "market", qos.FACT),
            (OpenQuestions, "robot/open_questions", qos.FACT),
            (Profiles, "profiles", qos.FACT),
            (Run, "runs", qos.FACTS),
            (Scene, "scene", qos.FACT),
            (SceneEnd, "scene_ends", qos.FACTS),
            (String, "robot/transcript", qos.EVENTS),
        ):
            self._subscribe(kind, topic, profile)
        self._subscribe(Scene, "scene/live", qos.SENSOR, live=True)
        self.create_subscription(HostCard, "cards", self._handle_card, qos.FACTS)
        for kind, name in ((MarketHeartbeat, "marketplace"), (Empty, "robot")):
            self._subscribe_heartbeat(kind, name)

    def call(
        self, kind: str, service: str, fields: Mapping[str, Any], limit_s: float
    ) -> Future[Any]:
        """Ask a service; from any thread. The future has the answer, or raises ``Refused``.

        Args:
            kind: Type of the service in ``bt_agents_interfaces``.
            service: Its name.
            fields: Of the request.
            limit_s: Longest time for discovery and answer [s].
        """
        answer: Future[Any] = Future()
        self.executor.create_task(partial(self._call, answer, kind, service, fields, limit_s))
        return answer

    def _call(
        self,
        answer: Future[Any],
        kind: str,
        service: str,
        fields: Mapping[str, Any],
        limit_s: float,
    ) -> None:
        type_ = getattr(services, kind)
        try:
            request = type_.Request(**fields)
        except (AssertionError, AttributeError, OverflowError) as error:
            answer.set_exception(Refused("BAD_FIELD", str(error)))
            return
        if service not in self._service_clients:
            self._service_clients[service] = self.create_client(
                type_, service, qos_profile=qos.SERVICE
            )
        self._calls.call(
            self._service_clients[service],
            request,
            deadline_s=limit_s,
            on_answer=answer.set_result,
            on_failure=lambda reason: answer.set_exception(Refused("NO_ANSWER", reason)),
        )

    def _subscribe(self, kind: Any, topic: str, profile: Any, *, live: bool = False) -> None:
        package = "std_msgs" if kind is String else "bt_agents_interfaces"
        name = f"{package}/msg/{kind.__name__}"

        def handle(message: Any, info: Mapping[str, Any]) -> None:
            self._receive(name, message, int(info["source_timestamp"]) * 1e-9, live)

        self.create_subscription(kind, topic, handle, profile)

    def _subscribe_heartbeat(self, kind: Any, name: str) -> None:
        # The content does not matter, so it is not decoded.
        self.create_subscription(
            kind, f"{name}/heartbeat", lambda _data: self._beat(name), qos.SENSOR, raw=True
        )

    def _handle_card(self, message: HostCard, info: Mapping[str, Any]) -> None:
        at_s = int(info["source_timestamp"]) * 1e-9
        self._receive("bt_agents_interfaces/msg/HostCard", message, at_s, False)
        host = message.host
        if host in self._hosts or len(self._hosts) >= MOST_HOSTS:
            return
        self._hosts.add(host)
        for kind, topic, profile in (
            (AgentFiles, "files", qos.FACT),
            (Trees, "trees", qos.FACT),
            (TreeStatus, "status", qos.EVENTS),
        ):
            self._subscribe(kind, f"{host}/{topic}", profile)
        self.create_subscription(
            Tunables, f"{host}/tunables", partial(self._handle_tunables, host), qos.FACT
        )
        self.create_subscription(
            Tunings, f"{host}/tunings", partial(self._handle_tunings, host), qos.FACT
        )
        self._subscribe_heartbeat(Heartbeat, host)

    def _handle_tunables(self, host: str, message: Tunables) -> None:
        now_s = self.get_clock().now().nanoseconds * 1e-9
        self._names[host] = [one.name for one in message.tunables]
        self._receive("bt_agents_interfaces/msg/Tunables", message, now_s, False)
        self._read_values(host)

    def _handle_tunings(self, host: str, message: Tunings) -> None:
        now_s = self.get_clock().now().nanoseconds * 1e-9
        self._receive("bt_agents_interfaces/msg/Tunings", message, now_s, False)
        self._read_values(host)

    def _read_values(self, host: str) -> None:
        service = f"{host}/get_parameters"
        if service not in self._service_clients:
            self._service_clients[service] = self.create_client(
                GetParameters, service, qos_profile=qos.SERVICE
            )
        names = list(self._names.get(host, ()))

        def report(answer: Any) -> None:
            for name, value in zip(names, answer.values, strict=False):
                self._value(host, name, parameter_value_to_python(value))

        self._calls.call(
            self._service_clients[service],
            GetParameters.Request(names=names),
            deadline_s=5.0,
            on_answer=report,
            on_failure=lambda reason: self.get_logger().warning(f"values of {host}: {reason}"),
        )


class NodeThread:
    """Thread in which the node lives from its making to its end.

    Args:
        make: Makes the node, in the thread.
    """

    def __init__(self, make: Callable[[], StudioNode]) -> None:
        self._make = make
        self._made: Future[StudioNode] = Future()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ros", daemon=True)

    def start(self) -> StudioNode:
        """Start the thread, and return the node when it is made."""
        self._thread.start()
        return self._made.result()

    def stop(self) -> None:
        """Destroy the node and shut ROS down, within a bounded time."""
        self._stopped.set()
        self._thread.join(_JOIN_S)

    def _run(self) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = self._make()
        except BaseException as error:
            self._made.set_exception(error)
            rclpy.try_shutdown()
            return
        spinner = Spinner(node)
        self._made.set_result(node)
        try:
            while not self._stopped.is_set():
                spinner.spin_once()
        except ExternalShutdownException:
            pass
        finally:
            spinner.close()
            rclpy.try_shutdown()
