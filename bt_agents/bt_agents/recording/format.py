# SPDX-License-Identifier: Apache-2.0
"""Format of recordings: lines of JSON, one for the start and one for each step with changes.

A step is a tick with the cancel before it. During a step the outside is frozen: clock, live scene
and goals always repeat their first answer, except a goal that is cancelled. So one entry per step
is enough. A step without news has no entry.

``NaN`` and ``Infinity`` are written as in Python. The first line has what was known
before: ``format``, ``agent``, ``host``, ``version``, ``file``, ``seed``, ``limits``,
``parameters``, ``scene``, ``profile``, ``tunables``, ``live``, ``t``. The others have:

============ =====================================================================================
``step``     number of the step, from 1
``quiet``    number of steps without an entry right before; 0 if missing
``changes``  number of nodes that have changed in it; 0 if missing
``t``        the trees' clock, if it was read and differs from before [s]; not if it was only
             compared with a deadline that has not come
``s``        the same for the steady clock, which only the end of a run reads [s]
``live``     changes of the live scene, if it was read
``tunables`` all of them, if one has changed
``clock``    ``{"hour", "weekday"}``, if the local time was read and differs from before
``calls``    other calls of the host: ``{"call": "cancel", "reason", "clean_up"}``, with the
             ``"cancellation"``: ``{"by", "reason"}`` if it is known who stopped the run, or
             ``{"call": "shorten_settling", "settle_s"}`` each
``kept``     paths of the nodes that a breakpoint held in it; they start in the next tick, unless
             their turn has passed by then
``goals``    changes of polled goals: ``{"goal", "field", "value"}`` each, with
             ``"after_cancel": true`` if only a cancel in the same step revealed it; goals are
             numbered in order of sending, from 0
``messages`` messages taken: ``{"inbox", "message"}`` each; inboxes are numbered as opened, from 0
``plugins``  answers of behaviours of packages: ``{"path", "status", "message"}`` each, with the
             ``"writes"`` of names, if any; an error at the end of a behaviour has no status
``settling`` paths of such behaviours, one for each goal without a confirmed end, if changed
``requests`` requests: ``{"kind", "name", "fields"}`` each; a refused one has the
             ``"error"``: ``{"code", "reason"}``, or ``{"type", "message"}`` of another exception
``end``      how the run ended
``stopped``  why the recording stops here
============ =====================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from bt_agents_core.errors import Refused

FORMAT = 2
"""Number of the format that is written and read."""

MOST_STEPS = 10_000_000
"""Most steps of a recording; a larger number is an error in the file."""

Entry = dict[str, Any]
"""One line of a recording."""

_NUMBERS = {"step", "quiet", "changes", "t", "s"}


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recorded run.

    Attributes:
        head: The first line: what was known before the first step.
        entries: Number of a step → its entry.
        stopped: Why the entries end before the run, or where some are missing; else empty.
    """

    head: Mapping[str, Any]
    entries: Mapping[int, Mapping[str, Any]]
    stopped: str = ""

    @property
    def steps(self) -> int:
        """Number of the last step with an entry."""
        return max(self.entries, default=0)

    @property
    def complete(self) -> bool:
        """Whether it covers the run to its end."""
        return bool(self.entries) and "end" in self.entries[self.steps]


def to_line(entry: Entry) -> str:
    """Return an entry as JSON, with a faster path for entries of only numbers.

    Raises:
        TypeError, ValueError, RecursionError: It contains other than plain data.
    """
    if entry.keys() <= _NUMBERS:
        return "{" + ",".join([f'"{key}":{value!r}' for key, value in entry.items()]) + "}"
    return _JSON.encode(entry)


def read_recording(lines: Iterable[str]) -> Recording:
    """Return a recording from its lines, in order.

    Lines after a missing line cannot be replayed and are skipped.

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
    """Convert a value without a JSON form into one with a JSON form."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"there is a {type(value).__name__}, expected plain data")


_JSON = json.JSONEncoder(default=_to_plain, separators=(",", ":"), ensure_ascii=False)
