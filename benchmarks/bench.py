# SPDX-License-Identifier: Apache-2.0
"""Runs the benchmarks, each in a process of its own; prints tables and writes JSON."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import platform
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

import click
from rich.console import Console

from figures import as_json, table
from measuring import Effort, Row

BENCHMARKS = {
    "ticking": "ticks of trees, beside py_trees, BehaviorTree.CPP and bonsai-bt",
    "tracing": "what collecting status changes costs",
    "reading": "agent files: reading, checking, building",
    "ranking": "ranking of bids, beside plain Python",
    "executors": "hops between nodes by executor, idle cost",
    "rounds": "scene to first tick, bidding with many agents and hosts",
    "runs": "cancel, results of leaves, feedback, the full cycle",
    "ageing": "whether the thousandth goal and round is as quick as the first",
    "floods": "how long a node is silent under a flood, and what stays in its memory",
    "footprint": "idle CPU, memory, discovery",
    "studio": "the page in a browser: painted changes, frames, memory; what its process costs",
}
"""Module → subject of the measurement; its ``measure(effort)`` yields rows."""

LIMIT_S = 900.0
"""Time limit of one benchmark [s]."""

STOP_S = 10.0
"""Time that an interrupted benchmark has to end its processes [s]."""

SHORT = {"repetitions": 1, "scale": 0.01}
"""Effort that only shows whether a benchmark works."""

FIGURES = Path(__file__).parents[1] / "build" / "benchmarks.json"
"""Default file of the figures."""

COMPARED = (
    "py_trees", "numpy", "PyYAML", "ros-jazzy-rclpy", "ros-jazzy-rmw-fastrtps-cpp",
    "behaviortreepy", "bonsai-bt",
)  # fmt: skip
"""Packages whose versions affect the figures."""


@click.command()
@click.argument("names", nargs=-1)
@click.option(
    "--short", is_flag=True, help="See only whether they work: the figures mean nothing."
)
@click.option(
    "--json",
    "file",
    type=click.Path(path_type=Path, dir_okay=False),
    help=f"Where the figures go; figures of other benchmarks in it stay. [default: {FIGURES.name} "
    "in build/, nowhere with --short]",
)
@click.option("--seed", default=1, show_default=True, help="Of the order of measurements.")
def main(names: tuple[str, ...], short: bool, file: Path | None, seed: int) -> None:
    """Run the benchmarks of these NAMES, or all."""
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        raise click.UsageError(f"no benchmark '{unknown[0]}'; there are {', '.join(BENCHMARKS)}")
    if file is None and not short:
        FIGURES.parent.mkdir(exist_ok=True)
        file = FIGURES
    console = Console(width=None if sys.stdout.isatty() else 150, highlight=False)
    console.print(", ".join(f"{key} {value}" for key, value in _machine().items()))
    failed = []
    for name in names or BENCHMARKS:
        machine = _machine()
        began = time.monotonic()
        rows, error = _run(name, short, seed)
        took_s = time.monotonic() - began
        if rows:
            console.print(table(f"{name}: {BENCHMARKS[name]} ({took_s:.0f} s)", rows))
        if error:
            failed.append(name)
            console.print(error, markup=False)
        elif file is not None:
            found = {
                "what": BENCHMARKS[name],
                "measured": datetime.now(UTC).isoformat(timespec="seconds"),
                "took_s": round(took_s, 1),
                "short": short,
                "seed": seed,
                "machine": machine,
                "packages": _packages(),
                "rows": [as_json(row) for row in rows],
            }
            _keep(file, name, found)
    if file is not None:
        console.print(f"The figures are in {file}.")
    if failed:
        raise click.ClickException(f"these have failed: {', '.join(failed)}")


def _run(name: str, short: bool, seed: int) -> tuple[list[Row], str]:
    """Run one benchmark in a process of its own, as if it were started alone.

    Returns:
        Its rows, and why it yielded no more; empty if it is complete.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_measure, args=(name, short, seed, sender), name=name)
    process.start()
    sender.close()
    rows: list[Row] = []
    try:
        error = ""
        for found in _received(receiver):
            if isinstance(found, Row):
                rows.append(found)
            else:
                error = found
    except TimeoutError:
        error = f"It took longer than {LIMIT_S:.0f} s."
        os.kill(process.pid, signal.SIGINT)
    finally:
        _end(process)
    return rows, error or ("" if rows else f"{name} has no figures")


def _received(receiver: Connection) -> Iterator[Row | str]:
    """Yield the messages of a benchmark until it is complete.

    Raises:
        TimeoutError: The benchmark exceeds its time limit.
    """
    limit = time.monotonic() + LIMIT_S
    try:
        while receiver.poll(max(0.0, limit - time.monotonic())):
            found = receiver.recv()
            if found is None:
                return
            yield found
    except EOFError:
        yield "Its process has ended too early."
    else:
        raise TimeoutError


def _end(process: Any) -> None:
    """Let a benchmark end; interrupt it if it does not, so that it ends its own processes."""
    process.join(STOP_S)
    if process.is_alive():
        os.kill(process.pid, signal.SIGINT)
        process.join(STOP_S)
    if process.is_alive():
        process.kill()
        process.join()


def _measure(name: str, short: bool, seed: int, sender: Connection) -> None:
    # Background processes of a shell ignore it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    random = Random(seed)
    effort = Effort(random=random, **SHORT) if short else Effort(random=random)  # type: ignore[arg-type]
    try:
        for row in importlib.import_module(name).measure(effort):
            sender.send(row)
    except Exception:
        sender.send(traceback.format_exc())
    sender.send(None)


def _machine() -> dict[str, str]:
    """Return a description of the machine and its software."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
        models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        model = models[0] if models else model
    return {
        "cpu": model,
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "load": " ".join(f"{load:.2f}" for load in os.getloadavg()),
    }


def _packages() -> dict[str, str]:
    """Return the versions of the installed packages among those compared."""
    found = {}
    for name in COMPARED:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _keep(file: Path, name: str, found: dict[str, Any]) -> None:
    """Put the figures of one benchmark into a file, in the order of the benchmarks."""
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    kept[name] = found
    ordered = {name: kept[name] for name in BENCHMARKS if name in kept}
    file.write_text(json.dumps(ordered, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
