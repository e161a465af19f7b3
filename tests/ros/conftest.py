# SPDX-License-Identifier: Apache-2.0
"""Real nodes over real DDS in one process, turned by one executor until a condition holds."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from graph import Ros, fresh_graph


@pytest.fixture
def ros() -> Iterator[Ros]:
    """A fresh ROS context of this test."""
    with fresh_graph() as graph:
        yield graph
