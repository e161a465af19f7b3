# SPDX-License-Identifier: Apache-2.0
"""A system of real processes, each killed by its pid at the end of the test."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from graph import fresh_graph
from processes import System

MEMORY = "/dev/shm"


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder in memory, where there is one.

    A disk that other tests keep busy may take longer for a file than a market waits for it.
    """
    root = MEMORY if os.access(MEMORY, os.W_OK) else None
    with TemporaryDirectory(prefix="bt-agents-", dir=root) as folder:
        yield Path(folder)


@pytest.fixture
def system(tmp_path: Path) -> Iterator[System]:
    """Processes around a probe, in a ROS context of this test."""
    with fresh_graph() as ros:
        processes = System(ros, tmp_path)
        try:
            yield processes
        finally:
            processes.close()
