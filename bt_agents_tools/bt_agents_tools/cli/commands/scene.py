# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents scene`: shows the present scene with origin and confidence of its values."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from bt_agents.engine.scope import format_value
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.field_types import FieldType
from bt_agents_core.person_facts import Fact, facts, values_of
from bt_agents_core.scene import Origin, SceneParameter, finite_or_none, nearest_label
from bt_agents_core.text import format_known
from bt_agents_core.trees_folder import find_trees
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros.signals import end_silently
from bt_agents_tools.cli.connection import FIND_LIMIT_S, accepted, connect
from bt_agents_tools.cli.formatting import clock_text, fitted_console

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_COLLECT_S = 0.3
_HEALTH_S = 5.0  # the scene layer publishes the health of its sources once a second
_PERIOD_S = 0.5

_STYLES = {
    Origin.MEASURED: "green",
    Origin.GIVEN: "cyan",
    Origin.TOLD: "cyan",
    Origin.ESTIMATED: "yellow",
    Origin.DEFAULT: "yellow",
    Origin.MISSING: "red",
}

_FIELDS = ("scene_id", "label", "person", "person_id", "place", "persons", "visits")

Labels = dict[str, SceneParameter]


@click.command()
@click.option("--watch", is_flag=True, help="Go on until Ctrl-C.")
@click.option("--json", "as_json", is_flag=True, help="As JSON; each look on a line of its own.")
@click.option("--dir", "directory", default="", help="The trees folder with the words for values.")
def scene(watch: bool, as_json: bool, directory: str) -> None:
    """Show the present scene: each value, where it is from, and how sure it is.

    During a run it is the live scene, else what a trigger would put on the market.
    """
    labels = _labels(Path(directory)) if directory else {}
    observer = connect()
    labels = labels or _labels_of(observer)
    polls = _poll(observer)
    if not watch:
        message, persons = next(polls)
        _print(message, persons, labels, as_json)
        if not as_json:
            _print_missing(observer, message)
        return
    try:
        if as_json or not Console().is_terminal:
            for message, persons in polls:
                _print(message, persons, labels, as_json)
        with Live(auto_refresh=False) as live:
            for message, persons in polls:
                live.update(page(message, persons, labels), refresh=True)
    except KeyboardInterrupt:
        end_silently()


def _print(message: Any, persons: Any, labels: Labels, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(as_document(message, persons)))
    else:
        fitted_console().print(page(message, persons, labels))


def _print_missing(observer: Observer, message: Any) -> None:
    """Print why values are missing, as far as the scene layer knows."""
    if not any(one.origin == Origin.MISSING for one in message.values):
        return
    received = observer.received("/diagnostics")
    name = f"{observer.namespace}/scene_layer: sources".lstrip("/")

    def health() -> list[Any]:
        every = (status for one in received for status in one.status)
        return [status for status in every if status.name == name]

    observer.spin_until(lambda: bool(health()), _HEALTH_S)
    for status in health()[-1:]:
        click.echo(f"sources: {status.message}")


def _labels_of(observer: Observer) -> Labels:
    """Return the labels of the running trees folder; none if it is on another machine."""
    observer.spin_until(lambda: bool(observer.cards), FIND_LIMIT_S)
    for card in observer.cards.values():
        with suppress(BtAgentsError):
            return _labels(Path(card.trees))
    return {}


def _labels(trees: Path) -> Labels:
    """Return the parameters with the labels of their values."""
    space = read_scene(find_trees(str(trees)) / "scene.yaml").space
    return {parameter.name: parameter for parameter in space.parameters}


def _poll(observer: Observer) -> Iterator[tuple[Any, Any]]:
    """Yield the present scene and the persons; None if persons are not tracked."""
    received = observer.received("bt_agents/scene/persons")
    while True:
        message = accepted(observer.ask("scene_layer/analyze"), "the scene layer").scene
        observer.spin_until(lambda: bool(received), _COLLECT_S)
        yield message, received[-1] if received else None
        del received[:-1]
        observer.spin_until(lambda: False, _PERIOD_S)


