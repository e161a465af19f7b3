# SPDX-License-Identifier: Apache-2.0
"""Real nodes over real DDS in one process, turned by one executor until a condition holds."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from graph import Ros, fresh_graph


@pytest.fixture(scope="package", autouse=True)
def old_objects_stay() -> Iterator[None]:
    """Have the garbage collector look at what these tests make only, which is quick."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture
def ros(old_objects_stay: None) -> Iterator[Ros]:
    """A fresh ROS context of this test."""
    with fresh_graph() as graph:
        yield graph
