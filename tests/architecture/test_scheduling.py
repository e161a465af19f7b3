# SPDX-License-Identifier: Apache-2.0
"""Scheduling: every test runs, on a worker for its kind."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from scheduling import Scheduling

TESTS = [
    *(f"tests/bt_agents/unit/test_{number}.py::test_a" for number in range(40)),
    *(f"tests/e2e/test_b.py::test_{number}" for number in range(12)),
    *(f"tests/e2e/test_studio.py::test_{number}" for number in range(5)),
    *(f"tests/ros/test_d.py::test_{number}" for number in range(8)),
    *(f"tests/packaging/test_c.py::test_{number}" for number in range(6)),
]


class Worker:
    """A worker that runs its tests when the test says so."""

    def __init__(self, number: int) -> None:
        self.gateway = SimpleNamespace(id=f"gw{number}")
        self.shutting_down = False
        self.waiting: list[int] = []
        self.done: list[str] = []

    def send_runtest_some(self, indices: list[int]) -> None:
        self.waiting += indices

    def shutdown(self) -> None:
        self.shutting_down = True

    def run_one(self, scheduling: Scheduling) -> None:
        index = self.waiting.pop(0)
        self.done.append(TESTS[index])
        scheduling.mark_test_complete(self, index)  # type: ignore[arg-type]


def scheduled(*numbers: int) -> tuple[Scheduling, list[Worker]]:
    options: Any = SimpleNamespace(tx=["popen"] * len(numbers), loadscopereorder=True)
    config: Any = SimpleNamespace(option=options, getvalue=lambda name: getattr(options, name))
    scheduling = Scheduling(config)
    workers = [Worker(number) for number in numbers]
    for worker in workers:
        scheduling.add_node(worker)  # type: ignore[arg-type]
    for worker in workers:
        scheduling.add_node_collection(worker, TESTS)  # type: ignore[arg-type]
    scheduling.schedule()
    return scheduling, workers


def run(scheduling: Scheduling, workers: list[Worker]) -> None:
    while any(worker.waiting for worker in workers):
        for worker in workers:
            if worker.waiting:
                worker.run_one(scheduling)


@pytest.mark.parametrize("numbers", [(0,), (0, 1), (2, 1, 0), (4, 0, 3, 1, 2)])
def test_each_test_runs_once(numbers: tuple[int, ...]) -> None:
    scheduling, workers = scheduled(*numbers)
    run(scheduling, workers)
    assert sorted(test for worker in workers for test in worker.done) == sorted(TESTS)
    assert all(worker.shutting_down for worker in workers)
    assert scheduling.tests_finished


def test_tests_sharing_expensive_setup_run_on_one_worker() -> None:
    scheduling, workers = scheduled(0, 1, 2)
    run(scheduling, workers)
    for folder in ("tests/packaging/", "tests/e2e/test_studio.py"):
        assert sum(any(test.startswith(folder) for test in one.done) for one in workers) == 1
