# SPDX-License-Identifier: Apache-2.0
"""Real nodes over real DDS in one process, turned by one executor until a condition holds."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator

import pytest

from checkout import ROOT
from graph import Ros, fresh_graph


@pytest.fixture
def ros() -> Iterator[Ros]:
    """A fresh ROS context of this test."""
    with fresh_graph() as graph:
        yield graph


@pytest.fixture
def py_trees_ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The installed py_trees_ros, or a stand-in for what the examples need."""
    if importlib.util.find_spec("py_trees_ros") is None:
        monkeypatch.syspath_prepend(ROOT / "tests" / "harness" / "stand_ins")
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.partition(".")[0] == "py_trees_ros":
            del sys.modules[name]
