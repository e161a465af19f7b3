# SPDX-License-Identifier: Apache-2.0
"""Runs the benchmarks, each in a process of its own; prints a table and writes JSON."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import platform
import statistics
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from random import Random
from typing import Any

import click
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

from measuring import Effort, Row

BENCHMARKS = {
    "ticking": "ticks of trees, beside stock py_trees and other engines",
    "tracing": "what collecting status changes and recording a run cost",
    "reading": "agent files: reading, checking, building; hostile ones",
    "expressions": "expressions, beside Python lambdas",
    "ranking": "ranking of bids, beside numpy and plain Python",
    "ledger": "durable changes of profiles, beside bare SQLite",
    "sweep": "simulated experiments",
    "executors": "hops between nodes by executor, idle cost",
    "rounds": "scene to first tick, bidding with many agents and hosts",
    "runs": "cancel, results of leaves, feedback, the full cycle",
    "ageing": "whether the thousandth goal and round is as quick as the first",
    "footprint": "idle CPU, memory, discovery",
}
"""Module → what it measures; its ``measure(effort)`` gives rows."""

LIMIT_S = 900.0
"""One benchmark does not take longer [s]."""


@click.command()
@click.argument("names", nargs=-1)
@click.option(
    "--short", is_flag=True, help="See only whether they work: the figures mean nothing."
)
@click.option("--json", "file", type=click.Path(path_type=Path), help="Where the figures go.")
@click.option("--seed", default=1, show_default=True, help="Of the order of measurements.")
def main(names: tuple[str, ...], short: bool, file: Path | None, seed: int) -> None:
    """Run the benchmarks of these NAMES, or all."""
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        raise click.UsageError(f"no benchmark '{unknown[0]}'; there are {', '.join(BENCHMARKS)}")
    console = Console(width=None if sys.stdout.isatty() else 150)
    machine = _machine()
    console.print(", ".join(f"{key} {value}" for key, value in machine.items()))
    found: dict[str, list[dict[str, Any]]] = {}
    failed = []
    for name in names or BENCHMARKS:
        began = time.monotonic()
        rows = _run(name, short, seed)
        if rows is None:
            failed.append(name)
            continue
        found[name] = [_as_json(row) for row in rows]
        console.print(_table(name, rows, time.monotonic() - began))
    if file is not None:
        text = json.dumps({"machine": machine, "short": short, "benchmarks": found}, indent=1)
        file.write_text(text + "\n", encoding="utf-8")
    if failed:
        raise click.ClickException(f"these gave no figures: {', '.join(failed)}")


def _run(name: str, short: bool, seed: int) -> list[Row] | None:
    """Run one benchmark in a process of its own, as if it had been started alone."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_measure, args=(name, short, seed, sender), name=name)
    process.start()
    sender.close()
    rows: list[Row] | None = None
    try:
        if receiver.poll(LIMIT_S):
            rows = receiver.recv()
    except EOFError:
        pass
    finally:
        process.join(10.0)
        if process.is_alive():
            process.kill()
            process.join()
    return rows


def _measure(name: str, short: bool, seed: int, sender: Any) -> None:
    random = Random(seed)
    effort = Effort(repetitions=2, scale=0.01, random=random) if short else Effort(random=random)
    rows: Iterable[Row] = importlib.import_module(name).measure(effort)
    sender.send(list(rows))


def _machine() -> dict[str, str]:
    """Return what the figures were measured on."""
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


def _as_json(row: Row) -> dict[str, Any]:
    return {**asdict(row), "ratio": row.ratio, "met": row.is_met}


def _table(name: str, rows: list[Row], took_s: float) -> Table:
    table = Table(title=f"{name}: {BENCHMARKS[name]} ({took_s:.0f} s)", title_justify="left")
    for column in (
        "what",
        "who",
        "median [least … most]",
        "floor",
        "ratio [least … most]",
        "goal",
    ):
        table.add_column(column)
    for row in rows:
        pace = f", {row.pace}" if row.pace else ""
        floor = f"{row.floor} {_amount(row.floor_values, row.unit)}" if row.floor else ""
        table.add_row(
            row.case + pace,
            row.side,
            _spread(row.values, row.unit),
            floor,
            _ratio(row),
            _goal(row),
        )
        if row.note:
            table.add_row("", f"[dim]{row.note}[/dim]")
    return table


def _amount(values: Iterable[float], unit: str) -> str:
    return _number(statistics.median(values), unit)


def _spread(values: Iterable[float], unit: str) -> str:
    values = list(values)
    least, most = _number(min(values), unit), _number(max(values), unit)
    return f"{_number(statistics.median(values), unit)} [{least} … {most}]"


def _number(value: float, unit: str) -> str:
    if unit == "s":
        for factor, word in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
            if value * factor >= 1 or word == "µs":
                return f"{value * factor:.3g} {word}"
    return f"{value:.4g} {unit}"


def _ratio(row: Row) -> str:
    if row.ratio is None:
        return ""
    return f"{row.ratio:.3g} [{min(row.ratios):.3g} … {max(row.ratios):.3g}]"


def _goal(row: Row) -> str:
    if row.goal is None:
        return ""
    bound = "≥" if row.at_least else "≤"
    return f"{bound} {row.goal:g} {'met' if row.is_met else '[bold]missed[/bold]'}"


if __name__ == "__main__":
    main()
