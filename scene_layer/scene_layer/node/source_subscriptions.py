# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of the sources: some permanent, some only while a person is tracked."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.field_path import NoSuchItem, value_at
from bt_agents_core.field_types import BindingKind
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import other_types
from bt_agents_language.model.scene_specs import MESSAGE, SceneSpec, SourceSpec, TrackedSpec
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.topic_subscription import LatchedSubscription, TopicSubscription
from bt_agents_ros.types import load_type, message_field, read_field
from scene_layer.persons import Persons, check_id
from scene_layer.sources import Sources

_LONGEST = 300
_SHOWN = 100
_MOST_UNNAMED = 1000


@dataclass(frozen=True)
class _Key:
    """Key of a subscription, which several sources of one person may share."""

    topic: str
    type: str
    latched: bool
    person: str = ""


class SourceSubscriptions:
    """Subscriptions of all sources; turns their messages into readings.

    Raises:
        Refused: A source names a type or field that is not installed, or a topic that cannot be
            subscribed to.
    """

    def __init__(
        self,
        node: Node,
        spec: SceneSpec,
        sources: Sources,
        persons: Persons,
        changed: Callable[[], None],
    ) -> None:
        self._node = node
        self._spec = spec
        self._sources = sources
        self._persons = persons
        self._changed = changed
        self._fixed: dict[_Key, tuple[TopicSubscription, set[SourceSpec]]] = {}
        self._dynamic: dict[_Key, tuple[TopicSubscription, set[SourceSpec]]] = {}
        self._other_types: dict[str, str] = {}
        self._unnamed: dict[str, None] = {}
        self._of_item = [source for source in spec.every_source if source.of_item]
        for source in spec.every_source:
            self._check(source.type, source.position, self._paths(source))
        fixed: dict[_Key, set[SourceSpec]] = {}
        for source in spec.every_source:
            if not source.per_person:
                key = _Key(source.topic, source.type, source.latched)
                fixed.setdefault(key, set()).add(source)
        for key, read in fixed.items():
            self._fixed[key] = self._subscribe(key, read), read
        if spec.persons is not None:
            self._track(spec.persons.tracked)

    def subscribe_to_tracked(self) -> None:
        """Subscribe to the topics of exactly the persons tracked now."""
        topics = self._sources.topics(self._persons.tracked, time.monotonic())
        found: dict[_Key, set[SourceSpec]] = {}
        for (source, person), topic in topics.items():
            key = _Key(topic, source.type, source.latched, person)
            found.setdefault(key, set()).add(source)
        for key, (subscription, read) in list(self._dynamic.items()):
            if found.get(key) != read:
                subscription.close()
                del self._dynamic[key]
        for key, new in found.items():
            if key not in self._dynamic and key.topic not in self._unnamed:
                self._subscribe_to(key, new)

    def _subscribe_to(self, key: _Key, read: set[SourceSpec]) -> None:
        try:
            subscription = self._subscribe(key, read)
        except Refused as refused:
            # The name contains an id; without this entry each look would try it again.
            self._unnamed[key.topic] = None
            if len(self._unnamed) > _MOST_UNNAMED:
                del self._unnamed[next(iter(self._unnamed))]
            self._node.get_logger().warning(
                f"nothing is heard of {key.person[:_SHOWN]!r}: {refused.reason}"
            )
        else:
            self._dynamic[key] = subscription, read

    def look(self, now: float) -> Mapping[str, str]:
        """Look on the graph for the publishers of topics without a reading that holds.

        Args:
            now: Steady time [s].

        Returns:
            Topic that is published as another type → that type, and the expected one.
        """
        found = {}
        for key, (subscription, read) in (*self._fixed.items(), *self._dynamic.items()):
            if any(self._sources.reading(one, now, key.person) for one in read):
                continue
            if types := other_types(key.type, subscription.look()):
                found[key.topic] = types
        for topic in found.keys() - self._other_types.keys():
            self._node.get_logger().warning(
                f"nothing is heard on {topic}: it is published as {found[topic]}"
            )
        self._other_types = found
        return found

    def _subscribe(self, key: _Key, read: Iterable[SourceSpec]) -> TopicSubscription:
        ordered = sorted(read, key=lambda source: str(source.position))
        take = partial(self._on_reading, tuple(ordered), key.person)
        return self._create_subscription(key, take)

    def _create_subscription(self, key: _Key, take: Callable[[Any], None]) -> TopicSubscription:
        topic, type_name = key.topic, key.type
        kind = load_type(type_name, BindingKind.TOPIC)
        subscription = LatchedSubscription if key.latched else TopicSubscription
        try:
            return subscription(self._node, kind, topic, take)
        except InvalidTopicNameException as error:
            raise Refused(
                RefusalCode.UNUSABLE_TOPIC,
                f"no topic can be called {topic[:_SHOWN]}: {str(error)[:_SHOWN]}",
            ) from None
        except RCLError:
            # The message of rclpy is about memory, but the cause is the other type.
            raise Refused(
                RefusalCode.UNUSABLE_TOPIC,
                f"the topic {topic[:_SHOWN]} cannot be heard with the type {type_name}, expected "
                "the same type everywhere in scene.yaml",
            ) from None

    def _paths(self, source: SourceSpec) -> list[str]:
        read = [e for e in (source.field, source.confidence, source.std) if e is not None]
        paths = sorted({name.removeprefix(f"{MESSAGE}.") for one in read for name in one.names})
        if source.of_item and self._spec.persons is not None:
            return [f"{self._spec.persons.tracked.field}.0.{path}" for path in paths]
        return paths

    def _check(self, type_name: str, position: object, paths: Iterable[str]) -> None:
        load_type(type_name, BindingKind.TOPIC)
        installed = InstalledInterfaces()
        for path in paths:
            if problem := installed.field_problem(BindingKind.TOPIC, type_name, "message", path):
                raise Refused(RefusalCode.UNKNOWN_FIELD, f"{position}: {type_name}: {problem}")

    # Readings

    def _on_reading(self, read: tuple[SourceSpec, ...], person: str, message: Any) -> None:
        changed = [self._read(one, partial(read_field, message), person) for one in read]
        if any(changed):
            self._changed()

    def _read(self, source: SourceSpec, message: Callable[[str], object], person: str) -> bool:
        try:
            return self._sources.read(source, message, time.monotonic(), person)
        except Refused as refused:
            self._complain(refused, self._sources.refusals[source.topic, refused.code])
            return False

    def _complain(self, refused: Refused, count: int) -> None:
        if count.bit_count() == 1:
            text = str(refused)
            text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
            self._node.get_logger().warning(f"{text} ({count} refused so far)")

    # Who is tracked

    def _track(self, tracked: TrackedSpec) -> None:
        item = [f"{tracked.field}.0.{tracked.id}"] if tracked.id else []
        self._check(tracked.type, tracked.position, [tracked.field, *item])
        take = partial(self._on_items if tracked.id else self._on_ids, tracked)
        key = _Key(tracked.topic, tracked.type, tracked.latched)
        self._fixed[key] = self._create_subscription(key, take), set()

    def _on_ids(self, tracked: TrackedSpec, message: Any) -> None:
        self._receive_ids(_raw(message, tracked.field, ()))

    def _on_items(self, tracked: TrackedSpec, message: Any) -> None:
        """Handle a list with one item per person; only items of tracked persons are read."""
        items: dict[str, Any] = {}
        ids = []
        for item in _raw(message, tracked.field, ()):
            person = _raw(item, tracked.id, "")
            ids.append(person)
            # Bad ids are refused and counted like in a list of ids.
            with suppress(Refused):
                items.setdefault(check_id(person), item)
        self._receive_ids(ids)
        for person in self._persons.candidates:
            if person in items:
                for source in self._of_item:
                    self._read(source, partial(read_field, items[person]), person)
        self._changed()

    def _receive_ids(self, ids: Iterable[object]) -> None:
        refused = self._persons.receive_ids(ids, time.monotonic())
        if refused is not None:
            self._complain(refused, self._persons.refusals[refused.code])


def _raw(message: Any, path: str, nothing: Any) -> Any:
    """Return a field unconverted, or ``nothing`` for an item beyond the end of a list.

    :func:`read_field` would convert a whole long list to plain data.
    """
    try:
        return value_at(message, path, message_field)
    except NoSuchItem:
        return nothing
