# SPDX-License-Identifier: Apache-2.0
"""Scene layer on ROS: a scene for every trigger, live scenes during every run."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from std_msgs.msg import Empty

from bt_agents_core.errors import Refused
from bt_agents_core.health import PartHealth
from bt_agents_core.person_facts import values_of
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Origin, Scene, first_id
from bt_agents_core.text import format_known
from bt_agents_core.trees_folder import find_trees
from bt_agents_interfaces.msg import MarketHeartbeat, MarketStatus, Persons, Run, SceneEnd
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import Analyze, Remember
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import Script, Visit
from bt_agents_ros import qos
from bt_agents_ros.health_publisher import PERIOD_S, HealthPublisher
from bt_agents_ros.managed_node import ManagedNode, make_managed
from bt_agents_ros.messages import answering, header_at, scene_from_msg, scene_to_msg, to_time
from bt_agents_ros.parameters import TREES, StartParameter, declare_and_watch, describe
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.workarounds.cached_wait_set import PolledGroup
from scene_layer.health import sources_health
from scene_layer.memory import Memory
from scene_layer.node.memory_store import MemoryStore
from scene_layer.node.script_player import ScriptPlayer
from scene_layer.node.source_subscriptions import SourceSubscriptions
from scene_layer.persons import check_id
from scene_layer.run_tracker import LiveRun, RunTracker
from scene_layer.scene_delivery import KEPT_S, MOST_KEPT, SceneDelivery
from scene_layer.scene_estimator import SceneEstimator, check_given
from scene_layer.sources import Sources

SHORTEST_S = 0.02
"""Shortest time between two live scenes [s]; it combines the changes in between."""

UPDATE_S = 0.1
"""Time between two updates of the present persons without messages [s]."""

_DELIVER_S = 0.1  # period of the polls for a market

_MOST_ANSWERS = 100

_PERSON = {
    Analyze.Request.AS_MEASURED: None,
    Analyze.Request.PRESENT: True,
    Analyze.Request.ABSENT: False,
}


_SCRIPT = StartParameter(
    name="script", description="script to play instead of listening to sensors; empty for none"
)
_MEMORY = StartParameter(
    name="memory",
    description="file that keeps the measured values of known persons and places across "
    "restarts; empty keeps it until the node ends",
)


@dataclass(frozen=True, kw_only=True)
class SceneLayerConfiguration:
    """Inputs of a scene layer.

    Attributes:
        spec: Content of ``scene.yaml``.
        script: Visits to play instead of listening to the sources.
        memory: File that keeps the memory of persons and places across restarts; None for none.
        ids: Generates the scene ids; random ones by default.
    """

    spec: SceneSpec
    script: Script | None = None
    memory: Path | None = None
    ids: Callable[[], str] = lambda: uuid.uuid4().hex


class SceneLayerNode(ManagedNode[SceneLayerConfiguration]):
    """Listens to the sources, or plays a script instead, and publishes scenes."""

    node_name = "scene_layer"
    start_parameters = (TREES, _SCRIPT, _MEMORY)

    def configure(self, values: Mapping[str, str]) -> SceneLayerConfiguration:
        spec = read_scene(find_trees(values["trees"]) / "scene.yaml")
        script, memory = values["script"], values["memory"]
        return SceneLayerConfiguration(
            spec=spec,
            script=read_script(Path(script), spec.space) if script else None,
            memory=Path(memory) if memory else None,
        )

    def activate(self, configuration: SceneLayerConfiguration, closing: ExitStack) -> None:
        """Build the scene layer.

        Raises:
            Refused: A source names a type or field that is not installed, or a topic that cannot
                be subscribed to.
            BtAgentsError: The file is not a memory file, or cannot be read.
        """
        spec, script = configuration.spec, configuration.script
        self._spec = spec
        self._ids = configuration.ids
        self._sources = Sources(spec)
        self._memory = Memory(spec.space)
        self._estimator = SceneEstimator(spec, self._sources, self._memory)
        self._runs = RunTracker()
        self._delivery = SceneDelivery()
        # Market and number of subscribers of scenes when the market was found to be one of them.
        self._matched: tuple[str, int] | None = None
        self._announced_id = ""
        self._answers: dict[str, Any] = {}
        self._live_at = 0.0
        self._persons_at = 0.0
        self._published_persons: object = None
        self._store = MemoryStore(
            self,
            self._memory,
            spec.space,
            configuration.memory,
            lambda: self._estimator.encounters.known,
        )
        closing.callback(self._store.close)
        self._scene_publisher = self.create_publisher(SceneMsg, "bt_agents/scene", qos.FACT)
        self._live_publisher = self.create_publisher(SceneMsg, "bt_agents/scene/live", qos.SENSOR)
        self._persons_publisher = self.create_publisher(
            Persons, "bt_agents/scene/persons", qos.FACT
        )
        self._make_timers()
        self.create_subscription(Run, "bt_agents/runs", self._on_run, qos.HISTORY)
        self.create_subscription(MarketStatus, "bt_agents/market", self._on_market, qos.FACT)
        self.create_subscription(SceneEnd, "bt_agents/scene_ends", self._on_scene_end, qos.FACTS)
        self.create_subscription(
            MarketHeartbeat,
            "marketplace/heartbeat",
            self._on_heartbeat,
            qos.SENSOR,
            callback_group=PolledGroup(),
        )
        self.create_subscription(Empty, "~/trigger", self._on_trigger, qos.EVENTS)
        self.create_service(Analyze, "~/analyze", self._on_analyze, qos_profile=qos.SERVICE)
        self.create_service(Remember, "~/remember", self._on_remember, qos_profile=qos.SERVICE)
        self._player: ScriptPlayer | None = None
        self._source_subscriptions: SourceSubscriptions | None = None
        if script is None:
            persons = self._estimator.encounters.persons
            self._source_subscriptions = SourceSubscriptions(
                self, spec, self._sources, persons, self._on_change
            )
            steady_timer(self, PERIOD_S, HealthPublisher(self, self._judge).update)
        else:
            listened = self._market_listens
            self._player = ScriptPlayer(
                self, script, self._announce_visit, self._begin_visit, self._give, listened
            )

    def _judge(self) -> tuple[PartHealth, ...]:
        assert self._source_subscriptions is not None, "a script needs no sources"
        now = time.monotonic()
        found = self._source_subscriptions.look(now)
        return (sources_health(self._sources.standings(now), self._sources.refusals, found),)

    def begin_stop(self) -> None:
        self._store.request_stop()

    def has_stopped(self) -> bool:
        return self._store.stopped()

    def _make_timers(self) -> None:
        rate = declare_and_watch(
            self,
            "live_rate",
            10.0,
            describe("rate of live scenes while an agent runs [Hz]", minimum=1.0, maximum=50.0),
            self._set_rate,
        )
        self._period_s = 1.0 / float(rate)
        timer = partial(steady_timer, self, running=False)
        self._live_timer = timer(self._period_s, self._publish_live)
        self._soon_timer = timer(SHORTEST_S, self._publish_live)
        self._delivery_timer = timer(_DELIVER_S, self._deliver)
        if self._estimator.encounters.enabled:
            steady_timer(self, UPDATE_S, self._poll)

    def _set_rate(self, hertz: float) -> None:
        self._period_s = 1.0 / hertz
        self._live_timer.timer_period_ns = round(1e9 / hertz)

    # Persons

    def _poll(self) -> None:
        """Update the present persons; publish them if they have changed."""
        running = self._runs.run
        scene_id = running.scene_id if running is not None else None
        moved = self._estimator.update(time.monotonic(), time.time(), scene_id)
        if self._source_subscriptions is not None:
            self._source_subscriptions.subscribe_to_tracked()
        if moved and running is not None:
            self._publish_live()
        self._publish_persons()

    def _publish_persons(self) -> None:
        now, wall = time.monotonic(), time.time()
        if self._spec.persons is None or now - self._persons_at < self._period_s:
            return
        stamp = self._stamp()
        persons = self._estimator.encounters.persons
        scenes = [
            self._estimator.scene_of(person, now=now, wall=wall, stamp=stamp)
            for person in persons.tracked
        ]
        shown = (
            persons.addressee,
            persons.reason,
            [
                (s.person_id, s.place, [(repr(v.value), v.origin) for v in s.values])
                for s in scenes
            ],
        )
        if shown == self._published_persons:
            return
        self._published_persons = shown
        self._persons_at = now
        self._persons_publisher.publish(
            Persons(
                header=header_at(to_time(stamp)),
                rule=self._spec.persons.addressee.rule.value,
                addressee=persons.addressee,
                reason=persons.reason,
                scenes=[scene_to_msg(scene) for scene in scenes],
            )
        )

    # Scenes

    def _on_trigger(self, _message: Empty) -> None:
        self._begin_visit_by_hand("")
        self._announce("", {}, None, urgent=False)

    def _on_analyze(self, request: Any, response: Any) -> Any:
        answered = self._answers.get(request.request_id)
        if answered is not None:
            return answered
        self._analyze(request, response)
        if request.request_id:
            self._answers[request.request_id] = response
            if len(self._answers) > _MOST_ANSWERS:
                del self._answers[next(iter(self._answers))]
        return response

    def _analyze(self, request: Any, response: Any) -> None:
        with answering(response):
            values = check_given(self._spec.space, request.names, request.values)
            if request.person not in _PERSON:
                raise Refused(
                    RefusalCode.UNKNOWN_CHOICE, f"person is {request.person}, expected 0, 1 or 2"
                )
            person = _PERSON[request.person]
            name = _check_name(request)
            gives = bool(values) or person is not None
            if gives and not request.announce and not self._current_id():
                raise Refused(
                    RefusalCode.NOT_RUNNING,
                    "no agent is running and no scene is waiting, so there is nothing to change; "
                    "to start an encounter: bt-agents trigger",
                )
        if not response.accepted:
            return
        if request.announce:
            self._begin_visit_by_hand(name)
            scene, response.kept = self._announce(
                request.label, values, person, request.urgent, request.told, name or None
            )
            response.message = f"scene {scene.scene_id} announced"
            if response.kept:
                response.message = (
                    f"no marketplace is there: scene {scene.scene_id} is kept for "
                    f"{KEPT_S:g} s, and announced as soon as there is one"
                )
        else:
            scene = self._give(values, person, told=request.told)
            response.message = _told_of(scene, values)
        response.scene = scene_to_msg(scene)

    def _on_remember(self, request: Any, response: Any) -> Any:
        with answering(response):
            given = values_of(request.facts)
            self._memory.remember(request.person_id, given, known=self._estimator.encounters.known)
            response.message = f"remembered of {request.person_id}"
            if not self._store.lasts:
                response.message += "; the memory ends with the scene layer"
                self.get_logger().warning(
                    "this scene layer forgets all values when it ends; its parameter 'memory', or "
                    "bt-agents up --memory, keeps it",
                    once=True,
                )
            self._on_change()
        return response

    def _begin_visit(self, name: str) -> None:
        self._estimator.encounters.begin_visit(name, time.monotonic(), time.time())

    def _begin_visit_by_hand(self, name: str) -> None:
        """Begin the visit of a named person, or of an unnamed one.

        Skipped for tracked persons, and with a script for unnamed ones: it begins its own visits.
        """
        tracked = name in self._estimator.encounters.persons.tracked
        if not tracked and (name or self._player is None):
            self._begin_visit(name)

    def _announce_visit(self, visit: Visit) -> Scene:
        return self._announce(
            visit.label, visit.values, visit.person, visit.urgent, person_id=visit.name or None
        )[0]

    def _announce(
        self,
        label: str,
        values: Mapping[str, float],
        person: bool | None,
        urgent: bool,
        told: bool = False,
        person_id: str | None = None,
    ) -> tuple[Scene, bool]:
        """Publish a scene; return it, and whether it is kept for an absent market."""
        if self._estimator.encounters.enabled:
            self._poll()
        now = time.monotonic()
        self._announced_id = self._ids()
        self._estimator.begin(
            self._announced_id,
            label,
            values,
            person,
            now,
            urgent=urgent,
            told=told,
            person_id=person_id,
        )
        scene = self._scene_now(self._announced_id, now)
        kept = self._delivery.announce(scene, now, listens=self._market_listens())
        self._scene_publisher.publish(scene_to_msg(scene))
        if self._delivery_timer.is_canceled():
            self._delivery_timer.reset()
        return scene, kept

    def _deliver(self) -> None:
        """Resend the scenes that no market has shown to have."""
        now = time.monotonic()
        for scene in self._delivery.given_up(now):
            self.get_logger().error(
                f"NO_MARKET: scene {scene.scene_id} is given up; without a marketplace the last "
                f"{MOST_KEPT} are kept, for {KEPT_S:g} s"
            )
        if not self._delivery.pending:
            self._delivery_timer.cancel()
        elif self._delivery.market_there(now):
            for scene in self._delivery.due(now, listens=self._market_listens()):
                self.get_logger().info(f"scene {scene.scene_id} is sent to the marketplace again")
                self._scene_publisher.publish(scene_to_msg(scene))

    def _on_heartbeat(self, message: Any) -> None:
        self._delivery.heartbeat(message.epoch, time.monotonic())

    def _on_scene_end(self, message: Any) -> None:
        self._delivery.shown({message.scene_id})

    def _give(
        self, values: Mapping[str, float], person: bool | None, *, told: bool = False
    ) -> Scene:
        """Give values to the current interaction; without one they have no effect."""
        now = time.monotonic()
        scene_id = self._current_id()
        if scene_id:
            self._estimator.give(scene_id, values, person, now, told=told)
            self._on_change()
        return self._scene_now(scene_id, now)

    def _current_id(self) -> str:
        """Return the id of the running scene, else of the last announced one; empty if over."""
        running = self._runs.run
        return running.scene_id if running is not None else self._announced_id

    def _scene_now(self, scene_id: str, now: float) -> Scene:
        return self._estimator.scene(scene_id, now=now, wall=time.time(), stamp=self._stamp())

    def _stamp(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    # The live scene

    def _on_run(self, message: Any) -> None:
        if message.event == Run.STARTED:
            self._on_started(message)
        elif message.event == Run.ENDED:
            self._runs.ended(message.epoch, message.round)
            self._stop_when_over()

    def _on_started(self, message: Any) -> None:
        try:
            scene = scene_from_msg(message.scene, self._spec.space)
        except Refused as refused:
            self.get_logger().warning(f"no live scene for round {message.round}: {refused}")
            return
        started = LiveRun(epoch=message.epoch, round=message.round, scene_id=scene.scene_id)
        if not self._runs.started(started):
            return
        self._estimator.adopt(scene, time.monotonic())
        self._live_timer.reset()
        if self._player is not None:
            self._player.started(scene.scene_id)

    def _on_change(self) -> None:
        if self._runs.run is None:
            return
        if time.monotonic() - self._live_at >= SHORTEST_S:
            self._publish_live()
        elif self._soon_timer.is_canceled():
            self._soon_timer.reset()

    def _publish_live(self) -> None:
        self._soon_timer.cancel()
        if self._runs.run is None:
            return
        self._live_at = time.monotonic()
        scene = self._scene_now(self._runs.run.scene_id, self._live_at)
        self._live_publisher.publish(scene_to_msg(scene))

    def _stop_when_over(self) -> None:
        if self._runs.run is None:
            self._live_timer.cancel()
            self._soon_timer.cancel()

    def _on_market(self, message: Any) -> None:
        idle = message.state == MarketStatus.IDLE
        self._runs.market(message.epoch, message.round, idle)
        self._delivery.shown({message.scene_id, *message.waiting})
        self._stop_when_over()
        if first_id(message.finished_scene_id) == self._announced_id:
            # Values given for it do not apply to later interactions.
            self._announced_id = ""
        if self._player is not None:
            self._player.market(message)

    def _market_listens(self) -> bool:
        """Whether the publisher of the market's status also matches as a subscriber of scenes.

        The graph is searched again only for another market, or when subscribers come or go.
        """
        count = self._scene_publisher.get_subscription_count()
        if self._matched != (self._delivery.epoch, count):
            markets = {_who(e) for e in self.get_publishers_info_by_topic("bt_agents/market")}
            readers = self.get_subscriptions_info_by_topic("bt_agents/scene")
            listens = bool(markets & {_who(e) for e in readers}) and count >= len(readers)
            self._matched = (self._delivery.epoch, count) if listens else None
        return self._matched is not None


def _who(endpoint: Any) -> tuple[str, str]:
    return endpoint.node_namespace, endpoint.node_name


def _check_name(request: Any) -> str:
    """Return the name of the person in an announced scene; empty for none.

    Raises:
        Refused: ``NAMED_NOBODY``, or as :func:`check_id`.
    """
    if not request.name:
        return ""
    if not request.announce or request.person == Analyze.Request.ABSENT:
        raise Refused(
            RefusalCode.NAMED_NOBODY,
            "a name is given, expected one only where a scene with a person is announced",
        )
    return check_id(request.name)


def _told_of(live: Scene, given: Mapping[str, float]) -> str:
    """Return in words what happened to values given to the live scene."""
    parts = []
    for one in live.values:
        if one.name not in given:
            continue
        value = format_known(one.value)
        if one.origin is Origin.MEASURED:
            parts.append(f"{one.name} stays {value}, as {one.source or 'a source'} measures it")
        else:
            parts.append(f"{one.name} is now {value}")
    return f"live scene updated: {'; '.join(parts)}" if parts else "live scene updated"


def make_node() -> SceneLayerNode:
    """Create the node from the parameters of its process.

    Raises:
        BtAgentsError: The trees folder, ``scene.yaml`` or the script cannot be used.
    """
    return make_managed(SceneLayerNode)


def main(args: Sequence[str] | None = None) -> int:
    """Run the scene layer until it is stopped; return the exit code."""
    return run(make_node, args)
