# SPDX-License-Identifier: Apache-2.0
"""Transcript of a rehearsal: its events as lines that read like a script."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping

from py_trees.common import Status

from bt_agents.engine.run import StatusChange, TreeOutcome
from bt_agents.engine.scope import format_value
from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_core.text import printable_lines
from bt_agents_language.diagnostics.renderers import columns
from bt_agents_language.model.specs import NodeSpec, Tunable
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.node_type import Waits
from bt_agents_tools.rehearsal.events import Event, EventKind, Rehearsed

WIDTH = 80

MOST_EVENTS = 400
"""Events of a run that a transcript shows, half of them from its end."""

_TIME_WIDTH = 9
_NOT_IN_PATH = re.compile(r"[^\w-]+")
_PATH = re.compile(r"\(((?:tree|on_cancel)[/@]\S*), ")
_LOOKS = {
    EventKind.BEGINS: ("▶", ""),
    EventKind.SUCCEEDS: ("✔", "green"),
    EventKind.FAILS: ("✘", "red"),
    EventKind.STOPS: ("■", "yellow"),
    EventKind.SENDS: ("▶", ""),
    EventKind.LOGS: ("≡", "dim"),
    EventKind.WAITS: ("…", "dim"),
    EventKind.GIVES_UP: ("✘", "red"),
    EventKind.NOT_TAKEN: ("↷", "dim"),
    EventKind.SCENE: ("◆", "cyan"),
    EventKind.TUNES: ("◆", "cyan"),
    EventKind.ARRIVES: ("◆", "cyan"),
    EventKind.LOST: ("◇", "yellow"),
    EventKind.FEEDBACK: ("★", "magenta"),
    EventKind.CANCELS: ("■", "yellow"),
    EventKind.TICK: (" ", "dim"),
    EventKind.ENDS: ("●", ""),
}
"""Symbol and rich style of each kind of event."""

_OUTCOMES = {
    TreeOutcome.SUCCEEDED: "bold green",
    TreeOutcome.FAILED: "bold red",
    TreeOutcome.CANCELLED: "bold yellow",
    None: "bold red",
}
_UNITS = {FieldType.DURATION: " s", FieldType.LENGTH: " m", FieldType.ANGLE: " rad"}
_STATUS = {Status.INVALID: "■", Status.RUNNING: "▷", Status.SUCCESS: "✔", Status.FAILURE: "✘"}


def transcript(events: Iterable[Event]) -> str:
    """Return events as text without colour; of a very long run, its beginning and its end."""
    told = ["\n".join(found) for event in events if (found := lines(event, ticks=False))]
    left_out = len(told) - MOST_EVENTS
    if left_out > 0:
        half = MOST_EVENTS // 2
        told[half:-half] = [f"{'':>{_TIME_WIDTH}}  … {left_out:,} events left out"]
    return "\n".join(told)


def style_of(event: Event) -> str:
    """Return the rich style for the lines of an event."""
    return _OUTCOMES[event.outcome] if event.kind is EventKind.ENDS else _LOOKS[event.kind][1]


def lines(event: Event, ticks: bool, width: int = WIDTH) -> list[str]:
    """Return the lines of an event; none if it adds nothing.

    With ``ticks``, every change of every node adds a line, too.
    """
    text = _text(event, ticks)
    if text is None:
        return []
    head = f"{time_text(event.at_s):>{_TIME_WIDTH}}  {_LOOKS[event.kind][0]} "
    aside = _aside(event)
    room = max(20, width - len(head) - (len(aside) + 2 if aside else 0))
    folded = _folded(printable_lines(text), room)
    shown = [f"{head}{folded[0]}", *(f"{'':{len(head)}}{one}" for one in folded[1:])]
    if aside:
        shown[0] += " " * max(2, width - columns(shown[0]) - len(aside)) + aside
    return shown


def _folded(text: str, room: int) -> list[str]:
    """Return a text in lines; a place in a file is never cut, so that it can be copied.

    A node path that is longer than a line is left out, because the place in the file follows it.
    """
    text = _PATH.sub(lambda found: "(" if len(found[1]) + 2 > room else found[0], text)
    cut = not any("/" in word for word in text.split() if len(word) > room)
    return textwrap.wrap(text, room, break_long_words=cut, break_on_hyphens=False) or [""]


def time_text(seconds: float) -> str:
    """Return a time for the left column: ``3.2 s``, ``1:03.2``, ``1:01:03``."""
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds, 1), 60)
    if minutes < 60:
        return f"{minutes:.0f}:{rest:04.1f}"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"


def phrase(node: NodeSpec, inputs: Mapping[str, Plain]) -> str:
    """Return a use of a skill as text: ``say "Hello."``, ``drive gate 12``."""
    skill = node.skill
    if skill is None or skill.main is None or skill.main not in inputs:
        given = ", ".join(f"{name} {value_text(value)}" for name, value in inputs.items())
        named = node.name if skill is not None and not skill.inputs else node.kind
        return f"{named} {given}".rstrip()
    main = value_text(inputs[skill.main])
    quoted = skill.main == "text" and main != ""
    others = (
        f"{one.name} {value_text(inputs[one.name])}{_UNITS.get(one.type, '')}"
        for one in skill.inputs
        if one.name in inputs
        and one.name != skill.main
        and inputs[one.name] != one.default
        # The manner of speaking is left out, but not a picture that is shown with a text.
        and (not quoted or one.type is FieldType.TEXT)
    )
    given = ", ".join(filter(None, (f'"{main}"' if quoted else main, *others)))
    return f"{node.kind} {given}".rstrip()


def _label(node: NodeSpec) -> str:
    """Return the label of a node for people: the author's name for it, else its key."""
    last = node.path.rpartition("/")[2].partition("@")[0]
    segment = last.partition(".")[2] or last
    inner = node
    while "@" in inner.path.rpartition("/")[2] and inner.children:
        inner = inner.children[0]
    named = _NOT_IN_PATH.sub("_", inner.name).strip("_") == segment
    return inner.name if named else segment


