# SPDX-License-Identifier: Apache-2.0
"""The lines of the file in which tuning is kept: JSON, checked like anything from outside."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

from bt_agents.host.tuning.history import (
    TuningAction,
    TuningCause,
    TuningChange,
    TuningHistory,
    TuningRevision,
)
from bt_agents.host.tuning.overrides import Override, Overrides
from bt_agents.host.tuning.tunable import LONGEST_TEXT, Setting
from bt_agents_core.errors import Refused

FORMAT = 1

_LARGEST = 2**63 - 1
_LONGEST_NAME = 300


def revision_line(revision: TuningRevision, defaults: Mapping[str, Setting]) -> str:
    """Return one revision as a line."""
    return _line(_revision(revision) | {"defaults": dict(defaults)})


def agreed_line(name: str) -> str:
    """Return a line that says that a file has a tuned value as its default now."""
    return _line({"agreed": name})


def state_line(remembered: Overrides) -> str:
    """Return everything that is known as one line, which stands for all lines before it."""
    history = remembered.history
    shown = dict.fromkeys(revision.number for revision, _ in history.shown)
    by_number = {revision.number: revision for revision, _ in history.shown}
    return _line(
        {
            "format": FORMAT,
            "revision": history.revision,
            "undoable": [_revision(one) for one in history.undoable],
            "redoable": [_revision(one) for one in history.redoable],
            "shown": [_revision(by_number[number]) for number in shown],
            "kept": {
                name: {"value": kept.value, "default": kept.default}
                for name, kept in remembered.kept.items()
            },
        }
    )


def take_line(text: str, remembered: Overrides) -> Overrides:
    """Return what is known with one more line.

    Raises:
        Refused: ``NOT_A_LINE``, or as in :meth:`Overrides.take`; then nothing is changed.
    """
    try:
        found = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise Refused("NOT_A_LINE", f"no JSON: {error}") from None
    found = _mapping(found, "the line")
    if "format" in found:
        return _state_of(found)
    if "agreed" in found:
        remembered.agree(_name(found["agreed"]))
        return remembered
    revision = _revision_of(found)
    defaults = {
        _name(name): _setting(value)
        for name, value in _mapping(found.get("defaults"), "'defaults'").items()
    }
    remembered.take(revision, defaults)
    return remembered


def _line(content: Mapping[str, Any]) -> str:
    return json.dumps(content, ensure_ascii=False, separators=(",", ":")) + "\n"


def _revision(revision: TuningRevision) -> dict[str, Any]:
    cause = revision.cause
    return {
        "revision": revision.number,
        "stamp": revision.stamp,
        "author": cause.author,
        "reason": cause.reason,
        "action": cause.action.value,
        "of": cause.of,
        "changes": [
            {"name": one.name, "before": one.before, "after": one.after}
            for one in revision.changes
        ],
    }


def _state_of(found: Mapping[str, Any]) -> Overrides:
    if found["format"] != FORMAT:
        raise Refused("NOT_A_LINE", f"format {found['format']!r}, expected {FORMAT}")
    kept = {}
    for name, value in _mapping(found.get("kept"), "'kept'").items():
        pair = _mapping(value, "a kept value")
        kept[_name(name)] = Override(
            value=_setting(pair.get("value")), default=_setting(pair.get("default"))
        )
    history = TuningHistory(
        _count(found.get("revision"), "'revision'"),
        _revisions(found.get("undoable")),
        _revisions(found.get("redoable")),
        _revisions(found.get("shown")),
    )
    return Overrides(history=history, kept=kept)


def _revisions(found: Any) -> Iterable[TuningRevision]:
    return [_revision_of(_mapping(one, "a revision")) for one in _list(found, "the revisions")]


def _revision_of(found: Mapping[str, Any]) -> TuningRevision:
    try:
        action = TuningAction(found.get("action"))
    except ValueError:
        raise Refused(
            "NOT_A_LINE", f"action {found.get('action')!r}, expected set, undo or redo"
        ) from None
    stamp = found.get("stamp")
    if isinstance(stamp, bool) or not isinstance(stamp, int | float) or not 0 <= stamp < 2**31:
        raise Refused("NOT_A_LINE", f"stamp {stamp!r}, expected seconds since 1970")
    cause = TuningCause(
        author=_text(found.get("author"), "'author'"),
        reason=_text(found.get("reason"), "'reason'"),
        action=action,
        of=_count(found.get("of"), "'of'"),
    )
    changes = tuple(
        TuningChange(
            name=_name(one.get("name")),
            before=_setting(one.get("before")),
            after=_setting(one.get("after")),
        )
        for one in (_mapping(o, "a change") for o in _list(found.get("changes"), "'changes'"))
    )
    return TuningRevision(
        number=_count(found.get("revision"), "'revision'"),
        stamp=float(stamp),
        cause=cause,
        changes=changes,
    )


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number")


def _mapping(found: Any, what: str) -> dict[str, Any]:
    if not isinstance(found, dict):
        raise Refused("NOT_A_LINE", f"{what} is no mapping")
    return found


def _list(found: Any, what: str) -> list[Any]:
    if not isinstance(found, list):
        raise Refused("NOT_A_LINE", f"{what} is no list")
    return found


def _text(found: Any, what: str) -> str:
    if not isinstance(found, str) or len(found) > LONGEST_TEXT:
        raise Refused("NOT_A_LINE", f"{what} is no text of at most {LONGEST_TEXT} characters")
    return found


def _name(found: Any) -> str:
    if not isinstance(found, str) or not 0 < len(found) <= _LONGEST_NAME:
        raise Refused("NOT_A_LINE", f"the name of a value is no text of 1 to {_LONGEST_NAME}")
    return found


def _count(found: Any, what: str) -> int:
    if isinstance(found, bool) or not isinstance(found, int) or not 0 <= found < 2**32:
        raise Refused("NOT_A_LINE", f"{what} is {found!r}, expected a number of a revision")
    return found


def _setting(found: Any) -> Setting:
    if isinstance(found, str):
        return _text(found, "a value")
    if not isinstance(found, bool | int | float):
        raise Refused("NOT_A_LINE", "a value is no number, text, true or false")
    if isinstance(found, int) and abs(found) > _LARGEST:
        raise Refused("NOT_A_LINE", "a whole number has more than 64 bits")
    if isinstance(found, float) and not math.isfinite(found):
        raise Refused("NOT_A_LINE", "a number is not finite")
    return found
