# SPDX-License-Identifier: Apache-2.0
"""A node that only listens, and tells a listener what happens in the system."""

from __future__ import annotations

import heapq
import os
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Bool, Empty, String

from bt_agents_interfaces.msg import (
    Auction,
    Feedback,
    Heartbeat,
    HostCard,
    MarketHeartbeat,
    MarketStatus,
    Profiles,
    Run,
    Scene,
    SceneEnd,
    TreeStatus,
    Tunings,
)
from bt_agents_interfaces.srv import Analyze, GiveFeedback
from bt_agents_ros import qos
from bt_agents_ros.spinner import Spinner
from bt_agents_ros.timers import steady_timer
from bt_agents_tools.client.card_listener import CardListener


class Listener(Protocol):
    """Takes what is heard; the messages as they come."""

    def visitor(self, label: str) -> None:
        """Somebody new stands before the robot."""

    def scene(self, message: Any) -> None:
        """A scene was analysed."""

    def market(self, message: Any) -> None:
        """The market does something else than before."""

    def live(self, message: Any) -> None:
        """The scene as it is now."""

    def auction(self, message: Any) -> None:
        """A round was decided."""

    def run(self, message: Any) -> None:
        """A run started, is being cancelled, or ended."""

    def end(self, message: Any) -> None:
        """A scene ended."""

    def tree(self, message: Any) -> None:
        """A tree changed in a tick."""

    def act(self, words: str) -> None:
        """The robot did something."""

    def feedback(self, message: Any) -> None:
        """A profile moved."""

    def tunings(self, message: Any) -> None:
        """Values were tuned; the last changes of a host, and first of all what is known of it."""

    def news(self, words: str, bad: bool) -> None:
        """The agents of a host have changed, or something is wrong with their files."""


_FIND_S = 10.0
"""How long discovery may take on a busy machine [s]."""

_SETTLE_S = 0.1
"""How long an event waits for one of another topic that was sent before it [s]."""


class _InOrder:
    """Passes events of several topics on in the order in which they were sent."""

    def __init__(self, node: Any) -> None:
        self._waiting: list[tuple[int, int, Callable[[], None]]] = []
        self._count = 0
        steady_timer(node, _SETTLE_S / 2, self._pass_on)

    def take(self, deliver: Callable[[Any], None]) -> Callable[[Any, Any], None]:
        """Return a callback of a subscription that delivers in order."""

        def callback(message: Any, info: Any) -> None:
            self._count += 1
            sent = int(info["source_timestamp"])
            heapq.heappush(self._waiting, (sent, self._count, lambda: deliver(message)))

        return callback

    def _pass_on(self) -> None:
        settled = time.time_ns() - int(_SETTLE_S * 1e9)
        while self._waiting and self._waiting[0][0] <= settled:
            heapq.heappop(self._waiting)[2]()


