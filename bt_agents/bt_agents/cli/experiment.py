# SPDX-License-Identifier: Apache-2.0
"""`bt-agents experiment`: the paper's experiments through the real ROS graph."""

from __future__ import annotations

import csv
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from bt_agents.cli import system
from bt_agents.cli.supervisor import Component, Supervisor, keep_local
from bt_agents.domain import reserve_domain
from bt_agents.errors import BtAgentsError
from bt_agents.experiment import ExperimentSpec, Record, deviation
from bt_agents.interrupt import Interrupt
from bt_agents.language.experiment_reader import read_experiment
from bt_agents.language.folder_reader import Trees, read_trees
from bt_agents.scene import SceneSpace, Vector
from bt_agents.trees_folder import find_experiment

TOLERANCE = 1e-9
_STALL_S = 30.0
_LOOK_S = 0.2


class _Recorder:
    """Joins decisions and feedback to one record a round."""

    def __init__(self) -> None:
        self.records: list[Record] = []
        self._scenes: dict[int, Vector] = {}

    def auction(self, message: Any) -> None:
        self._scenes[message.round] = tuple(value.value for value in message.scene.values)

    def feedback(self, message: Any) -> None:
        self.records.append(
            Record(
                round=message.round,
                scene=self._scenes.get(message.round, ()),
                winner=message.agent,
                before=tuple(message.before),
                after=tuple(message.after),
            )
        )


@click.command()
@click.argument("name")
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), help="Write every round here.")
@click.option("--seed", type=int, help="Another seed for the order of the scenes.")
def experiment(name: str, csv_file: Path | None, seed: int | None) -> None:
    """Run experiment NAME through the real ROS graph.

    NAME is 1 or 3, as in the paper, or a folder. Every recorded profile is compared with the
    closed form of the learning rule.
    """
    interrupt = Interrupt()
    folder_path = find_experiment(name)
    folder = read_trees(folder_path)
    if folder.broken:
        raise BtAgentsError(folder.broken[0].error.report)
    spec = read_experiment(folder_path / "experiment.yaml", folder.scene.space)
    if seed is not None:
        spec = replace(spec, seed=seed)
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    keep_local(os.environ)
    start = time.monotonic()
    records = _through_ros(folder_path, folder, spec, interrupt)
    if interrupt:
        click.echo("stopped")
        return
    if csv_file is not None:
        try:
            _write_csv(csv_file, records, folder.scene.space)
        except OSError as error:
            click.echo(f"error: {csv_file} cannot be written: {error.strerror}", err=True)
    sys.exit(_report(folder, spec, records, time.monotonic() - start))


def _through_ros(
    path: Path, folder: Trees, spec: ExperimentSpec, interrupt: Interrupt
) -> list[Record]:
    with tempfile.TemporaryDirectory(prefix="bt-agents-experiment-") as scratch:
        script = Path(scratch) / "script.yaml"
        script.write_text(_script(spec, folder.scene.space))
        supervisor = Supervisor(system.new_log_folder())
        try:
            supervisor.start(
                system.market(path),
                system.host(path),
                system.feedback(path, ledger=":memory:", simulated=path / "experiment.yaml"),
            )
            scenes = system.scene_layer(path, script, agents=len(folder.agents))
            return _record(supervisor, scenes, len(folder.agents), spec, interrupt)
        finally:
            supervisor.stop()


def _record(
    supervisor: Supervisor,
    scenes: Component,
    agents: int,
    spec: ExperimentSpec,
    interrupt: Interrupt,
) -> list[Record]:
    from bt_agents.ros import client
    from bt_agents.ros.observer import Observer

    observer = Observer()
    recorder = _Recorder()
    client.record(observer, recorder.auction, recorder.feedback)
    try:
        observer.turn_until(
            lambda: bool(interrupt or supervisor.dead()) or observer.ready(agents), _STALL_S
        )
        if not interrupt and not observer.ready(agents):
            raise BtAgentsError(
                supervisor.dead()
                or f"not ready after {_STALL_S:g} s; the logs are in "
                f"{supervisor.log('agents').parent}"
            )
        supervisor.start(scenes)
        with Progress(transient=True) as progress:
            task = progress.add_task(spec.title, total=spec.rounds)
            last_change = time.monotonic()
            while len(recorder.records) < spec.rounds and not interrupt:
                before = len(recorder.records)
                observer.turn_until(lambda: len(recorder.records) >= spec.rounds, _LOOK_S)
                progress.update(task, completed=len(recorder.records))
                if len(recorder.records) > before:
                    last_change = time.monotonic()
                if supervisor.dead():
                    raise BtAgentsError(supervisor.dead())
                if time.monotonic() - last_change > _STALL_S:
                    raise BtAgentsError(
                        f"no round for {_STALL_S:g} s after {before} of {spec.rounds}; the logs "
                        f"are in {supervisor.log('agents').parent}"
                    )
        return recorder.records
    finally:
        observer.close()


def _script(spec: ExperimentSpec, space: SceneSpace) -> str:
    lines = ["format: 1", "title: an experiment", "visits:"]
    for number, vector in enumerate(spec.order(), start=1):
        scene = ", ".join(f"{n}: {v!r}" for n, v in zip(space.names, vector, strict=True))
        lines.append(f"  - {{label: scene {number}, scene: {{{scene}}}}}")
    return "\n".join(lines) + "\n"


def _write_csv(path: Path, records: Sequence[Record], space: SceneSpace) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        names = space.names
        writer.writerow(
            ["round", "winner"]
            + [f"scene_{n}" for n in names]
            + [f"before_{n}" for n in names]
            + [f"after_{n}" for n in names]
        )
        for record in records:
            row = [*record.scene, *record.before, *record.after]
            writer.writerow([record.round, record.winner, *(repr(value) for value in row)])


def _report(folder: Trees, spec: ExperimentSpec, records: Sequence[Record], seconds: float) -> int:
    console = Console()
    starts = {agent.name: agent.profile for agent in folder.agents}
    rates = {agent.name: agent.learning_rate for agent in folder.agents}
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("agent", "won", "profile at the start", "profile at the end", "feedback"):
        table.add_column(title)
    for name, start in starts.items():
        mine = [record for record in records if record.winner == name]
        target = spec.feedback.each.get(name, ())
        end = mine[-1].after if mine else start
        table.add_row(name, str(len(mine)), *(_row(v) for v in (start, end, target)))
    console.print(f"{spec.title}: {spec.rounds} rounds, seed {spec.seed}, {seconds:.1f} s")
    console.print(table)
    orders = tuple(record.scene for record in records) == spec.order()
    if not orders:
        console.print("[red]the scenes did not come in the order that was drawn[/]")
    if set(spec.feedback.each) != set(starts):
        return 0 if orders else 1
    largest = deviation(records, spec.feedback.each, starts, rates)
    fine = largest <= TOLERANCE
    verdict = "[green]equal[/]" if fine else "[red]not equal[/]"
    console.print(
        f"every recorded profile against p = f + (p0 - f)(1 - rate)^n: {verdict}, largest "
        f"difference {largest:.1e} (allowed {TOLERANCE:g})",
        highlight=False,
    )
    return 0 if fine and orders else 1


def _row(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.4f}" for value in values)
