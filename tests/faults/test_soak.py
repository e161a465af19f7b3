# SPDX-License-Identifier: Apache-2.0
"""A short soak breaks no promise; ``BT_AGENTS_SOAK_MINUTES`` makes it longer."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import soak

MINUTES = float(os.environ.get("BT_AGENTS_SOAK_MINUTES", "1"))
HANG_S = 60.0 * MINUTES + 240.0
END_S = 30.0


@pytest.mark.e2e
def test_system_keeps_promises_under_random_kills_and_hangs(tmp_path: Path) -> None:
    command = [sys.executable, soak.__file__, str(MINUTES), "--seed", "1", "--any-time"]
    with subprocess.Popen(
        [*command, "--logs", str(tmp_path / "soak")],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            said, _ = process.communicate(timeout=HANG_S)
        except subprocess.TimeoutExpired:
            # It ends the processes that it has started; a kill would leave them behind.
            process.send_signal(signal.SIGINT)
            said, _ = process.communicate(timeout=END_S)
            pytest.fail(f"still running after {HANG_S} s; its output:\n{said}")
        finally:
            process.kill()
    assert process.returncode == 0, said
    assert "a scene that was acknowledged ends exactly once" in said
