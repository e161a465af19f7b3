# SPDX-License-Identifier: Apache-2.0
"""File of the open goals of a host, which its next start cancels."""

from __future__ import annotations

import fcntl
import json
import os
import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import MOST_OPEN_GOALS, OpenGoal
from bt_agents_core.private_files import make_private_folder, open_private

_RECORD_BYTES = 128 * 1024


class OpenGoalsFile:
    """File with two records, written in turn, so that one is intact after a kill at any time.

    A write within a tick takes a few microseconds: the file is neither flushed to the disk nor
    replaced, which could take long. The process that has it open holds a lock; a second process
    can neither read nor write it.

    Args:
        path: The file; created with its folder if missing.

    Raises:
        OSError: It cannot be opened, or another process holds it.
    """

    def __init__(self, path: Path) -> None:
        make_private_folder(path.parent)
        self._file = open_private(path, os.O_RDWR)
        self._sequence = 0
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise

    def read(self) -> tuple[OpenGoal, ...]:
        """Return the goals that an earlier start left open; none from a damaged file."""
        records = [_read(os.pread(self._file, _RECORD_BYTES, at)) for at in (0, _RECORD_BYTES)]
        self._sequence, goals = max(records, key=lambda record: record[0])
        return goals

    def write(self, goals: Sequence[OpenGoal]) -> None:
        """Write the goals that are open now.

        Raises:
            OSError: It cannot be written.
        """
        self._sequence += 1
        named = [[one.path, one.action, one.goal_id.hex()] for one in goals]
        text = json.dumps([self._sequence, named], ensure_ascii=False).encode()
        record = b"%08x %s\n" % (zlib.crc32(text), text)
        os.pwrite(self._file, record, (self._sequence % 2) * _RECORD_BYTES)

    def close(self) -> None:
        """Release the file for other processes."""
        os.close(self._file)


def _read(record: bytes) -> tuple[int, tuple[OpenGoal, ...]]:
    """Return the number and the goals of a record; 0 and no goals if it is not intact."""
    line, _, _ = record.partition(b"\n")
    checksum, _, text = line.partition(b" ")
    with suppress(ValueError, TypeError, Refused, RecursionError):
        if int(checksum, 16) == zlib.crc32(text):
            sequence, named = json.loads(text)
            goals = tuple(
                OpenGoal(path=path, action=action, goal_id=bytes.fromhex(goal_id))
                for path, action, goal_id in named[:MOST_OPEN_GOALS]
            )
            return int(sequence), goals
    return 0, ()
