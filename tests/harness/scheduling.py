# SPDX-License-Identifier: Apache-2.0
"""Which worker runs which tests: those that wait share the machine with those that compute."""

from __future__ import annotations

from typing import Any

from xdist.scheduler import LoadScopeScheduling

PROCESS_WORKERS = 2
"""The first workers, which run the tests of processes; the others compute meanwhile.

More of them beside tests that compute would make each other late.
"""

_OF_PROCESSES = ("tests/e2e/", "tests/faults/", "tests/ros/")
_TOGETHER = (
    "tests/packaging/",
    "tests/e2e/test_editor.py",
    "tests/e2e/test_studio.py",
    "tests/e2e/test_studio_pages.py",
    "tests/e2e/test_studio_tree.py",
    "tests/faults/test_fleet.py",
    "tests/faults/test_floods.py",
    "tests/faults/test_machines.py",
)
"""Tests that share a build, or a system or a server that takes long to start."""


class Scheduling(LoadScopeScheduling):
    """Tests of processes on the first workers, others on the others, and then what is left.

    The mark ``xdist_group`` could keep tests together, but does nothing from pytest 9.2 on.
    """

    def _split_scope(self, nodeid: str) -> str:
        return next((group for group in _TOGETHER if nodeid.startswith(group)), nodeid)

    def _assign_work_unit(self, node: Any) -> None:
        # A worker that has crashed is replaced by one with the next number.
        numbers = {one: int(one.gateway.id.removeprefix("gw")) for one in self.nodes}
        first = {one for one in self.nodes if numbers[one] < PROCESS_WORKERS} or {*self.nodes}
        for of_processes in (True, False) if node in first else (False, True):
            for scope in self.workqueue:
                if scope.startswith(_OF_PROCESSES) == of_processes:
                    self.workqueue.move_to_end(scope, last=False)
                    super()._assign_work_unit(node)
                    return
        node.shutdown()
