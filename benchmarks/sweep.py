# SPDX-License-Identifier: Apache-2.0
"""How long the shipped sweeps take on all cores."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace

from bt_agents_core.trees_folder import find_sweep
from bt_agents_lab.experiments.sweep import SweepSpec, sweep
from bt_agents_lab.experiments.sweep_reader import read_sweep
from measuring import Effort, Row

NAMES = ("told", "persons")
LEAST_ROUNDS = 30
LIMIT_S = 60.0
"""A sweep of 1,000 runs of 300 rounds takes no longer [s]."""


def measure(effort: Effort) -> Iterator[Row]:
    """Play every sweep once; it takes too long for more."""
    processes = os.cpu_count() or 1
    for name in NAMES:
        spec = read_sweep(find_sweep(name))
        rounds = max(LEAST_ROUNDS, effort.times(spec.rounds))
        spec = replace(spec, runs=effort.times(spec.runs), rounds=rounds)
        if effort.is_short:
            spec = replace(spec, selections=spec.selections[::4])
        ways = len(spec.selections) * len(spec.learnings) * len(spec.shares)
        seconds, cpu = _played(spec, ways, processes)
        yield Row(
            case=f"{name}, {ways} ways, {spec.runs:,} runs of {spec.rounds}",
            side=f"{processes} processes",
            values=[seconds],
            floor="the limit",
            floor_values=[LIMIT_S],
            goal=None if effort.is_short else 1.0,
            note=f"{cpu:.0f} s of CPU time",
        )


def _played(spec: SweepSpec, ways: int, processes: int) -> tuple[float, float]:
    """Return how long a sweep takes, and how much CPU time [s].

    Raises:
        RuntimeError: A way is missing, or a run of one.
    """
    began, cpu = time.perf_counter(), _cpu()
    results = sweep(spec, processes)
    took = time.perf_counter() - began, _cpu() - cpu
    if len(results) != ways or any(len(runs.late) != spec.runs for _, runs in results):
        raise RuntimeError(f"{len(results)} ways of {ways} were played, or not all of their runs")
    return took


def _cpu() -> float:
    """Return the CPU time of this process and of those that it has ended [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
