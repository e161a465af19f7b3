# SPDX-License-Identifier: Apache-2.0
"""Agents and their hosts: cards, files, profiles, feedback steps, tunable values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.expression.quantities import QuantityError, number, quantity, quantity_type
from bt_agents_language.yaml.scalars import boolean
from bt_agents_studio.projection.conversion import (
    finite,
    finite_values,
    parameter_value,
    record_of,
)
from bt_agents_studio.projection.event_log import EventLog
from bt_agents_studio.records import (
    AgentRecord,
    FileRecord,
    HostRecord,
    Json,
    MoodRuleRecord,
    PresetRecord,
    ProfileRecord,
    ProfileStepRecord,
    TunableRecord,
    TuningsRecord,
)
from bt_agents_studio.store import MOST_ENTRIES, Store

_MOST_CONDITIONS = 1000
_LONGEST_CONDITION = 80
"""Maximum length of a condition whose thresholds are computed [characters]."""

_LARGEST_CHANGE = 1000.0
_HALVINGS = 32


class AgentProjection:
    """Messages about agents → ``hosts``, ``agents``, ``files``, ``profiles``, ``feedback``, ….

    Args:
        store: Store of the entries.
        log: Log of events.
    """

    def __init__(self, store: Store, log: EventLog) -> None:
        self._store = store
        self._log = log
        self.handlers = {
            "bt_agents_interfaces/msg/AgentFiles": self._files,
            "bt_agents_interfaces/msg/Feedback": self._feedback,
            "bt_agents_interfaces/msg/HostCard": self._card,
            "bt_agents_interfaces/msg/Profiles": self._profiles,
            "bt_agents_interfaces/msg/Tunables": self._tunables,
            "bt_agents_interfaces/msg/Tunings": self._tunings,
        }

    def _card(self, message: Any, at_s: float) -> None:
        names = tuple(one.name for one in message.agents)
        before = self._store.get("hosts", message.host)
        if isinstance(before, HostRecord):
            for name in set(before.agents) - set(names):
                self._store.remove("agents", name)
            for name in sorted(set(names) - set(before.agents)):
                self._log.line(at_s, "host", agent=name, text=f"{name} is there")
        record = record_of(HostRecord, message, instance=message.host_instance, agents=names)
        self._store.put("hosts", message.host, record)
        for one in message.agents:
            self._store.put("agents", one.name, _agent(one, message.host, message.parameters))

    def _files(self, message: Any, _at_s: float) -> None:
        texts = {
            f"{message.host}|{file}": text
            for file, text in zip(message.files, message.texts, strict=True)
        }
        for key, text in texts.items():
            self._store.put("files", key, FileRecord(text=text))
        for key in self._store.keys("files"):
            if key.startswith(f"{message.host}|") and key not in texts:
                self._store.remove("files", key)

    def _profiles(self, message: Any, _at_s: float) -> None:
        width = len(message.parameters)
        records = {}
        for index, agent in enumerate(message.agents[:MOST_ENTRIES]):
            layer = message.layers[index]
            vector = message.vectors[index * width : (index + 1) * width]
            records[f"{agent}|{layer}"] = ProfileRecord(
                agent=agent,
                layer=layer,
                revision=int(message.revisions[index]),
                values=finite_values(message.parameters, vector),
            )
        for key, record in records.items():
            self._store.put("profiles", key, record)
        for key in set(self._store.keys("profiles")) - records.keys():
            self._store.remove("profiles", key)

    def _feedback(self, message: Any, at_s: float) -> None:
        record = record_of(ProfileStepRecord, message)
        key = f"{message.agent}|{message.layer}|{message.revision}"
        self._store.put("feedback", key, record)
        text = f"{record.kind.lower()} by {record.source}"
        text += f": {record.reason}" if record.reason else ""
        self._log.line(at_s, "feedback", agent=message.agent, path=message.leaf, text=text)
        moment = (record.at_s, record.at_s)
        self._log.event(
            f"feedback {key}", "FEEDBACK", record.kind, moment, agent=record.agent, text=text
        )

    def _tunables(self, message: Any, _at_s: float) -> None:
        held = set()
        for one in message.tunables[:MOST_ENTRIES]:
            key = f"{message.host}|{one.name}"
            held.add(key)
            default = parameter_value(one.default_value)
            before = self._store.get("tunables", key)
            record = record_of(
                TunableRecord,
                one,
                host=message.host,
                default=default,
                value=before.value if isinstance(before, TunableRecord) else default,
                minimum=finite(one.minimum) if one.has_range else None,
                maximum=finite(one.maximum) if one.has_range else None,
                step=one.step if one.has_range else 0.0,
            )
            self._store.put("tunables", key, record)
        for key in self._store.keys("tunables"):
            if key.startswith(f"{message.host}|") and key not in held:
                self._store.remove("tunables", key)

    def value(self, host: str, name: str, value: Json) -> None:
        """Take the current value of a parameter of a host; ignore it if it is not a tunable."""
        key = f"{host}|{name}"
        record = self._store.get("tunables", key)
        if isinstance(record, TunableRecord):
            self._store.put("tunables", key, replace(record, value=value))

    def _tunings(self, message: Any, at_s: float) -> None:
        before = self._store.get("tunings", message.host)
        newest = before.revision if isinstance(before, TuningsRecord) else message.revision
        record = record_of(TuningsRecord, message, presets=tuple(map(_preset, message.presets)))
        self._store.put("tunings", message.host, record)
        for one in record.tunings:
            if one.revision > newest:
                text = f"{one.name}: {one.before} → {one.after} by {one.author}"
                self._log.line(at_s, "tuning", text=text)


def _agent(card: Any, host: str, parameters: Sequence[str]) -> AgentRecord:
    return record_of(
        AgentRecord,
        card,
        host=host,
        profile=finite_values(parameters, card.profile),
        current=finite_values(parameters, card.current),
        rules=tuple(
            record_of(
                MoodRuleRecord,
                one,
                changes=() if one.baseline_s else thresholds(one.when),
                cancels=one.action == 1,
            )
            for one in card.rules
        ),
    )


def _preset(message: Any) -> PresetRecord:
    values = dict(zip(message.names, message.values, strict=True))
    settings = {name: _setting(text) for name, text in values.items()}
    return PresetRecord(name=message.name, values=values, settings=settings)


def _setting(text: str) -> Json:
    """Return a value written by an author; its unit determines its meaning."""
    truth = boolean(text)
    if truth is not None:
        return truth
    try:
        kind = quantity_type(text)
        return number(text) if kind is None else quantity(text, kind)
    except QuantityError:
        return text


@lru_cache(maxsize=_MOST_CONDITIONS)
def thresholds(when: str) -> tuple[float, ...]:
    """Return the smallest changes, downwards and upwards, that make a condition true.

    The result is empty if the condition depends on anything but the change.
    """
    if len(when) > _LONGEST_CONDITION:
        return ()
    try:
        condition = parse_expression(when)
    except ExpressionError:
        return ()
    if condition.names != {"mood.change"}:
        return ()

    def holds(change: float) -> bool:
        try:
            return condition.is_true(lambda _: change)
        except Undecided:
            return False

    if holds(0.0):
        return ()
    return tuple(
        _threshold(holds, far) for far in (-_LARGEST_CHANGE, _LARGEST_CHANGE) if holds(far)
    )


def _threshold(holds: Callable[[float], bool], far: float) -> float:
    """Return where a condition that is false at 0 and true far from it becomes true."""
    near = 0.0
    for _ in range(_HALVINGS):
        middle = (near + far) / 2
        near, far = (near, middle) if holds(middle) else (middle, far)
    return round(far, 5)
