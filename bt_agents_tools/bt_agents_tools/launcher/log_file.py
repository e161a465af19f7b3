# SPDX-License-Identifier: Apache-2.0
"""The log file of a process, to which every start of it is appended."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import BinaryIO

_READ = 16_384
_LONGEST_LINE = 500


class LogFile:
    """A file that may grow for ever, of which only the end is read.

    Args:
        path: Where; its folder exists.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin = 0

    def open(self, start: int) -> BinaryIO:
        """Return the file for what the process prints.

        Args:
            start: Which start of the process this is, from 1.
        """
        log = self.path.open("ab")
        if start > 1:
            log.write(f"--- start {start}, {time.strftime('%Y-%m-%d %H:%M:%S')}\n".encode())
            log.flush()
        self._begin = log.tell()
        return log

    def last_words(self, lines: int) -> list[str]:
        """Return the last lines since the last start, however large the file is."""
        try:
            with self.path.open("rb") as log:
                size = log.seek(0, os.SEEK_END)
                log.seek(max(self._begin, size - _READ))
                text = log.read(_READ).decode(errors="replace")
        except OSError as error:
            return [f"(the log cannot be read: {error.strerror})"]
        return [line[:_LONGEST_LINE] for line in text.splitlines()[-lines:]]