class Observer:
    """Listens while it is turned.

    Attributes:
        namespace: Where the system is; the environment's ``ROS_NAMESPACE``.
        market: The latest status of the marketplace; None before the first.
        cards: The latest card of each host.
        profiles: The latest profiles; None before the first.
        visits_done: True when the visitors say that the script is over.
    """

    def __init__(self, listener: Listener | None = None) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(
            "bt_agents_observer",
            namespace=os.environ.get("ROS_NAMESPACE", ""),
            start_parameter_services=False,
        )
        self.namespace = self.node.get_namespace()
        self.market: Any = None
        self.cards: dict[str, Any] = {}
        self.profiles: Any = None
        self.visits_done = False
        self._spinner = Spinner(self.node)
        self._card_listener: CardListener | None = None
        self._subscribe(MarketStatus, "market", self._take_market, qos.FACT)
        self._subscribe(HostCard, "cards", self._take_card, qos.FACTS)
        self._subscribe(Profiles, "profiles", self._take_profiles, qos.FACT)
        self._services = [
            self.node.create_client(Analyze, "scene_layer/analyze", qos_profile=qos.SERVICE),
            self.node.create_client(GiveFeedback, "feedback/give", qos_profile=qos.SERVICE),
        ]
        if listener is not None:
            self._tell(listener)

    def _tell(self, listener: Listener) -> None:
        self._card_listener = CardListener(self.node, listener.news)
        order = _InOrder(self.node)
        for kind, topic, deliver, profile in (
            (String, "visitors/current", lambda m: listener.visitor(m.data), qos.FACT),
            (Bool, "visitors/done", self._take_done, qos.FACT),
            (Scene, "scene", listener.scene, qos.EVENTS),
            (MarketStatus, "market", listener.market, qos.FACT),
            (Scene, "scene/live", listener.live, qos.SENSOR),
            # A market that is started again may say these before it is known to be back.
            (Auction, "auctions", listener.auction, qos.FACTS),
            (Run, "runs", listener.run, qos.FACTS),
            (SceneEnd, "scene_ends", listener.end, qos.FACTS),
            (TreeStatus, "agents/status", listener.tree, qos.EVENTS),
            (String, "robot/transcript", lambda m: listener.act(m.data), qos.EVENTS),
            (Feedback, "feedback", listener.feedback, qos.EVENTS),
            (Tunings, "agents/tunings", listener.tunings, qos.FACT),
        ):
            self._subscribe(kind, topic, order.take(deliver), profile)

    def hear_heartbeats(self, heard: Callable[[str], None]) -> None:
        """Have a callable told the name of each node of the system that gives a sign of life."""
        for kind, name in (
            (MarketHeartbeat, "marketplace"),
            (Heartbeat, "agents"),
            (Empty, "robot"),
        ):
            # What they say does not matter here, so it is not even decoded.
            self.node.create_subscription(
                kind,
                f"{name}/heartbeat",
                lambda _message, name=name: heard(name),
                qos.SENSOR,
                raw=True,
            )

    def _subscribe(self, kind: Any, topic: str, take: Callable[..., None], profile: Any) -> None:
        self.node.create_subscription(kind, topic, take, profile)

    def _take_market(self, message: Any) -> None:
        self.market = message

    def _take_card(self, message: Any) -> None:
        self.cards[message.host] = message
        if self._card_listener is not None:
            self._card_listener.take(message)

    def _take_profiles(self, message: Any) -> None:
        self.profiles = message

    def _take_done(self, message: Any) -> None:
        self.visits_done = bool(message.data)

    def ready(self, agents: int) -> bool:
        """Return True when so many agents are registered and bid with what they have learned."""
        if self.market is None or self.profiles is None or self.market.agents < agents:
            return False
        bidding = {a.name: a.revision for card in self.cards.values() for a in card.agents}
        message = self.profiles
        learned = zip(message.agents, message.layers, message.revisions, strict=True)
        known = {
            name
            for name, layer, revision in learned
            if not layer and bidding.get(name, -1) >= revision
        }
        return len(known & set(bidding)) >= agents

    def namespaces_of_markets(self) -> list[str]:
        """Return where marketplaces are on this domain, as far as that is known yet."""
        kind = "bt_agents_interfaces/msg/MarketStatus"
        topics = [name for name, kinds in self.node.get_topic_names_and_types() if kind in kinds]
        return sorted(
            {
                end.node_namespace
                for topic in topics
                for end in self.node.get_publishers_info_by_topic(topic)
            }
        )

    def can_be_asked(self) -> bool:
        """Return True when scene layer and feedback node answer requests."""
        return all(service.service_is_ready() for service in self._services)

    def recorded(self) -> bool:
        """Return True when a journal listens to what trees are told."""
        return bool(self.node.count_subscribers("agents/records"))

    def turn_until(self, done: Callable[[], bool], limit_s: float) -> bool:
        """Turn until ``done()`` is true or the time is up; return ``done()``."""
        return self._spinner.spin_until(done, limit_s)

    def call(
        self, kind: Any, name: str, request: Any, limit_s: float = 5.0, *, find_s: float = _FIND_S
    ) -> Any:
        """Call a service; return its response, or None when it is not there or stays silent.

        Args:
            kind: Type of the service.
            name: Its name.
            request: The request.
            limit_s: For the answer [s].
            find_s: For the service itself [s].
        """
        client = self.node.create_client(kind, name, qos_profile=qos.SERVICE)
        if not self.spin_until(client.service_is_ready, find_s):
            return None
        future = client.call_async(request)
        self.spin_until(future.done, limit_s)
        return future.result() if future.done() else None

    def close(self) -> None:
        """Leave the ROS graph."""
        self._spinner.close()
        rclpy.try_shutdown()


def profiles_by_agent(message: Any) -> dict[str, Sequence[float]]:
    """Return the vectors of a ``Profiles`` message by agent, without those of layers."""
    width = len(message.parameters)
    return {
        agent: list(message.vectors[index * width : (index + 1) * width])
        for index, agent in enumerate(message.agents)
        if not message.layers[index]
    }
