# SPDX-License-Identifier: Apache-2.0
"""Presets: named sets of values that are applied together, in a readable YAML file."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import ReadError, Refused
from bt_agents_core.private_files import make_private_file
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.yaml.field_tables import FIELDS, FieldDecl, KeyTable
from bt_agents_language.yaml.scalars import quoted
from bt_agents_language.yaml.source import read_source
from bt_agents_language.yaml.typed_reader import TypedReader

LONGEST_NAME = 60
"""Most characters of the name of a preset."""

MOST_PRESETS = 100

MOST_VALUES = 10_000
"""Most values of all presets together; a file with this many can still be read."""

_LOCKED_S = 1.0
"""How long a change waits for another process that changes presets in the folder [s]."""

_LOCK_AGAIN_S = 0.01

_PRESETS = KeyTable(
    what="a file of presets", fields=(FieldDecl("presets", FIELDS, required=True),)
)

Preset = Mapping[str, str]
"""ROS parameter of the host → value as an author writes it."""


class Presets:
    """Presets of a host, stored on disk before they count; in memory without a file.

    One thread may change them while others read them. Changes of the file by other writers, such
    as a host with the same folder, are read before the next change.

    Attributes:
        problem: What is wrong with the file; empty if it can be used.
        by_name: The presets in alphabetical order.
    """

    def __init__(self, file: Path | None) -> None:
        self.problem = ""
        self._file = file
        self.by_name: Mapping[str, Preset] = {}
        self._read: _Written | None = None
        self._take_in()

    def get(self, name: str) -> Preset:
        """Return a preset.

        Raises:
            Refused: ``UNKNOWN_PRESET``, or ``BROKEN_PRESETS``.
        """
        presets = self.by_name
        if name not in presets:
            self._refuse_broken()
            hint = did_you_mean(name, presets) or "'bt-agents preset save NAME' makes one"
            raise Refused("UNKNOWN_PRESET", f"no preset {quote(name)}; {hint}")
        return presets[name]

    def save(self, name: str, values: Preset) -> None:
        """Save values under a name, replacing an existing preset.

        Raises:
            Refused: ``NOT_A_NAME``, ``TOO_MANY``, ``BROKEN_PRESETS`` or ``NOT_KEPT``; nothing is
                changed.
        """
        check_name(name)
        with self._locked():
            self._refuse_broken()
            presets = {**self.by_name, name: dict(values)}
            many = sum(map(len, presets.values()))
            if len(presets) > MOST_PRESETS or many > MOST_VALUES:
                raise Refused(
                    "TOO_MANY",
                    f"{len(presets)} presets with {many} values, expected at most {MOST_PRESETS} "
                    f"with {MOST_VALUES}; forget one, or save fewer agents",
                )
            self._write(presets)

    def forget(self, name: str) -> None:
        """Remove a preset.

        Raises:
            Refused: As in :meth:`get` and :meth:`save`; nothing is changed.
        """
        with self._locked():
            self.get(name)
            self._refuse_broken()
            self._write({one: values for one, values in self.by_name.items() if one != name})

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Lock the folder of the file against other writers, and read their changes."""
        if self._file is None:
            yield
            return
        try:
            folder = os.open(self._file.parent, os.O_RDONLY)
        except OSError as error:
            raise self._not_kept(error) from error
        try:
            self._lock(folder)
            self._take_in()
            yield
        finally:
            os.close(folder)

    def _lock(self, folder: int) -> None:
        until = time.monotonic() + _LOCKED_S
        while True:
            try:
                return fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if time.monotonic() >= until:
                    raise self._not_kept(error) from error
            time.sleep(_LOCK_AGAIN_S)

    def _take_in(self) -> None:
        """Read the file, unless it is unchanged since the last reading or writing."""
        found = _written(self._file)
        if found == self._read:
            return
        self._read = found
        self.problem = ""
        presets: Mapping[str, Preset] = {}
        if self._file is not None and found is not None and found.size:
            try:
                presets = read_presets(self._file)
            except ReadError as error:
                self.problem = error.report
        self.by_name = dict(sorted(presets.items()))

    def _refuse_broken(self) -> None:
        if self.problem:
            first = self.problem.splitlines()[0]
            raise Refused(
                "BROKEN_PRESETS",
                f"the file of the presets is broken; mend it or move it away, then restart the "
                f"host: {first}",
            )

    def _write(self, presets: dict[str, Preset]) -> None:
        if self._file is not None:
            try:
                make_private_file(self._file)
                write_atomically(self._file, presets_text(presets))
            except OSError as error:
                raise self._not_kept(error) from error
            self._read = _written(self._file)
        self.by_name = dict(sorted(presets.items()))

    def _not_kept(self, error: OSError) -> Refused:
        return Refused(
            "NOT_KEPT",
            f"{self._file} cannot be written: {error.strerror or error}; nothing is changed",
        )


class _Written(NamedTuple):
    """State of a file; each atomic write changes it."""

    number: int
    time_ns: int
    size: int


def _written(file: Path | None) -> _Written | None:
    """Return the state of a file; None without one."""
    if file is None:
        return None
    try:
        found = file.stat()
    except OSError:
        return None
    return _Written(found.st_ino, found.st_mtime_ns, found.st_size)


def check_name(name: str) -> str:
    """Check the name of a preset and return it.

    Raises:
        Refused: ``NOT_A_NAME``.
    """
    if not 0 < len(name) <= LONGEST_NAME or not name.isprintable() or name != name.strip():
        raise Refused(
            "NOT_A_NAME",
            f"a preset cannot be called {quote(name)}; expected 1 to {LONGEST_NAME} visible "
            "characters in one line, for example 'morning' or 'care home'",
        )
    return name


def presets_text(presets: Mapping[str, Preset]) -> str:
    """Return the text of a file of presets."""
    lines = ["format: 1\n", "presets:\n" if presets else "presets: {}\n"]
    for name in sorted(presets):
        lines.append(f"  {quoted(name)}:{'' if presets[name] else ' {}'}\n")
        lines += [f"    {key}: {quoted(value)}\n" for key, value in presets[name].items()]
    return "".join(lines)


def read_presets(path: Path) -> Mapping[str, Preset]:
    """Return the presets of a file.

    Raises:
        ReadError: The file has problems; the error lists all of them.
    """
    reading = TypedReader(read_source(path))
    fields = reading.file(_PRESETS)
    presets: dict[str, dict[str, str]] = {}
    for entry in fields.entries("presets", "names and values"):
        name = entry.key.text
        try:
            check_name(name)
        except Refused as refused:
            reading.error("out-of-range", entry.key, refused.reason)
        presets[name] = {}
        for one in reading.entries(entry.value, f"preset {quote(name)}", "values"):
            what = f"the value of {quote(one.key.text)}"
            presets[name][one.key.text] = reading.text(one.value, what, empty=True) or ""
    reading.problems.raise_if_any()
    return presets
