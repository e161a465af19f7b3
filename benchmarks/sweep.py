# SPDX-License-Identifier: Apache-2.0
"""How long the shipped sweeps take on all cores, in real and in CPU time; prints a table.

``python benchmarks/sweep.py 50`` plays 50 runs of each way instead of all.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass, replace

from bt_agents.trees_folder import find_sweep
from bt_agents_lab.experiments.sweep import SweepSpec, sweep
from bt_agents_lab.experiments.sweep_reader import read_sweep

NAMES = ("told", "persons")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What a sweep took.

    Attributes:
        ways: How many ways to select and to learn, under how much wrong feedback, were played.
        seconds: Real time [s].
        cpu: CPU time of all processes [s].
    """

    ways: int
    seconds: float
    cpu: float


def measured(spec: SweepSpec, processes: int) -> Measured:
    """Return how long a sweep takes."""
    start, cpu = time.perf_counter(), _cpu()
    ways = len(sweep(spec, processes))
    return Measured(ways=ways, seconds=time.perf_counter() - start, cpu=_cpu() - cpu)


def _cpu() -> float:
    """Return the CPU time of this process and of those that it has ended [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main() -> None:
    """Measure and print every sweep."""
    processes = os.cpu_count() or 1
    print(f"{processes} processes")
    print(f"{'sweep':10}{'ways':>6}{'runs':>7}{'rounds':>8}{'seconds':>10}{'CPU s':>9}")
    for name in NAMES:
        spec = read_sweep(find_sweep(name))
        if sys.argv[1:]:
            spec = replace(spec, runs=int(sys.argv[1]))
        took = measured(spec, processes)
        print(
            f"{name:10}{took.ways:6}{spec.runs:7,}{spec.rounds:8}{took.seconds:10.1f}"
            f"{took.cpu:9.1f}"
        )


if __name__ == "__main__":
    main()
