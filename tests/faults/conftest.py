# SPDX-License-Identifier: Apache-2.0
"""Fixtures for a system of real processes, each killed by its pid at the end of the test."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from graph import fresh_graph
from memory_folder import memory_folder
from processes import System

SIMULATED = """
format: 1
title: one
rounds: 1
seed: 0
scenes: [{age: 5, familiarity: 3, mood: 3}]
feedback:
  each:
    leo: {mood: 5}
"""


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder in memory.

    On a disk that other tests keep busy, a file may take longer than a market waits for it.
    """
    with memory_folder() as folder:
        yield folder


@pytest.fixture
def system(tmp_path: Path) -> Iterator[System]:
    """Processes around a probe, in a ROS context of this test."""
    with fresh_graph() as ros, closing(System(ros, tmp_path)) as processes:
        yield processes


@pytest.fixture
def simulated(tmp_path: Path) -> Path:
    """A file by which leo learns once after each run."""
    file = tmp_path / "simulated.yaml"
    file.write_text(SIMULATED)
    return file
