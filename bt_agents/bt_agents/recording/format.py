# SPDX-License-Identifier: Apache-2.0
"""Format of recordings: lines of JSON, one for the begin and one for each step with changes.

A step is a tick with the cancel before it. During one the outside stands still: clock, live scene
and goals answer each time as they did first, a goal that is cancelled excepted. So one entry a
step is enough. A step in which nothing new came has no entry.

``NaN`` and ``Infinity`` are written as Python writes them. The first line has what was known
before: ``format``, ``agent``, ``host``, ``version``, ``file``, ``seed``, ``limits``,
``parameters``, ``scene``, ``profile``, ``tunables``, ``live``, ``t``. The others have:

============ =====================================================================================
``step``     number of the step, from 1
``quiet``    how many steps without an entry came right before; without it none
``changes``  how many nodes have changed in it; without it none
``t``        the trees' clock, when it was read and differs from before [s]; not when only a
             deadline was compared with it that has not come
``s``        the same of the steady clock, which only the end of a run reads [s]
``live``     what is new in the live scene that was read
``tunables`` all of them, when one has changed
``clock``    ``{"hour", "weekday"}``, when the local time was read and differs from before
``calls``    what the host did besides: ``{"call": "cancel", "reason", "clean_up"}``, with the
             ``"cancellation"``: ``{"by", "reason"}`` where it is known who stopped it, or
             ``{"call": "shorten_settling", "settle_s"}`` each
``kept``     paths of the nodes that a breakpoint kept from starting in it; they start in the next
             tick, if their turn has not passed by then
``goals``    what is new about goals that were polled: ``{"goal", "field", "value"}`` each, with
             ``"after_cancel": true`` where only a cancel in the same step brought it out; goals
             are numbered as sent, from 0
``messages`` messages that were taken: ``{"inbox", "message"}`` each, inboxes numbered as opened
``plugins``  answers of behaviours of packages: ``{"path", "status", "message"}`` each; what went
             wrong at the end of one has no status; with the ``"writes"`` of names, if any
``settling`` paths of such behaviours, one for each goal that is not confirmed ended, when changed
``requests`` what was asked for: ``{"kind", "name", "fields"}`` each; one that was refused has the
             ``"error"``: ``{"code", "reason"}``, or ``{"type", "message"}`` of another exception
``end``      how the run has ended
``stopped``  why nothing more is recorded
============ =====================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from bt_agents_core.errors import Refused

FORMAT = 2
"""The format that is written and read."""

MOST_STEPS = 10_000_000
"""Most steps of a recording; more of them are a slip of the pen."""

Entry = dict[str, Any]
"""One line of a recording."""

_NUMBERS = {"step", "quiet", "changes", "t", "s"}


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recorded run.

    Attributes:
        head: What was known before the first step.
        entries: Number of a step → its entry.
        stopped: Why the entries end before the run, or where some are missing; else empty.
    """

    head: Mapping[str, Any]
    entries: Mapping[int, Mapping[str, Any]]
    stopped: str = ""

    @property
    def steps(self) -> int:
        """Number of the last step that has an entry."""
        return max(self.entries, default=0)

    @property
    def complete(self) -> bool:
        """Whether it goes on to the end of the run."""
        return bool(self.entries) and "end" in self.entries[self.steps]


def to_line(entry: Entry) -> str:
    """Return an entry as JSON; most have only numbers, which are written much quicker.

    Raises:
        TypeError, ValueError, RecursionError: It holds something else than plain data.
    """
    if entry.keys() <= _NUMBERS:
        return "{" + ",".join([f'"{key}":{value!r}' for key, value in entry.items()]) + "}"
    return _JSON.encode(entry)


def read_recording(lines: Iterable[str]) -> Recording:
    """Return a recording from its lines, in order.

    What follows a missing line cannot be replayed and is left out.

    Raises:
        Refused: ``BAD_RECORD``; the first line is missing or names another format, or a line
            cannot be read.
    """
    head: Mapping[str, Any] | None = None
    entries: dict[int, Mapping[str, Any]] = {}
    stopped = ""
    last = 0
    for line in lines:
        entry = _parse(line)
        if head is None:
            if entry.get("format") != FORMAT:
                raise bad_recording(
                    f"it begins with the format {entry.get('format')!r:.40}, expected {FORMAT}"
                )
            head = entry
            continue
        if "stopped" in entry:
            stopped = str(entry["stopped"])
            continue
        step, quiet = entry.get("step"), entry.get("quiet", 0)
        if not isinstance(step, int) or not last < step <= MOST_STEPS:
            raise bad_recording(
                f"an entry has the step {step!r}, expected a later one than before"
            )
        if not isinstance(quiet, int):
            raise bad_recording(f"step {step} comes after {quiet!r} quiet ones, expected a number")
        if step - 1 != last + quiet:
            stopped = f"entries between the steps {last} and {step} are missing"
            break
        entries[step] = entry
        last = step
    if head is None:
        raise bad_recording("it is empty")
    return Recording(head=head, entries=entries, stopped=stopped)


def bad_recording(reason: str) -> Refused:
    """Return the error of a recording that cannot be replayed."""
    return Refused("BAD_RECORD", f"the recording of a run cannot be replayed: {reason}")


def _parse(line: str) -> Entry:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise bad_recording(f"a line is no JSON ({error})") from None
    if not isinstance(entry, dict):
        raise bad_recording(f"a line holds a {type(entry).__name__}, expected a mapping")
    return entry


def _to_plain(value: object) -> object:
    """Return a value that JSON has no form for as one that it has a form for."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"there is a {type(value).__name__}, expected plain data")


_JSON = json.JSONEncoder(default=_to_plain, separators=(",", ":"), ensure_ascii=False)
