# SPDX-License-Identifier: Apache-2.0
"""Atomic replacement of a file: a reader sees the old text or the new one, never half of it."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path


def write_atomically(path: Path, text: str, *, durable: bool = True) -> None:
    """Replace the text of an existing file; keep its permissions, and keep a link a link.

    A text that is not ``durable`` survives the process, but may not survive a power loss.

    Raises:
        OSError: The file or its folder cannot be written; the old file is still there.
    """
    target = path.resolve(strict=True)
    mode = stat.S_IMODE(target.stat().st_mode)
    descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8", newline="") as opened:
            opened.write(text)
            os.fchmod(opened.fileno(), mode)
            opened.flush()
            if durable:
                os.fsync(opened.fileno())
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise
