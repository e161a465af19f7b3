# SPDX-License-Identifier: Apache-2.0
"""Simulated visitors, who publish sensor readings, answer the robot and press buttons."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Bool, Empty, String

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import folded
from bt_agents_core.trees_folder import find_trees
from bt_agents_interfaces.msg import MarketStatus, Run
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import Analyze
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.model.scene_specs import (
    PERSON,
    SceneSpec,
    SourceSpec,
    TrackedSpec,
    path_of,
)
from bt_agents_language.model.specs import SceneChange, Script, Visit
from bt_agents_robot.change_effects import (
    ButtonPresses,
    ChangeEffects,
    unmade_text,
    unmeasured_text,
)
from bt_agents_robot.people import (
    REACTION_S,
    check_visitors,
    field_value,
    is_measured,
    is_read,
    nested,
    part_id,
    pause_after,
    readings,
    sample_reading,
)
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.calls import Calls
from bt_agents_ros.discovery import node_of
from bt_agents_ros.messages import seconds
from bt_agents_ros.parameters import TREES, StartParameter, declare, describe, make_from_parameters
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.types import fill, load_type, read_field
from scene_layer.script import MarketView, ScriptPerformance, answer

SENSOR_PERIOD_S = 0.2
"""Time between two readings of one sensor [s]."""

MEASURED_S = 2.0
"""Longest wait until the scene layer measures a visitor; then the scene is requested anyway [s].

