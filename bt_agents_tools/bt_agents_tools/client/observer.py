# SPDX-License-Identifier: Apache-2.0
"""Observer node: the state of a running system, and its events in their causal order."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, Protocol

from lifecycle_msgs.msg import State, TransitionEvent
from rclpy.qos import QoSProfile

from bt_agents.host.reload.host_card_diff import CardDiff
from bt_agents_core.health import PartHealth
from bt_agents_core.ros_names import is_full_name
from bt_agents_core.text import printable
from bt_agents_ros import qos
from bt_agents_ros.discovery import node_of
from bt_agents_ros.health_publisher import HealthPublisher
from bt_agents_ros.system_topics import topic_called
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.types import load_type
from bt_agents_ros.workarounds.cached_wait_set import PolledGroup
from bt_agents_tools.client.causal_order import (
    SETTLE_S,
    CausalEvent,
    CausalOrder,
    Links,
    auction_links,
    feedback_links,
    happened_s,
    no_links,
    run_links,
    scene_end_links,
    scene_links,
    tree_links,
)
from bt_agents_tools.client.printable_messages import make_printable
from bt_agents_tools.client.system_client import SystemClient


class Listener(Protocol):
    """Callbacks for the events of a system; the texts of their messages are printable."""

    def visitor(self, label: str) -> None:
        """Handle the label of a new visitor; empty when the visitor leaves."""

    def remark(self, text: str) -> None:
        """Handle a remark of the visitors, such as a change that had no effect."""

    def scene(self, message: Any) -> None:
        """Handle the ``Scene.msg`` of an analysed scene."""

    def market(self, message: Any) -> None:
        """Handle a ``MarketStatus.msg``."""

    def live(self, message: Any) -> None:
        """Handle a ``Scene.msg`` of the live scene."""

    def auction(self, message: Any) -> None:
        """Handle the ``Auction.msg`` of a decided round."""

    def run(self, message: Any) -> None:
        """Handle a ``Run.msg``: start, cancelling or end of a run."""

    def end(self, message: Any) -> None:
        """Handle the ``SceneEnd.msg`` of a scene."""

    def tree(self, message: Any) -> None:
        """Handle the ``TreeStatus.msg`` of a tick that changed something."""

    def act(self, text: str) -> None:
        """Handle a line of the robot's transcript."""

    def feedback(self, message: Any) -> None:
        """Handle the ``Feedback.msg`` of a changed profile."""

    def tunings(self, message: Any) -> None:
        """Handle a ``Tunings.msg`` with the latest changes of a host."""

    def agents_changed(self, text: str, is_error: bool) -> None:
        """Handle a change of a host's agents, or a problem of their files, as text for people."""


MOST_HOSTS = 100
"""Most hosts of a system."""

_LEAVING = (
    State.TRANSITION_STATE_DEACTIVATING,
    State.TRANSITION_STATE_SHUTTINGDOWN,
    State.TRANSITION_STATE_ERRORPROCESSING,
)


class _EventBuffer:
    """Buffer that delivers messages of several subscriptions in causal order."""

    def __init__(self, node: Any) -> None:
        self._order = CausalOrder()
        self._timer = steady_timer(node, SETTLE_S / 2, self._deliver_due, running=False)

    def callback_for(
        self, deliver: Callable[[Any], None], links: Callable[[Any], Links]
    ) -> Callable[[Any, Any], None]:
        """Return the callback of a subscription whose messages have these links."""

        def callback(message: Any, info: Any) -> None:
            make_printable(message)
            sent_s = happened_s(message, int(info["source_timestamp"]) * 1e-9)
            event = CausalEvent(
                sent_s=sent_s, deliver=lambda: deliver(message), links=links(message)
            )
            self._order.put(event, time.monotonic())
            if self._timer.is_canceled():
                self._timer.reset()

        return callback

    def _deliver_due(self) -> None:
        self._order.deliver_due(time.monotonic())
        if self._order.is_empty:
            self._timer.cancel()


