# SPDX-License-Identifier: Apache-2.0
"""A short soak breaks no promise; ``BT_AGENTS_SOAK_MINUTES`` makes it longer."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

import soak
from programs import output_of

MINUTES = float(os.environ.get("BT_AGENTS_SOAK_MINUTES", "1"))
HANG_S = 60.0 * MINUTES + 240.0


@pytest.mark.e2e
def test_system_keeps_promises_under_random_kills_and_hangs(tmp_path: Path) -> None:
    command = [sys.executable, soak.__file__, str(MINUTES), "--seed", "1", "--any-time"]
    said = output_of([*command, "--logs", str(tmp_path / "soak")], HANG_S)
    assert "a scene that was acknowledged ends exactly once" in said
