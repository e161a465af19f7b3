# SPDX-License-Identifier: Apache-2.0
"""Paths of the files that outlive a start, by the XDG rules."""

from __future__ import annotations

import os
from pathlib import Path


def state_folder() -> Path:
    """Return the folder of logs, journals and learned profiles."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "bt-agents"


def journal_folder() -> Path:
    """Return the folder of the journal when no other is named."""
    return state_folder() / "journal"