class Observer(SystemClient):
    """Client that also subscribes to a running system; it handles messages while it spins.

    It makes texts in messages printable, too.

    Attributes:
        market: Latest status of the marketplace; None before the first.
        cards: Latest card of each host.
        profiles: Latest profiles; None before the first.
        visits_done: True once the visitors report the end of their script.
    """

    def __init__(self) -> None:
        super().__init__()
        self._health: HealthPublisher | None = None
        self.market: Any = None
        self.cards: dict[str, Any] = {}
        self.profiles: Any = None
        self.visits_done = False
        self._listener: Listener | None = None
        self._card_diff = CardDiff()
        self._subscribe("bt_agents/market", self._on_market, qos.FACT)
        self._subscribe("bt_agents/cards", self._on_card, qos.FACTS)
        self._subscribe("bt_agents/profiles", self._on_profiles, qos.FACT)
        self._notified: list[Any] = []

    def notify(self, listener: Listener, *, is_new_robot: bool) -> None:
        """Subscribe to all events, and call a listener for each.

        Args:
            listener: Takes the events.
            is_new_robot: Whether the robot starts after this call; the earlier acts of a running
                robot are left out.
        """
        self._listener = listener
        buffer = _EventBuffer(self.node)
        acts = qos.FACTS if is_new_robot else qos.EVENTS
        for topic, deliver, links, profile in (
            ("visitors/current", lambda m: listener.visitor(m.data), no_links, qos.FACT),
            ("visitors/remarks", lambda m: listener.remark(m.data), no_links, qos.FACTS),
            ("visitors/done", self._on_visits_done, no_links, qos.FACT),
            ("bt_agents/scene", listener.scene, scene_links, qos.EVENTS),
            ("bt_agents/market", listener.market, no_links, qos.FACT),
            ("bt_agents/scene/live", listener.live, no_links, qos.SENSOR),
            # A restarted market or robot may publish these before it has discovered this node.
            ("bt_agents/auctions", listener.auction, auction_links, qos.FACTS),
            ("bt_agents/runs", listener.run, run_links, qos.FACTS),
            ("bt_agents/scene_ends", listener.end, scene_end_links, qos.FACTS),
            ("robot/transcript", lambda m: listener.act(m.data), no_links, acts),
            ("agents/status", listener.tree, tree_links, qos.EVENTS),
            ("bt_agents/feedback", listener.feedback, feedback_links, qos.EVENTS),
            ("agents/tunings", listener.tunings, no_links, qos.FACT),
        ):
            self._notified.append(
                self.node.create_subscription(
                    _type_of(topic), topic, buffer.callback_for(deliver, links), profile
                )
            )

    def _subscribe(self, topic: str, handle: Callable[[Any], None], profile: QoSProfile) -> None:
        def receive(message: Any) -> None:
            handle(make_printable(message))

        self.node.create_subscription(_type_of(topic), topic, receive, profile)

    def watch_heartbeats(
        self, on_heartbeat: Callable[[str], None], names: Collection[str]
    ) -> None:
        """Call back with the component's name for each heartbeat of one.

        Args:
            on_heartbeat: Takes the name.
            names: Nodes to listen to; others may run elsewhere. Any name that belongs to no other
                node is that of a host.
        """
        group = PolledGroup()
        for name in names:
            topic = f"{name}/heartbeat"
            # The content does not matter, so it is not decoded.
            self.node.create_subscription(
                _type_of(topic),
                topic,
                lambda _message, name=name: on_heartbeat(name),
                qos.SENSOR,
                raw=True,
                callback_group=group,
            )

    def watch_states(self, on_state: Callable[[str, str], None], names: Collection[str]) -> None:
        """Call back when a managed node becomes active, or has to leave.

        Args:
            on_state: Takes the node's name and the label of its state.
            names: Names of the nodes.
        """
        for name in names:

            def receive(event: TransitionEvent, name: str = name) -> None:
                is_left = event.start_state.id in _LEAVING
                if is_left or event.goal_state.id == State.PRIMARY_STATE_ACTIVE:
                    on_state(name, event.goal_state.label)

            self._subscribe(f"{name}/transition_event", receive, qos.EVENTS)

    def _on_market(self, message: Any) -> None:
        self.market = message

    def _on_card(self, message: Any) -> None:
        if not is_full_name(message.host) or not self._has_room(message.host):
            return
        self.cards[message.host] = message
        if self._listener is not None:
            for one in self._card_diff.update(message):
                self._listener.agents_changed(one.text, one.is_error)

    def _has_room(self, host: str) -> bool:
        """Return whether a host has a place; a new one may take the place of one that is gone."""
        if host in self.cards or len(self.cards) < MOST_HOSTS:
            return True
        for other in self.cards:
            if not self.node.count_publishers(f"{other}/heartbeat"):
                del self.cards[other]
                self._card_diff.forget(other)
                return True
        return False

    def _on_profiles(self, message: Any) -> None:
        self.profiles = message

    def _on_visits_done(self, message: Any) -> None:
        self.visits_done = bool(message.data)

    def ready(self, agents: int) -> bool:
        """Return True when enough agents are registered and bid with their learned profiles."""
        if self.market is None or self.profiles is None or self.market.agents < agents:
            return False
        bidding = {a.name: a.revision for card in self.cards.values() for a in card.agents}
        message = self.profiles
        learned = zip(message.agents, message.layers, message.revisions, strict=True)
        known = {
            name for name, layer, held in learned if not layer and bidding.get(name, -1) >= held
        }
        return len(known) >= agents

    def namespaces_of_markets(self) -> list[str]:
        """Return the namespaces of the marketplaces discovered on this domain so far."""
        kind = "bt_agents_interfaces/msg/MarketStatus"
        topics = [name for name, kinds in self.node.get_topic_names_and_types() if kind in kinds]
        ends = (end for topic in topics for end in self.node.get_publishers_info_by_topic(topic))
        return sorted({printable(end.node_namespace) for end in ends if node_of(end)})

    def nodes_there(self) -> set[str]:
        """Return the names of the nodes discovered in this namespace so far."""
        found = self.node.get_node_names_and_namespaces()
        return {printable(name) for name, namespace in found if namespace == self.namespace}

    def services_ready(self) -> bool:
        """Return True when the services of scene layer and feedback node are discovered.

        A user with the right to watch only may use neither, so their clients are made here.
        """
        names = ("scene_layer/analyze", "feedback/give")
        return all(self._client(name).service_is_ready() for name in names)

    def hears(self, topic: str) -> bool:
        """Return True when a publisher of a topic of the listener is discovered.

        Earlier messages of a publisher are lost, unless the topic is latched.
        """
        name = self.node.resolve_topic_name(topic)
        return any(one.topic_name == name and one.get_publisher_count() for one in self._notified)

    def is_recorded(self) -> bool:
        """Return True when a journal subscribes to the traces of runs."""
        listeners = self.node.get_subscriptions_info_by_topic("agents/status")
        return any(one.node_name == "journal" for one in listeners)

    def is_visited(self) -> bool:
        """Return True when visitors of a script are already there."""
        return bool(self.node.count_publishers("visitors/done"))

    def judge_health(self, name: str, judge: Callable[[], Iterable[PartHealth]]) -> None:
        """Have :meth:`publish_health` report parts under a name; see :class:`HealthPublisher`."""
        self._health = HealthPublisher(self.node, judge, name)

    def publish_health(self) -> None:
        """Publish the health of the parts if anything listens and it is due; call it often."""
        if self._health is not None and self._health.is_heard:
            self._health.update()

    def received(self, topic: str) -> list[Any]:
        """Return a list that fills with the messages of a topic, the latched ones first."""
        messages: list[Any] = []
        self._subscribe(topic, messages.append, qos.listening(topic_called(topic)))
        return messages


def _type_of(topic: str) -> Any:
    return load_type(topic_called(topic).type)


def profiles_by_agent(message: Any) -> dict[str, Sequence[float]]:
    """Return the vectors of a ``Profiles`` message by agent, without layers."""
    width = len(message.parameters)
    return {
        agent: list(message.vectors[index * width : (index + 1) * width])
        for index, agent in enumerate(message.agents)
        if not message.layers[index]
    }
