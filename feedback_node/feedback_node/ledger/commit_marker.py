# SPDX-License-Identifier: Apache-2.0
"""The file beside the ledger that remembers its newest acknowledged row.

SQLite drops a damaged end of its write-ahead log without a word. This file is written after each
commit and before it is acknowledged, so that such a loss is noticed. That the commit itself is on
the disk does not hang on it: it goes there a little later, and only a failure of power within
that time, which also damages the log, is not noticed.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

from feedback_node.ledger.ledger_rows import NO_CHAIN

_SLOT = struct.Struct("<8sQ32s")
_CHECK = struct.Struct("<I")
_MAGIC = b"bta-head"
_OFFSETS = (0, 512)
"""Two slots in sectors of their own: a write that is cut off spoils the older one only."""
_SIZE = _OFFSETS[-1] + _SLOT.size + _CHECK.size


@dataclass(frozen=True, kw_only=True)
class Head:
    """The newest row: its number, 0 for none, and its chain value."""

    number: int = 0
    chain: bytes = NO_CHAIN


def head_path(ledger: str | Path) -> Path:
    """Return the file that belongs to a ledger."""
    path = Path(ledger)
    return path.with_name(path.name + "-head")


def read_head(path: Path) -> Head | None:
    """Return the newest head of a file; None when it is missing.

    Raises:
        ValueError: It is no such file, or both of its slots are damaged.
        OSError: It cannot be read.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    return max(_slots(content), key=lambda one: one[1].number)[1]


class HeadFile:
    """Writes the head of one ledger; made when there is none.

    Raises:
        OSError: It cannot be written.
        ValueError: As in :func:`read_head`.
    """

    def __init__(self, path: Path) -> None:
        if read_head(path) is None:
            _create(path)
        self._slot, self.head = max(_slots(path.read_bytes()), key=lambda one: one[1].number)
        self._path = str(path)
        self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        if os.fstat(self._file).st_size < _SIZE:
            os.ftruncate(self._file, _SIZE)
        # A write through the file would have the commit after it wait for its time of change.
        self._memory = mmap.mmap(self._file, _SIZE)
        self._synced = True

    def write(self, head: Head) -> None:
        """Replace the head, for whoever reads the file from now on; see :meth:`sync`.

        Raises:
            OSError: It could not; the head before stays.
            ValueError: It is of an older row than the head that is there.
        """
        if head.number < self.head.number:
            raise ValueError(
                f"row {head.number} is to be the newest, but row {self.head.number} was "
                "acknowledged"
            )
        slot = 1 - self._slot
        self._put(slot, head)
        self._slot, self.head = slot, head
        self._synced = False

    def sync(self) -> None:
        """Wait until the disk holds the head.

        Raises:
            OSError: It does not.
        """
        if not self._synced:
            # What a disk has failed to take once is not brought to it again by another sync.
            self._put(self._slot, self.head)
            os.fdatasync(self._file)
            self._synced = True

    def _put(self, slot: int, head: Head) -> None:
        mine, written = os.fstat(self._file), _slot(head)
        if mine.st_size < _SIZE or not os.path.samestat(os.stat(self._path), mine):
            raise FileNotFoundError(
                f"{self._path} was replaced or cut off; stop the node before that"
            )
        self._memory[_OFFSETS[slot] : _OFFSETS[slot] + len(written)] = written

    def close(self) -> None:
        """Close the file."""
        self._memory.close()
        os.close(self._file)


def _slots(content: bytes) -> list[tuple[int, Head]]:
    """Return the slots that are whole, with their index."""
    whole = []
    for index, offset in enumerate(_OFFSETS):
        slot = content[offset : offset + _SLOT.size + _CHECK.size]
        if len(slot) < _SLOT.size + _CHECK.size:
            continue
        body = slot[: _SLOT.size]
        magic, number, chain = _SLOT.unpack(body)
        if magic == _MAGIC and _CHECK.unpack(slot[_SLOT.size :])[0] == zlib.crc32(body):
            whole.append((index, Head(number=number, chain=chain)))
    if not whole:
        raise ValueError("no slot of it is whole")
    return whole


def _slot(head: Head) -> bytes:
    body = _SLOT.pack(_MAGIC, head.number, head.chain)
    return body + _CHECK.pack(zlib.crc32(body))


def _create(path: Path) -> None:
    """Make a head file of an empty ledger, as a whole or not at all."""
    slot = _slot(Head())
    new = path.with_name(path.name + ".new")
    try:
        with new.open("wb") as opened:
            opened.write(slot.ljust(_OFFSETS[1], b"\0") + slot)
            opened.flush()
            os.fsync(opened.fileno())
        new.replace(path)
    except OSError:
        new.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