def _wait_text(event: Event) -> str:
    """Return the wait of a node as text: ``wait 4 s``, ``wait_for live.person``."""
    assert event.node is not None
    name = event.node.name
    if type_of(event.node).waits is not Waits.TIME or not event.text:
        return name
    return f"{event.node.kind} {event.text}" if "${" in name else f"{name}, {event.text}"


def tuned_text(tunable: Tunable, value: Plain) -> str:
    """Return a tunable and its value as text."""
    return f"{tunable.name} {value_text(value)}{_UNITS.get(tunable.type, '')}"


def value_text(value: Plain) -> str:
    """Return a value as text."""
    match value:
        case Mapping():
            return ", ".join(f"{name} {value_text(one)}" for name, one in value.items())
        case tuple() | list():
            return ", ".join(map(value_text, value))
        case bool():
            return "true" if value else "false"
    return format_value(value, FieldType.ANY)


def ending(rehearsed: Rehearsed) -> str:
    """Return the end of a rehearsal as a short text."""
    if rehearsed.outcome is None and not rehearsed.ticks:
        return "does not bid"
    outcome = rehearsed.outcome.value if rehearsed.outcome is not None else "did not end"
    return f"{outcome} after {time_text(rehearsed.duration_s)}, {rehearsed.ticks} ticks"


def _aside(event: Event) -> str:
    if event.kind is not EventKind.BEGINS or event.takes_s == 0.0:
        return ""
    return "for ever" if math.isinf(event.takes_s) else f"{event.takes_s:.1f} s"


def _text(event: Event, ticks: bool) -> str | None:
    """Return the text of an event; None when it adds nothing."""
    match event.kind:
        case EventKind.BEGINS | EventKind.SENDS:
            return _phrase(event)
        case EventKind.SUCCEEDS:
            return _success(event)
        case EventKind.FAILS:
            return f"{_phrase(event)} – {event.text}"
        case EventKind.STOPS:
            return f"{_phrase(event)} – stopped"
        case EventKind.WAITS:
            return f"waits: {_wait_text(event)}" if event.node is not None else "waits"
        case EventKind.GIVES_UP | EventKind.NOT_TAKEN:
            return f"{_label(event.node)}: {event.text}" if event.node else event.text
        case EventKind.ARRIVES:
            return _message(event)
        case EventKind.LOST:
            return f"{_message(event)} – lost, no node waits for it"
        case EventKind.TUNES:
            return f"tuned: {event.text}"
        case EventKind.FEEDBACK:
            return f"feedback {event.text}"
        case EventKind.CANCELS:
            return f"cancelled: {event.text}"
        case EventKind.TICK:
            return _tick(event.change) if ticks and event.change is not None else None
        case EventKind.ENDS:
            outcome = event.outcome.value if event.outcome is not None else "did not end"
            return outcome + (f": {event.text}" if event.text else "")
    return event.text


def _message(event: Event) -> str:
    return f"message on {event.text}: {value_text(event.inputs) or 'empty'}"


def _phrase(event: Event) -> str:
    return phrase(event.node, event.inputs) if event.node is not None else event.text


def _success(event: Event) -> str | None:
    skill = event.node.skill if event.node is not None else None
    if event.outputs:
        return ", ".join(f"{name}: {value_text(one)}" for name, one in event.outputs.items())
    if skill is None or skill.main == "text":
        return None
    lasts = skill.binding is None or skill.binding.kind is BindingKind.ACTION
    return _phrase(event) if lasts else None


def _tick(change: StatusChange) -> str:
    depth = change.path.count("/")
    reason = f"  {change.message}" if change.message else ""
    return f"{'· ' * depth}{_STATUS[change.status]} {change.name}{reason}"


def table(rows: Iterable[tuple[str, str, bool]], width: int = WIDTH) -> Iterator[str]:
    """Yield the lines of two columns, expected and found, with a mark where they differ."""
    room = (width - 7) // 2
    yield f"    {'expected':<{room}} │ found"
    for expected, found, same in rows:
        left = textwrap.wrap(printable_lines(expected), room) or [""]
        right = textwrap.wrap(printable_lines(found), room) or [""]
        for number in range(max(len(left), len(right))):
            one = left[number] if number < len(left) else ""
            other = right[number] if number < len(right) else ""
            mark = "✘" if not same and not number else " "
            yield f"  {mark} {one}{' ' * max(0, room - columns(one))} │ {other}".rstrip()
