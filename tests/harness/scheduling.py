# SPDX-License-Identifier: Apache-2.0
"""Which worker runs which tests: those that wait share the machine with those that compute."""

from __future__ import annotations

from enum import Enum
from typing import Any

from xdist.scheduler import LoadScopeScheduling


class Kind(Enum):
    """What tests do, and the folders of such tests."""

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
"""What each of the first workers runs, in this order; all others are as the last one.

Together they keep two cores busy. More tests of processes beside tests that compute would make
each other late.
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
"""Files of tests that share what takes long to start or to compile."""


def kind_of(test: str) -> Kind:
    """Return what a test does."""
    return next(kind for kind in Kind if test.startswith(kind.value))


class Scheduling(LoadScopeScheduling):
    """Tests of each kind on the workers that begin with it, and then what is left.

    Tests that compute are given out by the file, as each piece of work takes its time. The mark
    ``xdist_group`` could keep tests together, but does nothing from pytest 9.2 on.
    """

    def _split_scope(self, nodeid: str) -> str:
        if nodeid.startswith(_BUILT_ONCE):
            return _BUILT_ONCE
        alone = kind_of(nodeid) is not Kind.COMPUTING and not nodeid.startswith(_TOGETHER)
        return nodeid if alone else nodeid.partition("::")[0]

    def _assign_work_unit(self, node: Any) -> None:
        # A worker that has crashed is replaced by one with the next number.
        workers = sorted(self.nodes, key=lambda one: int(one.gateway.id.removeprefix("gw")))
        for kind in ORDERS[min(workers.index(node), len(ORDERS) - 1)]:
            for scope in self.workqueue:
                if kind_of(scope) is kind:
                    self.workqueue.move_to_end(scope, last=False)
                    super()._assign_work_unit(node)
                    return
        node.shutdown()