A publisher can discover a subscription before that receives its messages.
"""

LATEST_S = 10.0
"""Longest believed delay of the message that a run has started [s]."""

WARNING_PERIOD_S = 5.0
"""Time between two warnings about missing subscribers [s]."""

_TICK_S = 0.02


class _Sensor:
    """Sensor topic, with all sources that read it."""

    def __init__(
        self, node: Node, scene: SceneSpec, topic: str, kind: str, sources: Sequence[SourceSpec]
    ) -> None:
        self.sources = sources
        self._scene = scene
        self._type = load_type(kind, BindingKind.TOPIC)
        self._examples = {source: self._example(source) for source in sources}
        # A reliable publisher matches both kinds of subscription.
        profile = qos.FACT if any(source.latched for source in sources) else qos.EVENTS
        self.publisher: Publisher = node.create_publisher(self._type, topic, profile)

    def publish(self, values: dict[SourceSpec, float | str]) -> None:
        """Publish one message with the readings of all sources, unless there are none."""
        if self.has_reading(values):
            self._send(nested(self._fields(values).items()))

    def has_reading(self, values: dict[SourceSpec, float | str]) -> bool:
        return any(is_read(values[source]) for source in self.sources)

    def _send(self, plain: Mapping[str, Any]) -> None:
        message = self._type()
        fill(message, plain)
        self.publisher.publish(message)

    def _fields(self, values: dict[SourceSpec, float | str]) -> dict[str, Any]:
        """Return the readings by field path."""
        fields: dict[str, Any] = {}
        for source in self.sources:
            reading = values[source]
            fields[source.path or ""] = field_value(self._examples[source], reading)
            sure = path_of(source.confidence) if source.confidence is not None else None
            if sure is not None:
                fields[sure] = max(fields.get(sure, 0.0), float(is_read(reading)))
        return fields

    def _example(self, source: SourceSpec) -> Any:
        try:
            if source.path is None:
                raise TypeError("expected a field")
            example = self._read_default(source.path)
            field_value(example, sample_reading(self._scene, source))
        except (Refused, TypeError) as error:
            raise Refused(
                RefusalCode.UNKNOWN_FIELD,
                f"{source.position}: visitors cannot write {source.field.text} of {source.type}: "
                f"{error}",
            ) from None
        return example

    def _read_default(self, path: str) -> Any:
        return read_field(self._type(), path)


class _Tracker(_Sensor):
    """Topic with tracked persons, with all sources that read its items."""

    def __init__(
        self, node: Node, scene: SceneSpec, spec: TrackedSpec, sources: Sequence[SourceSpec]
    ) -> None:
        self._spec = spec
        super().__init__(node, scene, spec.topic, spec.type, sources)
        self.numbers_persons = isinstance(self._read_default(spec.id), int)

    def publish_person(self, person: str, values: dict[SourceSpec, float | str]) -> None:
        """Publish the list with one person; an empty id means an empty list."""
        if not person:
            self._send(nested([(self._spec.field, [])]))
            return
        item: Any = int(person) if self.numbers_persons else person
        if self._spec.id:
            item = nested({**self._fields(values), self._spec.id: item}.items())
        self._send(nested([(self._spec.field, [item])]))

    def _read_default(self, path: str) -> Any:
        """Return a field of an item in a new message; an empty path is the item itself."""
        message = self._type()
        items = f"{self._spec.field}.0"
        if path:
            fill(message, nested([(self._spec.field, [{}])]))
            return read_field(message, f"{items}.{path}")
        for item in ("", 0):
            with suppress(Refused):
                fill(message, nested([(self._spec.field, [item])]))
                return item
        raise Refused(
            RefusalCode.UNKNOWN_FIELD,
            f"{self._spec.position}: visitors cannot write '{self._spec.field}' of "
            f"{self._spec.type}, expected a list of texts or numbers",
        )


class VisitorsNode(BaseNode):
    """Player of a script with people who come, are sensed, react and leave.

    Raises:
        Refused: A source has a type or field that cannot be written, or as in
            :func:`check_visitors`.
    """

    def __init__(self, spec: SceneSpec, script: Script, **node_kwargs: Any) -> None:
        check_visitors(spec, script)
        super().__init__("visitors", **node_kwargs)
        self._spec = spec
        self._script = script
        pace = describe(
            "speed of the visits relative to real time",
            minimum=0.1,
            maximum=1000.0,
            read_only=True,
        )
        agents = describe(
            "number of agents that the market must have before visitors come",
            minimum=0,
            maximum=1_000_000,
            integer=True,
            read_only=True,
        )
        self._pace = float(declare(self, "pace", 1.0, pace))
        wait_for_agents = int(declare(self, "wait_for_agents", 1, agents))
        self._performance = ScriptPerformance(
            script, wait_for_agents=wait_for_agents, pace=self._pace
        )
        self._values: dict[str, float] = {}
        self._person = False
        self._name = self._id = ""
        self._seen: set[str] = set()
        self._trigger_at = math.inf
        self._next_at = 0.0
        self._warn_at = math.inf
        self._awaiting_scene = False
        self._sensing_pending = False
        self._is_asking = False
        self._said: list[tuple[float, String]] = []
        self._presses = ButtonPresses()
        self._effects = ChangeEffects()
        self._host = ""
        self._label = ""
        self._publish_and_subscribe()
        steady_timer(self, SENSOR_PERIOD_S, self._sense)
        self._timer = steady_timer(self, _TICK_S, self._tick)

    def _publish_and_subscribe(self) -> None:
        person = (self._spec.person,) if self._spec.person else ()
        persons = self._spec.persons
        sources = (*self._spec.sources, *person, *(persons.sources if persons else ()))
        self._sensors = self._make_sensors(
            {one: one.topic for one in sources if not one.per_person}
        )
        self._personal: list[_Sensor] = []
        self._personal_sources = [one for one in sources if one.placeholders]
        self._tracker: _Tracker | None = None
        if persons is not None:
            items = [one for one in sources if one.of_item]
            self._tracker = _Tracker(self, self._spec, persons.tracked, items)
            if self._tracker.numbers_persons and any(one.name for one in self._script.visits):
                raise Refused(
                    RefusalCode.NAMED_VISITOR,
                    f"{persons.tracked.position}: persons have numbers there, expected texts, as "
                    "a visitor of the script has a name",
                )
        buttons = {topic for visit in self._script.visits for topic in visit.buttons}
        self._buttons = {t: self.create_publisher(Bool, t, qos.EVENTS) for t in sorted(buttons)}
        self._trigger = self.create_publisher(Empty, "scene_layer/trigger", qos.EVENTS)
        self._analyze = self.create_client(Analyze, "scene_layer/analyze", qos_profile=qos.SERVICE)
        self._calls = Calls(self)
        self._answers = self.create_publisher(String, "answers", qos.EVENTS)
        self._current = self.create_publisher(String, "visitors/current", qos.FACT)
        self._remarks = self.create_publisher(String, "visitors/remarks", qos.FACTS)
        self._done = self.create_publisher(Bool, "visitors/done", qos.FACT)
        self.create_subscription(MarketStatus, "bt_agents/market", self._on_market, qos.FACT)
        self.create_subscription(SceneMsg, "bt_agents/scene", self._on_scene, qos.EVENTS)
        self.create_subscription(SceneMsg, "bt_agents/scene/live", self._on_live, qos.SENSOR)
        self.create_subscription(Run, "bt_agents/runs", self._on_run, qos.EVENTS)
        self.create_subscription(String, "robot/questions", self._on_question, qos.EVENTS)
        self.create_subscription(String, "robot/transcript", self._on_act, qos.EVENTS)

    def _make_sensors(self, topics: Mapping[SourceSpec, str]) -> list[_Sensor]:
        sources: dict[str, list[SourceSpec]] = {}
        for source, topic in topics.items():
            sources.setdefault(topic, []).append(source)
        return [
            _Sensor(self, self._spec, topic, each[0].type, each) for topic, each in sources.items()
        ]

    # Subscriptions

    def _on_market(self, message: Any) -> None:
        self._performance.market(MarketView.of(message), time.monotonic())

    def _on_scene(self, message: Any) -> None:
        if self._awaiting_scene:
            self._awaiting_scene = False
            self._performance.announced(message.scene_id)

    def _on_run(self, message: Any) -> None:
        if message.event == Run.STARTED:
            self._host = message.host
            # On a busy machine the message may be late.
            age_s = seconds(self.get_clock().now().to_msg()) - seconds(message.header.stamp)
            late_s = age_s if 0.0 < age_s < LATEST_S else 0.0
            self._performance.started(message.scene.scene_id, time.monotonic() - late_s)

    def _on_live(self, message: Any) -> None:
        known = {one.name: one.value for one in message.values if one.origin != one.MISSING}
        self._effects.live(known, message.person)

    def _on_question(self, message: Any) -> None:
        visit = self._performance.visit
        text = answer(visit, message.data) if visit is not None else ""
        if text:
            self._said.append((self._reaction_at(), String(data=text)))

    def _on_act(self, message: Any) -> None:
        visit = self._performance.visit
        for topic, text in (visit.buttons if visit is not None else {}).items():
            if folded(text) in folded(message.data):
                self._presses.plan(topic, self._reaction_at())

    def _reaction_at(self) -> float:
        return time.monotonic() + REACTION_S / self._pace

    # Visits

    def _sense(self) -> None:
        values = self._readings()
        if self._tracker is not None:
            self._tracker.publish_person(self._id if self._person else "", values)
        for sensor in self._sensors_in_use:
            sensor.publish(values)

    @property
    def _sensors_in_use(self) -> list[_Sensor]:
        """Sensors of everybody, and of the visitor while it is a person."""
        return self._sensors + (self._personal if self._person else [])

    def _readings(self) -> dict[SourceSpec, float | str]:
        return readings(self._spec, self._values, self._person, self._name)

    def _tick(self) -> None:
        now = time.monotonic()
        if self._performance.over():
            for change in self._performance.unmade:
                started = self._performance.has_started
                self._remark(unmade_text(change, self._label, started=started))
            self._leave(now)
        elif self._performance.not_taken(now):
            self.get_logger().warning("nobody took the scene of the visit; it is begun again")
            self._leave(now)
        for remark in self._effects.missing(now):
            self._remark(remark)
        if self._performance.done and not self._effects.pending:
            self._timer.cancel()
            self._done.publish(Bool(data=True))
            self.get_logger().info("all visits are over")
            return
        if now >= self._next_at:
            visit = self._performance.next(now)
            if visit is not None:
                self._arrive(visit, now)
        self._trigger_when_sensed(now)
        self._react(now)

    def _arrive(self, visit: Visit, now: float) -> None:
        self.get_logger().info(f"visit {self._performance.number}: {visit.label}")
        self._label = visit.label
        self._current.publish(String(data=visit.label))
        self._values, self._person = dict(visit.values), visit.person
        self._meet(visit.name)
        self._seen = set(visit.values)
        tracker = [self._tracker] if self._tracker is not None else []
        sensors = (*self._sensors, *self._personal, *tracker)
        measured = {source.parameter for sensor in sensors for source in sensor.sources}
        if unmeasured := unmeasured_text(visit, measured, self._id):
            self._remark(unmeasured)
        self._warn_at = now + WARNING_PERIOD_S
        self._sensing_pending = True

    def _meet(self, name: str) -> None:
        """Give a visitor a tracked id, and create the topics about that person."""
        if self._tracker is None:
            return
        number = self._performance.number
        unnamed = str(number) if self._tracker.numbers_persons else f"visitor{number}"
        self._name, self._id = name, name or unnamed
        parts = self._spec.persons.parts if self._spec.persons else ()
        ids = {PERSON: self._id, **{part.parameter: part_id(part) for part in parts}}
        topics = {one: one.topic_of(ids) for one in self._personal_sources}
        self._personal = self._make_sensors({one: topic for one, topic in topics.items() if topic})

    def _part(self) -> None:
        """Remove the topics about the last visitor."""
        for sensor in self._personal:
            self.destroy_publisher(sensor.publisher)
        self._personal = []
        self._name = self._id = ""

    def _trigger_when_sensed(self, now: float) -> None:
        """Request the scene once every used sensor has a subscriber and was measured."""
        if self._sensing_pending:
            values = self._readings()
            used = [one.publisher for one in self._sensors_in_use if one.has_reading(values)]
            used += [self._tracker.publisher] if self._tracker is not None else []
            in_use = (self._trigger, *used)
            silent = [one.topic_name for one in in_use if one.get_subscription_count() == 0]
            if silent and now >= self._warn_at:
                self._warn_at = now + WARNING_PERIOD_S
                self.get_logger().warning(
                    f"nobody listens to {', '.join(silent)}; "
                    "does the scene layer run, without a script of its own?"
                )
            if silent:
                return
            self._sensing_pending = False
            self._sense()
            self._trigger_at = now + MEASURED_S
        elif now < self._trigger_at < math.inf:
            self._ask_what_is_measured()
        elif now >= self._trigger_at:
            self._trigger_at = math.inf
            self._awaiting_scene = True
            visit = self._performance.visit
            if visit is not None and visit.urgent:
                self._request_urgently()
            else:
                self._trigger.publish(Empty())

    def _ask_what_is_measured(self) -> None:
        """Request the scene at once if the scene layer already measures the visitor."""
        if self._is_asking:
            return
        self._is_asking = True
        number = self._performance.number

        def take(response: Any) -> None:
            self._is_asking = False
            waits = self._performance.number == number and self._trigger_at < math.inf
            scene = response.scene
            measured = {one.name: one.value for one in scene.values if one.origin == one.MEASURED}
            here = scene.person, measured
            if waits and is_measured(self._spec, self._values, self._person, *here):
                self._trigger_at = time.monotonic()

        def give_up(_reason: str) -> None:
            self._is_asking = False

        self._calls.call(
            self._analyze,
            Analyze.Request(),
            deadline_s=MEASURED_S,
            on_answer=take,
            on_failure=give_up,
        )

    def _request_urgently(self) -> None:
        """Request the scene by a service, because a trigger cannot carry the urgency."""
        self._calls.call(
            self._analyze,
            Analyze.Request(urgent=True, announce=True),
            deadline_s=WARNING_PERIOD_S,
            on_answer=lambda _: None,
            on_failure=lambda reason: self.get_logger().warning(
                f"the scene is not there: {reason}"
            ),
        )

    def _react(self, now: float) -> None:
        for change in self._performance.due(now):
            self._change(change)
        for said in list(self._said):
            at, message = said
            if now >= at:
                self._said.remove(said)
                self._answers.publish(message)
        for topic in self._presses.due(now, self._is_heard):
            self._buttons[topic].publish(Bool(data=True))

    def _is_heard(self, topic: str) -> bool:
        """Return whether the host of the run listens to a button and is connected.

        Other listeners, such as a journal or a terminal, do not count.
        """
        button = self._buttons[topic]
        nodes = self.get_subscriptions_info_by_topic(button.topic_name)
        return self._host in map(node_of, nodes) and button.get_subscription_count() > 0

    def _change(self, change: SceneChange) -> None:
        self._values.update(change.values)
        self._seen.update(change.values)
        if change.person is not None:
            self._person = change.person
        self._effects.made(change, self._label, time.monotonic())
        self._sense()

    def _remark(self, text: str) -> None:
        self.get_logger().warning(text)
        self._remarks.publish(String(data=text))

    def _leave(self, now: float) -> None:
        visits = self._script.visits
        index = self._performance.number - 1
        coming = visits[index] if index < len(visits) else None
        self._next_at = now + pause_after(self._spec, self._seen, coming, self._pace)
        self._values, self._person, self._said = {}, False, []
        for topic in self._presses.give_up(now):
            self.get_logger().warning(
                f"{self._label}: '{topic}' was not pressed, as no tree listened to it after the "
                "robot had named it; a tree listens while its wait_for runs"
            )
        self._sensing_pending = self._awaiting_scene = False
        self._trigger_at = math.inf
        self._part()
        self._current.publish(String(data=""))
        self._sense()


def make_node() -> VisitorsNode:
    """Create the node according to the parameters of its process.

    Raises:
        BtAgentsError: The trees folder, ``scene.yaml`` or the script is unusable.
    """

    def make(values: Mapping[str, str]) -> VisitorsNode:
        spec = read_scene(find_trees(values["trees"]) / "scene.yaml")
        if not values["script"]:
            raise Refused(RefusalCode.EMPTY, "parameter script is empty; name a file of visits")
        return VisitorsNode(spec, read_script(Path(values["script"]), spec.space))

    script = StartParameter(name="script", description="script with the visits")
    return make_from_parameters("visitors", (TREES, script), make)


def main(args: Sequence[str] | None = None) -> int:
    """Run the visitors until a signal ends them; return the exit code."""
    return run(make_node, args)


if __name__ == "__main__":
    raise SystemExit(main())
