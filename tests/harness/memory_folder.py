# SPDX-License-Identifier: Apache-2.0
"""A folder in memory, for files that a test writes often or without waiting for a disk."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

_MEMORY = "/dev/shm"


@contextmanager
def memory_folder() -> Iterator[Path]:
    """Make a folder, in memory if the system allows it; remove it at the end."""
    root = _MEMORY if os.access(_MEMORY, os.W_OK) else None
    with TemporaryDirectory(prefix="bt-agents-", dir=root) as folder:
        yield Path(folder)
