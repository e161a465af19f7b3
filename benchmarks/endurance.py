# SPDX-License-Identifier: Apache-2.0
"""Cancels runs of a host in another process until one stalls: ``endurance.py 10000``."""

from __future__ import annotations

import random
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import click

from bt_agents_tools.launcher import components
from processes import graphs, write_trees
from run_probes import SETTLE_S, Market, Runs

STALL_S = 2.0
"""A cancel that takes longer has stalled [s]."""

_TOLD_EVERY = 1000


@click.command()
@click.argument("number", type=click.IntRange(1), default=10_000)
@click.option("--seed", default=1, show_default=True, help="Of the times of the cancels.")
def main(number: int, seed: int) -> None:
    """Cancel a NUMBER of runs, each up to 5 ms after it has begun."""
    pauses = random.Random(seed)
    worst_s = 0.0
    began = time.monotonic()
    with graphs() as make:
        graph = make("endurance")
        trees = write_trees(graph.folder / "trees", {"lone": "\n  wait: 1 h"})
        market = Market(graph)
        graph.start(components.host(trees))
        graph.until_up()
        runs = Runs(graph, market, "agents")
        graph.rest(SETTLE_S)
        for done in range(1, number + 1):
            handle = runs.start("lone")
            graph.rest(pauses.uniform(0.0, 0.005))
            worst_s = max(worst_s, runs.cancel(handle))
            if worst_s > STALL_S:
                raise click.ClickException(f"cancel {done} took {worst_s:.1f} s")
            if done % _TOLD_EVERY == 0 or done == number:
                took_s = time.monotonic() - began
                click.echo(f"{done} cancels in {took_s:.0f} s, the slowest {worst_s * 1e3:.0f} ms")


if __name__ == "__main__":
    main()
