# SPDX-License-Identifier: Apache-2.0
"""File of a studio's tokens and sessions, readable only by its owner."""

from __future__ import annotations

import sys
from pathlib import Path

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.private_files import make_private_file
from bt_agents_core.text import printable
from bt_agents_studio.access import LARGEST_STATE


class AccessFile:
    """File with the result of :meth:`AccessControl.text`.

    An unusable file is reported once on the error stream; after that nothing is stored.

    Args:
        path: The file, in an existing folder; None stores nothing.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path

    def read(self) -> str:
        """Return the text; empty without a file."""
        if self._path is None:
            return ""
        try:
            with self._path.open("rb") as opened:
                return opened.read(LARGEST_STATE + 1).decode()
        except FileNotFoundError:
            return ""
        except (OSError, UnicodeDecodeError) as error:
            self._give_up(error)
            return ""

    def write(self, text: str) -> None:
        """Replace the text."""
        if self._path is None:
            return
        try:
            make_private_file(self._path)
            write_atomically(self._path, text, durable=False)
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        print(
            f"sessions of the studio are not kept over its restart: {printable(str(error))}",
            file=sys.stderr,
        )
        self._path = None
