# SPDX-License-Identifier: Apache-2.0
"""The scene layer as a ROS node: a scene for every trigger, a live one during every run."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from std_msgs.msg import Empty

from bt_agents.errors import Refused
from bt_agents.language.scene_reader import read_scene
from bt_agents.language.script_reader import read_script
from bt_agents.language.specs import BindingKind, SceneSpec, Script, SourceSpec, Visit
from bt_agents.ros import qos
from bt_agents.ros.installed import InstalledInterfaces
from bt_agents.ros.interfaces import load_type, read_field
from bt_agents.ros.messages import scene_from_msg, scene_to_msg
from bt_agents.ros.node import GuardedNode
from bt_agents.ros.parameters import declare, describe, follow
from bt_agents.ros.runner import run
from bt_agents.ros.startup import TREES, StartParameter, make_from_parameters
from bt_agents.ros.timers import steady_timer
from bt_agents.scene import Scene
from bt_agents.trees_folder import find_trees
from bt_agents_interfaces.msg import MarketStatus, Run
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import Analyze
from scene_layer.estimate import Estimate, check_given
from scene_layer.live import Following, LiveRun
from scene_layer.script import Market, Performance
from scene_layer.sources import Sources

SHORTEST_S = 0.02
"""Shortest time between two live scenes [s]; changes in between are sent together."""

_PERSON = {
    Analyze.Request.AS_MEASURED: None,
    Analyze.Request.PRESENT: True,
    Analyze.Request.ABSENT: False,
}


class SceneLayerNode(GuardedNode):
    """Listens to the sources, or plays a script in their stead, and publishes scenes.

    Args:
        spec: The scene parameters and their sources.
        script: Visits to play instead of listening to the sources.
        ids: Makes the scene ids; random ones by default.
        node_kwargs: For :class:`rclpy.node.Node`.

    Raises:
        Refused: A source names a type or field that is not installed.
    """

    def __init__(
        self,
        spec: SceneSpec,
        script: Script | None = None,
        *,
        ids: Callable[[], str] | None = None,
        **node_kwargs: Any,
    ) -> None:
        super().__init__("scene_layer", **node_kwargs)
        self._spec = spec
        self._ids = ids or (lambda: uuid.uuid4().hex)
        self._sources = Sources(spec)
        self._estimate = Estimate(spec, self._sources)
        self._following = Following()
        self._announced_id = ""
        self._live_at = 0.0
        self._scene = self.create_publisher(SceneMsg, "scene", qos.FACT)
        self._live = self.create_publisher(SceneMsg, "scene/live", qos.SENSOR)
        self._make_timers()
        self.create_subscription(Run, "runs", self._on_run, qos.HISTORY)
        self.create_subscription(MarketStatus, "market", self._on_market, qos.FACT)
        self.create_subscription(Empty, "~/trigger", self._on_trigger, qos.EVENTS)
        self.create_service(Analyze, "~/analyze", self._on_analyze, qos_profile=qos.SERVICE)
        self._performance: Performance | None = None
        if script is None:
            self._listen()
        else:
            self._perform(script)

    def _make_timers(self) -> None:
        rate = follow(
            self,
            "live_rate",
            10.0,
            describe("live scenes a second while an agent runs [Hz]", minimum=1.0, maximum=50.0),
            self._set_rate,
        )
        timer = partial(steady_timer, self, running=False)
        self._live_timer = timer(1.0 / float(rate), self._publish_live)
        self._soon_timer = timer(SHORTEST_S, self._publish_live)
        self._script_timer = timer(SHORTEST_S, self._play)

    def _set_rate(self, hertz: float) -> None:
        self._live_timer.timer_period_ns = round(1e9 / hertz)

    # Sources

    def _listen(self) -> None:
        person = (self._spec.person,) if self._spec.person else ()
        for source in (*self._spec.sources, *person):
            kind = load_type(source.type, BindingKind.TOPIC)
            problem = InstalledInterfaces().field_problem(
                BindingKind.TOPIC, source.type, "message", source.field
            )
            if problem:
                raise Refused("UNKNOWN_FIELD", f"{source.position}: {source.type}: {problem}")
            self.create_subscription(
                kind, source.topic, partial(self._on_reading, source), qos.SENSOR
            )

    def _on_reading(self, source: SourceSpec, message: Any) -> None:
        try:
            raw = read_field(message, source.field)
        except Refused:
            return  # an empty list, for example of faces: nobody was measured
        try:
            changed = self._sources.read(source, raw, time.monotonic())
        except Refused as refused:
            count = self._sources.refusals[source.topic, refused.code]
            if count & (count - 1) == 0:
                self.get_logger().warning(f"{refused} ({count} refused so far)")
            return
        if changed:
            self._on_change()

    # Scenes

    def _on_trigger(self, _message: Empty) -> None:
        self._announce("", {}, None)

    def _on_analyze(self, request: Any, response: Any) -> Any:
        try:
            values = check_given(self._spec.space, request.names, request.values)
            if request.person not in _PERSON:
                raise Refused("UNKNOWN_PERSON", f"person is {request.person}, expected 0, 1 or 2")
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        person = _PERSON[request.person]
        if request.announce:
            scene = self._announce(request.label, values, person, urgent=request.urgent)
            response.message = f"scene {scene.scene_id} announced"
        else:
            scene = self._give(values, person)
            response.message = "live scene updated, nothing announced"
        response.accepted = True
        response.scene = scene_to_msg(scene)
        return response

    def _announce(
        self,
        label: str,
        values: dict[str, float],
        person: bool | None,
        *,
        urgent: bool = False,
    ) -> Scene:
        now = time.monotonic()
        self._announced_id = self._ids()
        self._estimate.begin(self._announced_id, label, values, person, now, urgent=urgent)
        scene = self._put_together(self._announced_id, now)
        self._scene.publish(scene_to_msg(scene))
        return scene

    def _give(self, values: dict[str, float], person: bool | None) -> Scene:
        """Give values to the interaction that runs, else to the one announced last."""
        now = time.monotonic()
        running = self._following.run
        scene_id = running.scene_id if running else self._announced_id
        self._estimate.give(scene_id, values, person, now)
        self._on_change()
        return self._put_together(scene_id, now)

    def _put_together(self, scene_id: str, now: float) -> Scene:
        stamp = self.get_clock().now().nanoseconds * 1e-9
        return self._estimate.scene(scene_id, now=now, stamp=stamp)

    # The live scene

    def _on_run(self, message: Any) -> None:
        if message.event == Run.STARTED:
            self._on_started(message)
        elif message.event == Run.ENDED:
            self._following.ended(message.epoch, message.round)
            self._stop_when_over()

    def _on_started(self, message: Any) -> None:
        now = time.monotonic()
        try:
            scene = scene_from_msg(message.scene, self._spec.space)
        except Refused as refused:
            self.get_logger().warning(f"no live scene for round {message.round}: {refused}")
            return
        following = LiveRun(epoch=message.epoch, round=message.round, scene_id=scene.scene_id)
        if not self._following.started(following):
            return
        self._estimate.adopt(scene, now)
        self._live_timer.reset()
        if self._performance is not None:
            self._performance.started(scene.scene_id, now)
            self._play()

    def _on_change(self) -> None:
        if self._following.run is None:
            return
        if time.monotonic() - self._live_at >= SHORTEST_S:
            self._publish_live()
        elif self._soon_timer.is_canceled():
            self._soon_timer.reset()

    def _publish_live(self) -> None:
        self._soon_timer.cancel()
        if self._following.run is None:
            return
        self._live_at = time.monotonic()
        scene = self._put_together(self._following.run.scene_id, self._live_at)
        self._live.publish(scene_to_msg(scene))

    def _stop_when_over(self) -> None:
        if self._following.run is None:
            self._live_timer.cancel()
            self._soon_timer.cancel()

    def _on_market(self, message: Any) -> None:
        idle = message.state == MarketStatus.IDLE
        self._following.market(message.epoch, message.round, idle)
        self._stop_when_over()
        if self._performance is not None:
            market = Market(
                epoch=message.epoch,
                idle=idle,
                agents=message.agents,
                finished_scene_id=message.finished_scene_id,
            )
            self._performance.market(market, time.monotonic())
            self._play()

    # The script

    def _perform(self, script: Script) -> None:
        wait_for_agents = declare(
            self,
            "wait_for_agents",
            1,
            describe(
                "the script begins when the market has so many agents",
                minimum=0,
                maximum=1_000_000,
                integer=True,
                read_only=True,
            ),
        )
        self._performance = Performance(script, wait_for_agents=int(wait_for_agents))
        self._script_timer.reset()

    def _play(self) -> None:
        """Do what the script wants done now; called at every event and by a timer."""
        performance = self._performance
        if performance is None or performance.done:
            return
        now = time.monotonic()
        if performance.over() and performance.done:
            self._script_timer.cancel()
            self.get_logger().info("the script is played to its end")
            return
        if performance.not_taken(now):
            self.get_logger().warning("the market did not take the scene; sending it again")
        if performance.visit is None and self._market_listens():
            visit = performance.next(now)
            if visit is not None:
                self._begin(performance, visit)
        changes = performance.due(now)
        for change in changes:
            self._give(dict(change.values), change.person)

    def _begin(self, performance: Performance, visit: Visit) -> None:
        scene = self._announce(visit.label, dict(visit.values), visit.person, urgent=visit.urgent)
        performance.announced(scene.scene_id)
        self.get_logger().info(f"visit {performance.number}: {visit.label}")

    def _market_listens(self) -> bool:
        """Whether whoever publishes the market's status is matched as a reader of scenes."""
        markets = {_who(e) for e in self.get_publishers_info_by_topic("market")}
        readers = self.get_subscriptions_info_by_topic("scene")
        return bool(markets & {_who(e) for e in readers}) and (
            self._scene.get_subscription_count() >= len(readers)
        )


def _who(endpoint: Any) -> tuple[str, str]:
    return endpoint.node_namespace, endpoint.node_name


def make_node() -> SceneLayerNode:
    """Create the node as the parameters of its process ask for.

    Raises:
        BtAgentsError: The trees folder, ``scene.yaml`` or the script cannot be used.
    """

    def make(values: Mapping[str, str]) -> SceneLayerNode:
        spec = read_scene(find_trees(values["trees"]) / "scene.yaml")
        path = values["script"]
        return SceneLayerNode(spec, read_script(Path(path), spec.space) if path else None)

    script = StartParameter(
        name="script", description="script to play instead of listening to sensors; empty for none"
    )
    return make_from_parameters("scene_layer", (TREES, script), make)


def main(args: Sequence[str] | None = None) -> int:
    """Run the scene layer until it is told to stop; return the exit code."""
    return run(make_node, args)


if __name__ == "__main__":
    raise SystemExit(main())
