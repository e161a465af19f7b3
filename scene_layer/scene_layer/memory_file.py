# SPDX-License-Identifier: Apache-2.0
"""The file in which what is known of persons and places outlives a restart."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import SceneSpace
from scene_layer.memory import MOST_KNOWN, KnownPerson, Running

FORMAT = 1
MOST_BYTES = 16 * 2**20
"""No file becomes larger: of what there is no room for, what was seen longest ago is left out."""

_HEAD = f'{{"format": {FORMAT}, "persons": '
_MIDDLE = ', "places": '
_MOST_VISITS = 10**12
_SHOWN = 100

LONGEST_NAME = 200
"""Characters of the name of a person or a place."""

Remembered = tuple[Mapping[str, KnownPerson], Mapping[str, KnownPerson]]
"""Persons and places by name."""


class DamagedMemoryError(BtAgentsError):
    """A file that this module has written is not as it was written."""


def to_text(
    persons: Mapping[str, KnownPerson],
    places: Mapping[str, KnownPerson],
    most_bytes: int = MOST_BYTES,
) -> str:
    """Return what is known as the text of a file of so many bytes at most.

    It is put together piece by piece, so that other threads go on in between.
    """
    pieces = [
        (known.seen_at, kind, f"{_json(name)}: {_json(_plain(known))}")
        for kind, every in enumerate((persons, places))
        for name, known in every.items()
    ]
    room = most_bytes - len(f"{_HEAD}{{}}{_MIDDLE}{{}}}}\n")
    kept = set()
    for number in sorted(range(len(pieces)), key=lambda number: -pieces[number][0]):
        room -= len(pieces[number][2].encode()) + len(", ")
        if room < 0:
            break
        kept.add(number)
    known, here = (
        ", ".join(pieces[number][2] for number in sorted(kept) if pieces[number][1] == kind)
        for kind in (0, 1)
    )
    return f"{_HEAD}{{{known}}}{_MIDDLE}{{{here}}}}}\n"


def from_text(text: str, space: SceneSpace, now: float) -> Remembered:
    """Return what a text says; values of other parameters, or out of range now, are left out.

    Args:
        text: Of a file.
        space: The scene parameters.
        now: Unix time; what was seen later, by a clock that was wrong, was seen now [s].

    Raises:
        DamagedMemoryError: It is not what :func:`to_text` writes.
    """
    try:
        document = json.loads(text)
        found = document["format"]
        if found != FORMAT:
            raise ValueError(f"format {found!r}, expected {FORMAT}")
        return _known(document["persons"], space, now), _known(document["places"], space, now)
    except (
        ValueError, TypeError, KeyError, AttributeError, RecursionError, ArithmeticError,
    ) as error:  # fmt: skip
        words = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise DamagedMemoryError(f"not a memory of the scene layer: {words}") from None


def read(path: Path, space: SceneSpace, now: float) -> Remembered:
    """Return what a file says; nothing when it is empty or not there.

    Args:
        path: Of the file.
        space: The scene parameters.
        now: Unix time [s].

    Raises:
        DamagedMemoryError: It is one of ours, and damaged.
        BtAgentsError: It is none of ours, or cannot be read.
    """
    another = "name another file for the memory"
    try:
        if not path.is_file() and path.exists():
            kind = "a folder" if path.is_dir() else "no plain file"
            raise BtAgentsError(f"{path} is {kind}, expected a file; {another}")
        with path.open("rb") as opened:
            content = opened.read(MOST_BYTES + 1)
    except FileNotFoundError:
        return {}, {}
    except OSError as error:
        words = error.strerror or error
        raise BtAgentsError(f"{path} cannot be read ({words}); {another}") from None
    if not content.strip():
        return {}, {}
    if not content.startswith(_HEAD.encode()):
        raise BtAgentsError(
            f"{path} is not a memory of the scene layer, expected a file that begins with "
            f"{_HEAD.strip()}, an empty one or none; {another}"
        )
    try:
        if len(content) > MOST_BYTES:
            raise DamagedMemoryError(f"more than {MOST_BYTES} bytes")
        return from_text(content.decode(), space, now)
    except UnicodeDecodeError as error:
        raise DamagedMemoryError(f"{path} is not text: {error}") from None
    except DamagedMemoryError as error:
        raise DamagedMemoryError(f"{path}: {error}") from None


def save(
    path: Path, persons: Mapping[str, KnownPerson], places: Mapping[str, KnownPerson]
) -> None:
    """Replace the file as a whole, readable by its owner only; make it when it is not there.

    Raises:
        OSError: It cannot be written; the old one is still there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o600)
    write_atomically(path, to_text(persons, places))


def set_aside(path: Path) -> Path:
    """Give a damaged file another name; return it.

    Raises:
        OSError: It cannot be renamed.
    """
    names = (path.with_name(f"{path.name}.damaged{n or ''}") for n in range(MOST_KNOWN))
    free = next((name for name in names if not name.exists()), path.with_name(f"{path.name}.old"))
    return path.rename(free)


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _plain(known: KnownPerson) -> dict[str, Any]:
    return {
        "visits": known.visits,
        "seen_at": known.seen_at,
        "values": {
            name: [one.mean, one.scatter, one.weight, one.at] for name, one in known.values.items()
        },
    }


def _known(document: Mapping[str, Any], space: SceneSpace, now: float) -> dict[str, KnownPerson]:
    if len(document) > MOST_KNOWN:
        raise ValueError(f"{len(document)} names, expected {MOST_KNOWN} at most")
    found = {}
    for name, one in document.items():
        if len(name) > LONGEST_NAME:
            raise ValueError(f"a name of {len(name)} characters, expected {LONGEST_NAME} at most")
        visits = one["visits"]
        if type(visits) is not int or not 0 <= visits < _MOST_VISITS:
            raise ValueError(f"{name}: {_shown(visits)} visits, expected a whole number")
        [seen_at] = _numbers([one["seen_at"]], name)
        values = dict(_values(one["values"], name, space, now))
        found[name] = KnownPerson(visits=visits, values=values, seen_at=min(seen_at, now))
    return found


def _values(
    document: Mapping[str, Any], owner: str, space: SceneSpace, now: float
) -> Iterator[tuple[str, Running]]:
    ranges = {p.name: (p.minimum, p.maximum) for p in space.parameters}
    for name, numbers in document.items():
        mean, scatter, weight, at = _numbers(numbers, f"{owner}: {name}")
        if scatter < 0.0 or weight <= 0.0:
            raise ValueError(f"{owner}: {name}: a negative scatter or weight")
        low, high = ranges.get(name, (math.inf, -math.inf))
        if low <= mean <= high:
            yield name, Running(mean=mean, scatter=scatter, weight=weight, at=min(at, now))


def _numbers(values: Iterable[Any], what: str) -> list[float]:
    numbers = []
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{what}: {_shown(value)}, expected a number")
        numbers.append(float(value))
        if not math.isfinite(numbers[-1]):
            raise ValueError(f"{what}: {value}, expected a finite number")
    return numbers


def _shown(value: object) -> str:
    return repr(value)[:_SHOWN]
