# SPDX-License-Identifier: Apache-2.0
"""Fixtures for real nodes over real DDS in one process, spun by one executor."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from checkout import ROOT
from fake_market import Market
from graph import Ros, fresh_graph
from scripted_server import Script, ScriptedServer


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
def stranger() -> Iterator[Any]:
    """Node with its own participant; a participant can have only one type under each name."""
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("stranger", context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


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