def page(message: Any, persons: Any, labels: Labels) -> RenderableType:
    """Return the printed form of a scene, and of tracked persons."""
    parts: list[RenderableType] = [Text(_heading(message))]
    if message.values:
        parts.append(_values(message, labels))
    if message.remembered:
        parts.append(Text(f"remembered: {_remembered_text(message)}"))
    if persons is not None:
        parts.append(Text(_persons_text(persons)))
        if persons.scenes:
            parts.append(_persons(persons))
    return Group(*parts)


def _heading(message: Any) -> str:
    who = message.person_id or "somebody"
    there = f"{who} is there" if message.person else "nobody is there"
    if message.person_id and not message.person:
        there = f"{who} is not there any more"
    visit = message.visits and f"visit {message.visits}"
    parts = [message.label, there, visit, message.place and f"in {message.place}"]
    when = clock_text(message.header.stamp.sec)
    return f"{', '.join(part for part in parts if part)} ({when})"


def _remembered(message: Any) -> dict[str, Fact]:
    return facts(values_of(message.remembered))


def _remembered_text(message: Any) -> str:
    remembered = _remembered(message).items()
    return ", ".join(f"{key} {format_value(one, FieldType.ANY)}" for key, one in remembered)


def _values(message: Any, labels: Labels) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("parameter", overflow="fold")
    table.add_column("value", overflow="fold")
    table.add_column("is")
    for heading in ("age", "sure"):
        table.add_column(heading, justify="right", overflow="fold")
    table.add_column("from", overflow="fold")
    for value in message.values:
        origin = Origin(value.origin)
        known = origin is not Origin.MISSING
        age = _age(value.age_s) if origin in (Origin.MEASURED, Origin.ESTIMATED) else ""
        table.add_row(
            Text(value.name),
            Text(_value(value, labels) if known else "–"),
            Text(origin.name.lower(), style=_STYLES[origin]),
            age,
            f"{value.confidence:.0%}" if known else "",
            Text(value.source),
        )
    return table


def _value(value: Any, labels: Labels) -> str:
    text = format_known(value.value)
    if value.std > 0.0:
        text += f" ± {value.std:.2g}"
    parameter = labels.get(value.name)
    if parameter is None or not parameter.labels:
        return text
    return f"{text} ({nearest_label(tuple(parameter.labels.items()), value.value)})"


def _age(seconds: float) -> str:
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.1f} s"


def _persons_text(persons: Any) -> str:
    if not persons.scenes:
        return "persons: none"
    if not persons.addressee:
        return f"persons: {len(persons.scenes)}, nobody is addressed: {persons.reason}"
    return (
        f"persons: {len(persons.scenes)}, addressed is {persons.addressee} "
        f"(rule: {persons.rule}; {persons.reason})"
    )


def _persons(persons: Any) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("person", overflow="fold")
    for value in persons.scenes[0].values:
        table.add_column(Text(value.name), justify="right", overflow="fold")
    for one in persons.scenes:
        mark = "* " if one.person_id == persons.addressee else "  "
        numbers = (
            Text(format_known(value.value), style=_STYLES[Origin(value.origin)])
            for value in one.values
        )
        table.add_row(Text(mark + one.person_id), *numbers)
    return table


def as_document(message: Any, persons: Any) -> dict[str, Any]:
    """Return a scene and the persons as plain data for JSON, with null for missing values."""
    tracked = None
    if persons is not None:
        tracked = {name: getattr(persons, name) for name in ("rule", "addressee", "reason")}
        tracked["scenes"] = [_plain(one) for one in persons.scenes]
    return {"scene": _plain(message), "persons": tracked}


def _plain(message: Any) -> dict[str, Any]:
    stamp = message.header.stamp
    return {
        "stamp": stamp.sec + stamp.nanosec * 1e-9,
        **{name: getattr(message, name) for name in _FIELDS},
        "remembered": _remembered(message),
        "values": {
            value.name: {
                "value": finite_or_none(value.value),
                "origin": Origin(value.origin).name.lower(),
                "std": finite_or_none(value.std),
                "age_s": finite_or_none(value.age_s),
                "confidence": value.confidence,
                "source": value.source,
            }
            for value in message.values
        },
    }
