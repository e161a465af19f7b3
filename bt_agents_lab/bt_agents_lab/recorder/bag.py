# SPDX-License-Identifier: Apache-2.0
"""Bags of ``ros2 bag record``: their files, and their expected number of messages."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from bt_agents_core.errors import ReadError, Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import join_first, quote
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.source import read_source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, read_yaml
from bt_agents_language.yaml.yaml_reader import Sequence as YamlList

METADATA = "metadata.yaml"
"""File that describes the content of a bag's folder."""

COMPRESSED = ".mcap.zstd"
"""Extension of a file that was compressed as a whole, with ``--compression-mode file``."""

_ENDINGS = (".mcap", COMPRESSED)
_SQLITE = (".db3", ".db3.zstd")
_COUNT = re.compile("[0-9]{1,18}")


@dataclass(frozen=True, kw_only=True)
class RecordedFiles:
    """MCAP files of one journal, bag or folder.

    Attributes:
        messages: Number of messages in them according to the ``metadata.yaml`` of a bag; None if
            unknown.
        problems: Texts about missing parts.
    """

    paths: tuple[Path, ...]
    messages: int | None = None
    problems: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Total size of the files [bytes].

        Raises:
            OSError: A file cannot be inspected.
        """
        return sum(path.stat().st_size for path in self.paths)


def is_bag(folder: Path) -> bool:
    """Return whether ``ros2 bag`` has written a folder and ended normally."""
    return (folder / METADATA).is_file()


def recorded_files(path: Path) -> RecordedFiles:
    """Return the files for a path: itself, the files of a bag, or all in a folder.

    Raises:
        Refused: ``SQLITE_BAG`` or ``NO_RECORDING``.
    """
    if not path.is_dir():
        if path.name.endswith(_SQLITE):
            raise _sqlite(path.parent)
        return RecordedFiles(paths=(path,))
    inside = sorted(one for one in path.iterdir() if one.is_file())
    found = _named(path) if is_bag(path) else RecordedFiles(paths=())
    if not found.paths:
        if any(one.name.endswith(_SQLITE) for one in inside):
            raise _sqlite(path)
        found = replace(found, paths=tuple(one for one in inside if one.name.endswith(_ENDINGS)))
    if not found.paths:
        nothing = f"there is no journal and no bag in the folder {path}"
        raise Refused(RefusalCode.NO_RECORDING, "; ".join([nothing, *found.problems]))
    return found


def _named(folder: Path) -> RecordedFiles:
    """Return the files that the metadata of a bag names; none if it is unreadable."""
    try:
        root = _read(folder / METADATA)
    except ReadError as error:
        text = f"{error.lines[0]}; 'ros2 bag reindex {folder}' writes it anew"
        return RecordedFiles(paths=(), problems=(text,))
    about = root.get("rosbag2_bagfile_information") if isinstance(root, Mapping) else None
    storage = _text(about, "storage_identifier")
    if storage == "sqlite3":
        raise _sqlite(folder)
    named = about.get("relative_file_paths") if isinstance(about, Mapping) else None
    items = named.items if isinstance(named, YamlList) else ()
    # Early versions include the folder; a name never leads outside.
    names = [PurePosixPath(one.text).name for one in items if isinstance(one, Scalar)]
    paths = [folder / name for name in dict.fromkeys(names) if name.endswith(_ENDINGS)]
    missing = [path.name for path in paths if not path.is_file()]
    number = _text(about, "message_count")
    return RecordedFiles(
        paths=tuple(path for path in paths if path.is_file()),
        messages=int(number) if _COUNT.fullmatch(number) else None,
        problems=_problems(folder, missing, bool(paths), storage),
    )


def _read(path: Path) -> Node | None:
    source = read_source(path)
    problems = Diagnostics(source)
    root = read_yaml(source, problems)
    if root is None:
        raise problems.error()
    return root


def _problems(
    folder: Path, missing: Sequence[str], is_named: bool, storage: str
) -> tuple[str, ...]:
    if not is_named:
        of = f"; its storage is {quote(storage)}, expected mcap" if storage != "mcap" else ""
        return (f"{folder / METADATA} names no file of MCAP{of}",)
    if not missing:
        return ()
    return (
        f"the bag {folder} lacks {join_first(map(quote, missing))}, which its metadata names; "
        "copy the whole folder",
    )


def _text(node: Node | None, key: str) -> str:
    """Return the value of a key as text; empty if there is none."""
    found = node.get(key) if isinstance(node, Mapping) else None
    return found.text if isinstance(found, Scalar) else ""


def _sqlite(folder: Path) -> Refused:
    return Refused(
        RefusalCode.SQLITE_BAG,
        f"{folder} is a bag in SQLite, expected MCAP; put 'output_bags: [{{uri: NEW, storage_id: "
        "mcap, all_topics: true}]' into a file out.yaml, and convert it with "
        f"'ros2 bag convert -i {folder} -o out.yaml'",
    )
