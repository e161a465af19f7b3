# SPDX-License-Identifier: Apache-2.0
"""Draws flame graphs of the demo and of 1,000 rounds: where the processes of a system compute.

``.venv/bin/python benchmarks/flames.py`` writes them into ``docs/figures``.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from processes import graphs
from rounds import System

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs" / "figures"

ROUNDS = 1000
"""Each from a scene to the end of the winner's tree."""

AGENTS = 10
"""That bid in each of the rounds."""

DEMO_RATE, ROUNDS_RATE = 30, 50
"""Samples of each process a second; the more, the larger a graph."""

END_S = 30.0
"""How long drawing takes at most [s]."""


@click.command()
@click.argument("folder", default=FIGURES, type=click.Path(path_type=Path, exists=True))
def main(folder: Path) -> None:
    """Draw both into a FOLDER."""
    demo(folder / "flame_demo.svg")
    rounds(folder / "flame_rounds.svg")


def demo(file: Path) -> None:
    """Play the demo to its end; draw it from its first scene on."""
    command = [sys.executable, "-m", "bt_agents_tools.cli", "demo", "--no-voice"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as playing:
        assert playing.stdout is not None
        try:
            for line in playing.stdout:
                if "scene" in line:
                    break
            with _drawn(file, DEMO_RATE, playing.pid):
                for _ in playing.stdout:
                    pass
        finally:
            playing.send_signal(signal.SIGINT)


def rounds(file: Path) -> None:
    """Hold the rounds, each of which ends with a tree that has run; draw them."""
    with graphs() as make:
        one = System(make("flames"), [AGENTS], layer=True)
        one.until_ready()
        with _drawn(file, ROUNDS_RATE, os.getpid()):
            for _ in range(ROUNDS):
                one.first_tick()


@contextmanager
def _drawn(file: Path, rate: int, pid: int) -> Iterator[None]:
    """Sample a process and those below it meanwhile, and draw that."""
    sampler = subprocess.Popen(
        [
            str(Path(sys.executable).with_name("py-spy")), "record", "--subprocesses",
            "--function", "--rate", str(rate), "--output", str(file), "--pid", str(pid),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        yield
    finally:
        sampler.send_signal(signal.SIGINT)
        try:
            _, said = sampler.communicate(timeout=END_S)
        finally:
            sampler.kill()
        click.echo(said.decode().strip())
    if sampler.returncode:
        raise click.ClickException(f"{file} could not be drawn")
    text = file.read_text(encoding="utf-8").replace(f"{ROOT}/", "")
    # Words that do not fit into a bar are cut.
    text = re.sub(r"(process \d+:&quot;)/[^<]*\.\.<", r"\1..<", text)
    file.write_text(text, encoding="utf-8")
    click.echo(f"{file}, {file.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
