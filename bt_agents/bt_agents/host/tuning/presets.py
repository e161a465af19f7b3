# SPDX-License-Identifier: Apache-2.0
"""Presets of a trees folder: named sets of values, each in a YAML file of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bt_agents.host.tuning.change_log import not_kept
from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import ReadError, Refused
from bt_agents_core.file_watch import Stamp, poll
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import quote
from bt_agents_core.trees_folder import is_installed
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.files.folder_reader import yaml_files
from bt_agents_language.files.preset_reader import (
    Preset,
    name_problem,
    preset_file,
    preset_text,
    read_preset,
)

MOST_PRESETS = 100

MOST_VALUES = 10_000
"""Most values of all presets together."""


class Presets:
    """Presets of a trees folder; a broken file affects no other preset.

    One thread may change them while others read :attr:`by_name` and :attr:`problems`. Files that
    authors or other hosts have changed are read by :meth:`refresh`, and before each change; a
    change replaces both mappings.

    Args:
        folder: Folder of the files, which may be missing.

    Attributes:
        by_name: The presets in alphabetical order.
        problems: File → the reason for leaving it out.
    """

    def __init__(self, folder: Path) -> None:
        self.by_name: Mapping[str, Preset] = {}
        self.problems: Mapping[Path, str] = {}
        self._folder = folder
        self._stamps: Mapping[str, Stamp] = {}
        self._read: dict[Path, Preset | ReadError] = {}
        self._files: dict[str, Path] = {}
        self.refresh()

    def refresh(self) -> None:
        """Read the files that have changed."""
        try:
            paths = yaml_files(self._folder)
        except OSError as error:
            unreadable = f"{self._folder} cannot be read ({error.strerror}); its presets stay"
            if self.problems != {self._folder: unreadable}:
                self.problems = {self._folder: unreadable}
            return
        stamps = poll(paths, ())
        if stamps == self._stamps:
            return
        self._read = {
            path: self._read[path]
            if path in self._read and stamps.get(str(path)) == self._stamps.get(str(path))
            else _read(path)
            for path in paths
        }
        self._stamps = stamps
        self._arrange()

    def _arrange(self) -> None:
        """Assign each name to one file, within the limits."""
        presets: dict[str, Preset] = {}
        files: dict[str, Path] = {}
        problems: dict[Path, str] = {}
        values = 0
        for path, found in self._read.items():
            if isinstance(found, ReadError):
                problems[path] = found.report
            elif found.name in files:
                first = files[found.name].name
                problems[path] = f"{path}: {first} holds the preset {quote(found.name)} already"
            elif len(presets) == MOST_PRESETS or values + len(found.values) > MOST_VALUES:
                problems[path] = (
                    f"{path}: left out, because a host takes at most {MOST_PRESETS} presets with "
                    f"{MOST_VALUES} values"
                )
            else:
                presets[found.name], files[found.name] = found, path
                values += len(found.values)
        self._files = files
        self.problems = problems
        self.by_name = dict(sorted(presets.items()))

    def get(self, name: str) -> Preset:
        """Return a preset.

        Raises:
            Refused: ``UNKNOWN_PRESET``.
        """
        presets = self.by_name
        if name not in presets:
            hint = did_you_mean(name, presets) or "'bt-agents preset save NAME' makes one"
            broken = ", ".join(path.name for path in self.problems)
            more = f"; left out because of problems: {broken}" if broken else ""
            raise Refused(RefusalCode.UNKNOWN_PRESET, f"no preset {quote(name)}; {hint}{more}")
        return presets[name]

    def save(self, name: str, values: Mapping[str, str]) -> None:
        """Save values, by agent and tunable, under a name; replace an existing preset.

        Raises:
            Refused: ``BAD_NAME``, ``TOO_MANY``, ``FILE_TAKEN``, ``STORAGE_FULL`` or
                ``CANNOT_WRITE``; nothing is changed.
        """
        check_name(name)
        self.refresh()
        others = [preset for preset in self.by_name.values() if preset.name != name]
        many = len(values) + sum(len(preset.values) for preset in others)
        if len(others) + 1 > MOST_PRESETS or many > MOST_VALUES:
            raise Refused(
                RefusalCode.TOO_MANY,
                f"{len(others) + 1} presets with {many} values, expected at most {MOST_PRESETS} "
                f"with {MOST_VALUES}; forget one, or save fewer agents",
            )
        path = self._files.get(name) or self._folder / preset_file(name)
        if name not in self._files and path in self._read:
            raise Refused(
                RefusalCode.FILE_TAKEN,
                f"{path} holds another preset, or is broken; choose another name, or fix, rename "
                "or delete the file",
            )
        self._check_writable()
        try:
            _write(path, preset_text(name, values))
        except OSError as error:
            raise not_kept(path, error) from error
        self.refresh()

    def forget(self, name: str) -> None:
        """Delete the file of a preset.

        Raises:
            Refused: ``UNKNOWN_PRESET`` or ``CANNOT_WRITE``; nothing is changed.
        """
        self.refresh()
        self.get(name)
        self._check_writable()
        path = self._files[name]
        try:
            path.unlink()
        except OSError as error:
            raise not_kept(path, error) from error
        self.refresh()

    def _check_writable(self) -> None:
        if is_installed(self._folder):
            raise Refused(
                RefusalCode.CANNOT_WRITE,
                f"{self._folder} belongs to the installation, where no presets are saved or "
                "forgotten; start the system with a copy of the trees folder",
            )


def check_name(name: str) -> None:
    """Check the name of a preset.

    Raises:
        Refused: ``BAD_NAME``.
    """
    if problem := name_problem(name):
        raise Refused(RefusalCode.BAD_NAME, problem)


def _read(path: Path) -> Preset | ReadError:
    try:
        return read_preset(path)
    except ReadError as error:
        return error


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    is_new = not path.exists()
    path.touch()
    try:
        write_atomically(path, text)
    except BaseException:
        if is_new:
            path.unlink(missing_ok=True)
        raise
