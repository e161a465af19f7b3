# SPDX-License-Identifier: Apache-2.0
"""Fixtures for real nodes over real DDS in one process, spun by one executor."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator

import pytest

from checkout import ROOT
from fake_market import Market
from graph import Ros, fresh_graph
from scripted_server import Script, ScriptedServer
from stranger import Stranger


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark each test of this folder."""
    item.add_marker(pytest.mark.ros)


@pytest.fixture
def ros() -> Iterator[Ros]:
    """A new ROS context for this test."""
    with fresh_graph() as graph:
        yield graph


@pytest.fixture
def market(ros: Ros) -> Market:
    """A market, which is silent until a test opens it."""
    return Market(ros)


@pytest.fixture
def mouth(ros: Ros) -> ScriptedServer:
    """A server that says a text until a test finishes it."""
    return ScriptedServer(ros, script=Script(finish_s=None))


@pytest.fixture
def stranger(ros: Ros) -> Iterator[Stranger]:
    """A node with its own participant."""
    made = Stranger(ros)
    yield made
    made.close()


@pytest.fixture
def py_trees_ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The installed py_trees_ros, or a stand-in with the parts that the examples need."""
    if importlib.util.find_spec("py_trees_ros") is None:
        monkeypatch.syspath_prepend(ROOT / "tests" / "harness" / "stand_ins")
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.partition(".")[0] == "py_trees_ros":
            del sys.modules[name]
