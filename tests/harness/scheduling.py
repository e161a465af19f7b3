# SPDX-License-Identifier: Apache-2.0
"""Scheduling of tests on workers: tests that wait share the machine with tests that compute."""

from __future__ import annotations

from enum import Enum
from typing import Any

from xdist.scheduler import LoadScopeScheduling


class Kind(Enum):
    """The load that tests cause, and the folders of such tests."""

    PROCESSES = ("tests/e2e/", "tests/faults/")
    """They wait half of the time."""

    NODES = ("tests/ros/",)
    """They wait most of the time."""

    COMPUTING = ("",)
    """All others."""


ORDERS = (
    (Kind.PROCESSES, Kind.NODES, Kind.COMPUTING),
    (Kind.NODES, Kind.PROCESSES, Kind.COMPUTING),
    (Kind.COMPUTING, Kind.PROCESSES, Kind.NODES),
)
"""Order of the kinds for each of the first workers; further workers use the last order.

Together they keep two cores busy. More tests of processes beside tests that compute would delay
each other.
"""

_BUILT_ONCE = "tests/packaging/"
"""Tests that share a build."""

_TOGETHER = (
    "tests/e2e/test_editor.py",
    "tests/e2e/test_studio",
    "tests/faults/test_fleet.py",
    "tests/faults/test_floods.py",
    "tests/faults/test_machines.py",
    "tests/ros/test_ros4hri.py",
)
"""Files whose tests share something slow to start or to compile."""


def kind_of(test: str) -> Kind:
    """Return the load that a test causes."""
    return next(kind for kind in Kind if test.startswith(kind.value))


class Scheduling(LoadScopeScheduling):
    """Gives each worker tests of its first kind, then the rest.

    Tests that compute are assigned by file, because each piece of work takes its time. The mark
    ``xdist_group`` could keep tests together, but does nothing from pytest 9.2 on.
    """

    def _split_scope(self, nodeid: str) -> str:
        if nodeid.startswith(_BUILT_ONCE):
            return _BUILT_ONCE
        alone = kind_of(nodeid) is not Kind.COMPUTING and not nodeid.startswith(_TOGETHER)
        return nodeid if alone else nodeid.partition("::")[0]

    def _assign_work_unit(self, node: Any) -> None:
        # The replacement of a crashed worker has the next number.
        workers = sorted(self.nodes, key=lambda one: int(one.gateway.id.removeprefix("gw")))
        for kind in ORDERS[min(workers.index(node), len(ORDERS) - 1)]:
            for scope in self.workqueue:
                if kind_of(scope) is kind:
                    self.workqueue.move_to_end(scope, last=False)
                    super()._assign_work_unit(node)
                    return
        node.shutdown()
