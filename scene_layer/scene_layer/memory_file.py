# SPDX-License-Identifier: Apache-2.0
"""The file in which what is known of persons and places outlives a restart."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from bt_agents.atomic_file import write_atomically
from bt_agents.errors import BtAgentsError
from bt_agents.scene import SceneSpace
from scene_layer.memory import MOST_KNOWN, Known, Running

FORMAT = 1
MOST_BYTES = 16 * 2**20
"""A larger file is none of ours."""

LONGEST_NAME = 200
"""Characters of the name of a person or a place."""

Remembered = tuple[Mapping[str, Known], Mapping[str, Known]]
"""Persons and places by name."""


def to_text(persons: Mapping[str, Known], places: Mapping[str, Known]) -> str:
    """Return what is known as the text of a file."""
    document = {
        "format": FORMAT,
        "persons": {name: _plain(known) for name, known in persons.items()},
        "places": {name: _plain(known) for name, known in places.items()},
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n"


def from_text(text: str, space: SceneSpace) -> Remembered:
    """Return what a text says; values of other parameters, or out of range now, are left out.

    Raises:
        BtAgentsError: It is not what :func:`to_text` writes.
    """
    try:
        document = json.loads(text)
        found = document["format"]
        if found != FORMAT:
            raise ValueError(f"format {found!r}, expected {FORMAT}")
        return _known(document["persons"], space), _known(document["places"], space)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        words = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise BtAgentsError(f"not a memory of the scene layer: {words}") from None


def read(path: Path, space: SceneSpace) -> Remembered:
    """Return what a file says; nothing when it is not there.

    Raises:
        BtAgentsError: It cannot be read, or is damaged.
    """
    try:
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise BtAgentsError(f"{path} has {size} bytes, expected {MOST_BYTES} at most")
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return {}, {}
    except UnicodeDecodeError as error:
        raise BtAgentsError(f"{path} is not text: {error}") from None
    except OSError as error:
        raise BtAgentsError(f"{path} cannot be read: {error.strerror or error}") from None
    try:
        return from_text(text, space)
    except BtAgentsError as error:
        raise BtAgentsError(f"{path}: {error}") from None


def write(path: Path, text: str) -> None:
    """Replace the file as a whole, readable by its owner only; make it when it is not there.

    Raises:
        OSError: It cannot be written; the old one is still there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o600)
    write_atomically(path, text)


def set_aside(path: Path) -> Path:
    """Give a damaged file another name; return it.

    Raises:
        OSError: It cannot be renamed.
    """
    names = (path.with_name(f"{path.name}.damaged{n or ''}") for n in range(MOST_KNOWN))
    free = next((name for name in names if not name.exists()), path.with_name(f"{path.name}.old"))
    return path.rename(free)


def _plain(known: Known) -> dict[str, Any]:
    return {
        "visits": known.visits,
        "seen_at": known.seen_at,
        "values": {
            name: [one.mean, one.scatter, one.weight, one.at] for name, one in known.values.items()
        },
    }


def _known(document: Mapping[str, Any], space: SceneSpace) -> dict[str, Known]:
    if len(document) > MOST_KNOWN:
        raise ValueError(f"{len(document)} names, expected {MOST_KNOWN} at most")
    found = {}
    for name, one in document.items():
        if len(name) > LONGEST_NAME:
            raise ValueError(f"a name of {len(name)} characters, expected {LONGEST_NAME} at most")
        visits = one["visits"]
        if type(visits) is not int or visits < 0:
            raise ValueError(f"{name}: {visits!r} visits, expected a whole number")
        [seen_at] = _numbers([one["seen_at"]], name)
        values = dict(_values(one["values"], name, space))
        found[name] = Known(visits=visits, values=values, seen_at=seen_at)
    return found


def _values(
    document: Mapping[str, Any], owner: str, space: SceneSpace
) -> Iterator[tuple[str, Running]]:
    ranges = {p.name: (p.minimum, p.maximum) for p in space.parameters}
    for name, numbers in document.items():
        mean, scatter, weight, at = _numbers(numbers, f"{owner}: {name}")
        if scatter < 0.0 or weight <= 0.0:
            raise ValueError(f"{owner}: {name}: a negative scatter or weight")
        low, high = ranges.get(name, (math.inf, -math.inf))
        if low <= mean <= high:
            yield name, Running(mean=mean, scatter=scatter, weight=weight, at=at)


def _numbers(values: list[Any], what: str) -> list[float]:
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{what}: {value!r}, expected a number")
        if not math.isfinite(value):
            raise ValueError(f"{what}: {value}, expected a finite number")
    return [float(value) for value in values]
