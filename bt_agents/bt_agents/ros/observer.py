# SPDX-License-Identifier: Apache-2.0
"""A node that only listens, and tells a listener what happens in the system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Bool, String

from bt_agents.ros import qos
from bt_agents.ros.runner import Turner
from bt_agents_interfaces.msg import (
    Auction,
    Feedback,
    HostCard,
    MarketStatus,
    Profiles,
    Run,
    Scene,
    TreeStatus,
)


class Listener(Protocol):
    """Takes what is heard; the messages as they come."""

    def visitor(self, label: str) -> None:
        """Somebody new stands before the robot."""

    def scene(self, message: Any) -> None:
        """A scene was analysed."""

    def live(self, message: Any) -> None:
        """The scene as it is now."""

    def auction(self, message: Any) -> None:
        """A round was decided."""

    def run(self, message: Any) -> None:
        """A run started, is being cancelled, or ended."""

    def tree(self, message: Any) -> None:
        """A tree changed in a tick."""

    def act(self, words: str) -> None:
        """The robot did something."""

    def feedback(self, message: Any) -> None:
        """A profile moved."""


class Observer:
    """Listens while it is turned.

    Attributes:
        market: The latest status of the marketplace; None before the first.
        cards: The latest card of each host.
        profiles: The latest profiles; None before the first.
        visits_done: True when the visitors say that the script is over.
    """

    def __init__(self, listener: Listener | None = None) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("bt_agents_observer")
        self.market: Any = None
        self.cards: dict[str, Any] = {}
        self.profiles: Any = None
        self.visits_done = False
        self._turner = Turner(self.node)
        self._subscribe(MarketStatus, "market", self._take_market, qos.FACT)
        self._subscribe(HostCard, "cards", self._take_card, qos.FACTS)
        self._subscribe(Profiles, "profiles", self._take_profiles, qos.FACT)
        self._subscribe(Bool, "visitors/done", self._take_done, qos.FACT)
        if listener is not None:
            self._tell(listener)

    def _tell(self, listener: Listener) -> None:
        self._subscribe(String, "visitors/current", lambda m: listener.visitor(m.data), qos.FACT)
        self._subscribe(Scene, "scene", listener.scene, qos.EVENTS)
        self._subscribe(Scene, "scene/live", listener.live, qos.SENSOR)
        self._subscribe(Auction, "auctions", listener.auction, qos.EVENTS)
        self._subscribe(Run, "runs", listener.run, qos.EVENTS)
        self._subscribe(TreeStatus, "agents/status", listener.tree, qos.EVENTS)
        self._subscribe(String, "robot/transcript", lambda m: listener.act(m.data), qos.EVENTS)
        self._subscribe(Feedback, "feedback", listener.feedback, qos.EVENTS)

    def _subscribe(self, kind: Any, topic: str, take: Callable[[Any], None], profile: Any) -> None:
        self.node.create_subscription(kind, topic, take, profile)

    def _take_market(self, message: Any) -> None:
        self.market = message

    def _take_card(self, message: Any) -> None:
        self.cards[message.host] = message

    def _take_profiles(self, message: Any) -> None:
        self.profiles = message

    def _take_done(self, message: Any) -> None:
        self.visits_done = bool(message.data)

    def turn_until(self, done: Callable[[], bool], limit_s: float) -> bool:
        """Turn until ``done()`` is true or the time is up; return ``done()``."""
        return self._turner.turn_until(done, limit_s)

    def call(self, kind: Any, name: str, request: Any, limit_s: float = 3.0) -> Any:
        """Call a service; return its response, or None when it is not there or stays silent."""
        client = self.node.create_client(kind, name, qos_profile=qos.SERVICE)
        if not self.turn_until(client.service_is_ready, limit_s):
            return None
        future = client.call_async(request)
        self.turn_until(future.done, limit_s)
        return future.result() if future.done() else None

    def close(self) -> None:
        """Leave the ROS graph."""
        self._turner.close()
        rclpy.try_shutdown()


def profiles_by_agent(message: Any) -> dict[str, Sequence[float]]:
    """Return the vectors of a ``Profiles`` message by agent."""
    width = len(message.parameters)
    return {
        agent: list(message.vectors[index * width : (index + 1) * width])
        for index, agent in enumerate(message.agents)
    }
