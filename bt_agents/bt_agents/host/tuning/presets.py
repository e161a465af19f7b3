# SPDX-License-Identifier: Apache-2.0
"""Presets: named values that are applied together, in a YAML file that people can read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import ReadError, Refused
from bt_agents_core.private_files import make_private_file
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.tools.formatting.scalar_style import quoted
from bt_agents_language.yaml.field_tables import FIELDS, FieldDecl, KeyTable
from bt_agents_language.yaml.source import read_source
from bt_agents_language.yaml.typed_reader import TypedReader

LONGEST_NAME = 60
"""Characters of the name of a preset."""

MOST_PRESETS = 100

MOST_VALUES = 10_000
"""Values of all presets together: a file of them can be read."""

_PRESETS = KeyTable(
    what="a file of presets", fields=(FieldDecl("presets", FIELDS, required=True),)
)

Preset = Mapping[str, str]
"""ROS parameter of the host → value as an author writes it."""


class Presets:
    """Presets of a host, stored on the disk before they count; in memory without a file.

    One thread may change them, and others read them meanwhile.

    Attributes:
        problem: Report of what is wrong with the file; empty when it can be used.
        by_name: The presets in alphabetical order.
    """

    def __init__(self, file: Path | None) -> None:
        self.problem = ""
        self._file = file
        self.by_name: Mapping[str, Preset] = {}
        if file is not None and file.exists() and file.stat().st_size:
            try:
                self.by_name = dict(sorted(read_presets(file).items()))
            except ReadError as error:
                self.problem = error.report

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
        """Save values under a name, instead of what had it before.

        Raises:
            Refused: ``NOT_A_NAME``, ``TOO_MANY``, ``BROKEN_PRESETS`` or ``NOT_KEPT``; nothing is
                changed.
        """
        self._refuse_broken()
        presets = {**self.by_name, check_name(name): dict(values)}
        many = sum(map(len, presets.values()))
        if len(presets) > MOST_PRESETS or many > MOST_VALUES:
            raise Refused(
                "TOO_MANY",
                f"{len(presets)} presets with {many} values, expected at most {MOST_PRESETS} with "
                f"{MOST_VALUES}; forget one, or save fewer agents",
            )
        self._write(presets)

    def forget(self, name: str) -> None:
        """Remove a preset.

        Raises:
            Refused: As in :meth:`get` and :meth:`save`; nothing is changed.
        """
        self.get(name)
        self._write({one: values for one, values in self.by_name.items() if one != name})

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
                raise Refused(
                    "NOT_KEPT",
                    f"{self._file} cannot be written: {error.strerror or error}; nothing is "
                    "changed",
                ) from error
        self.by_name = dict(sorted(presets.items()))


def check_name(name: str) -> str:
    """Return a name that a preset can have.

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
    """Return a file of presets."""
    lines = ["format: 1\n", "presets:\n" if presets else "presets: {}\n"]
    for name in sorted(presets):
        lines.append(f"  {quoted(name)}:{'' if presets[name] else ' {}'}\n")
        lines += [f"    {key}: {quoted(value)}\n" for key, value in presets[name].items()]
    return "".join(lines)


def read_presets(path: Path) -> Mapping[str, Preset]:
    """Return the presets of a file.

    Raises:
        ReadError: There is a problem; it lists all of them.
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
