# SPDX-License-Identifier: Apache-2.0
"""`bt-agents experiment run|plot|sweep`: the paper's experiments, and sweeps beyond them."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import LearningRule
from bt_agents_core.trees_folder import find_experiments, find_sweep
from bt_agents_lab.experiments.replicas import opened, with_seed
from bt_agents_lab.results import ResultFile, ResultRow
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.experiment import (
    ExperimentSpec,
    FeedbackRecord,
    deviation,
    difference,
)
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.assignments import Assignments, assignments
from bt_agents_tools.cli.formatting import progress_bar
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options
from marketplace_node.settings import Settings
from marketplace_node.strategies.plugins import add_installed

if TYPE_CHECKING:
    from bt_agents_lab.experiments.sweep_figures import Played

TOLERANCE = 1e-12
"""Largest difference that rounding may make between two ways to compute a profile."""


@click.group()
def experiment() -> None:
    """Repeat the paper's experiments, and go beyond them."""


@experiment.command()
@click.argument("name")
@click.argument("options", nargs=-1, callback=assignments)
@click.option(
    "--ros",
    is_flag=True,
    help="Also run on the real ROS graph, and compare each round with the run without ROS.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Write every round, bid and feedback to FILE.csv or FILE.parquet.",
)
@click.option("--seed", type=int, help="Seed of all random choices.")
@click.option("--rounds", type=click.IntRange(1), help="Number of rounds.")
@click.option("--strategy", default="manhattan", show_default=True, help="Who gets a scene.")
@click.option("--tie-break", default="least_recently_run", show_default=True)
@table_options
def run(
    name: str,
    options: Assignments,
    ros: bool,
    out: Path | None,
    seed: int | None,
    rounds: int | None,
    strategy: str,
    tie_break: str,
    form: TableForm,
) -> None:
    """Run experiment NAME and compare every profile with the closed form of the learning rule.

    NAME is 1, 2 or 3, as in the paper, or a folder. OPTIONS belong to the strategy, such as
    temperature=0.3.
    """
    from bt_agents_lab.experiments.core import through_core

    for problem in add_installed():
        click.echo(problem, err=True)
    of_strategy = {f"{strategy}.{option}": value for option, value in options}
    settings = Settings(strategy=strategy, tie_break=tie_break, options=of_strategy)
    fine = True
    folders = find_experiments(name)
    files = {path: _file_of(path, folders, out) for path in folders}
    console = Console(stderr=form.for_program)
    agents: list[_AgentResult] = []
    for path in folders:
        folder, spec = opened(path)
        if seed is not None:
            spec = with_seed(spec, seed)
        if rounds is not None:
            spec = spec.shortened(rounds)
        start = time.monotonic()
        rows: list[ResultRow] = []
        records = through_core(folder, spec, settings, rows.append)
        seconds = time.monotonic() - start
        agree = True
        if ros:
            from bt_agents_lab.cli.through_ros import through_ros

            rows = []
            real = through_ros(folder, spec, settings, rows.append)
            seconds = time.monotonic() - start
            what = f"{len(real)} rounds through ROS against {len(records)} without it"
            agree = _is_equal(console, what, difference(records, real))
            records = real
        if (file := files[path]) is not None:
            file.write(folder.scene.space.names, rows)
            console.print(f"written to {escape(str(file.path))}", highlight=False, soft_wrap=True)
        agents += (found := _agent_results(path.name, folder, spec, records))
        console.print(f"{spec.title}: {spec.rounds} rounds, seed {spec.seed}, {seconds:.1f} s")
        if not form.for_program:
            _print_agents(found, form)
        fine = _judge(console, folder, spec, records) and agree and fine
    if form.for_program:
        _print_agents(agents, form)
    sys.exit(0 if fine else 1)


@experiment.command()
@click.argument("name", default="all")
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("figures"),
    show_default=True,
    help="Folder for figures and verdicts.",
)
@click.option(
    "--seeds",
    type=click.IntRange(2),
    default=200,
    show_default=True,
    help="Number of runs for bands and verdicts.",
)
def plot(name: str, output: Path, seeds: int) -> None:
    """Draw the paper's figures 5 to 9 anew, and judge what it claims.

    NAME is 1, 2, 3 or all. Figures come as SVG and PNG, verdicts as Markdown and JSON.
    """
    with loading():
        from bt_agents_lab.experiments import claims, drawing, paper_figures, verdicts

    steps = {"1": 2, "2": 2, "3": 3, "all": 7}
    if name not in steps:
        raise BtAgentsError(f"no figures of '{name}'; there are figures of 1, 2, 3 and all")

    def paper(folder: str) -> claims.Paper:
        trees, spec = opened(find_experiments(folder)[0])
        return claims.Paper(folder=trees, spec=spec)

    runs = range(seeds)
    judged = []
    drawing.make_folder(output)

    def drawn_and_judged() -> Iterator[None]:
        """Yield after each step."""
        if name in ("1", "all"):
            one = paper("1")
            paper_figures.first(output, one)
            yield
            judged.extend(claims.first(one))
            yield
        if name in ("2", "all"):
            arms = {arm: paper(f"2-{arm}") for arm in claims.RATES}
            paper_figures.second(output, arms, runs)
            yield
            judged.extend(claims.second(arms, runs))
            yield
        if name in ("3", "all"):
            three = paper("3")
            many = claims.played_third(three, runs)
            yield
            paper_figures.third(output, many, three.spec.rounds)
            yield
            judged.extend(claims.third(many))
            yield

    console = Console()
    with progress_bar() as progress:
        done = drawn_and_judged()
        for _ in progress.track(done, steps[name], description="drawing and judging"):
            pass
        stem = "verdicts" if name == "all" else f"verdicts-{name}"
        with drawing.writing_into(output):
            (output / f"{stem}.md").write_text(verdicts.as_markdown(judged), encoding="utf-8")
            (output / f"{stem}.json").write_text(verdicts.as_json(judged), encoding="utf-8")
    for verdict in judged:
        console.print(f"{verdict.claim.name}: {verdict.text}", highlight=False)
    console.print(f"written to {output}", highlight=False)


@experiment.command()
@click.argument("name")
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for table, CSV, JSON and figures; left out: the table is only printed.",
)
@click.option(
    "--processes", type=click.IntRange(1), help="Number of processes; default: all cores."
)
@click.option("--runs", type=click.IntRange(1), help="Number of runs.")
@click.option("--rounds", type=click.IntRange(1), help="Number of rounds.")
@click.option("--seed", type=click.IntRange(0), help="Seed of the first run.")
@table_options
def sweep(
    name: str,
    output: Path | None,
    processes: int | None,
    runs: int | None,
    rounds: int | None,
    seed: int | None,
    form: TableForm,
) -> None:
    """Compare ways to select and to learn over many simulated runs.

    NAME is one of experiments/sweeps, such as told, or a file. The same seed gives the same
    numbers, in however many processes.
    """
    with loading():
        from bt_agents_lab.experiments import drawing, sweep_figures
        from bt_agents_lab.experiments import sweep as sweeping
        from bt_agents_lab.experiments.sweep_reader import read_sweep

    spec = read_sweep(find_sweep(name))
    spec = replace(
        spec,
        runs=spec.runs if runs is None else runs,
        rounds=spec.rounds if rounds is None else rounds,
        seed=spec.seed if seed is None else seed,
    )
    if output is not None:
        drawing.make_folder(output)
    start = time.monotonic()
    with progress_bar() as progress:
        task = progress.add_task(spec.title, total=None)
        played = sweeping.sweep(
            spec,
            processes or os.cpu_count() or 1,
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    seconds = time.monotonic() - start
    # If a program reads the table, messages go where people still see them.
    aside = form.for_program
    click.echo(spec.title, err=aside)
    _print_sweep(played, form)
    click.echo(
        f"{len(played)} ways, {spec.runs} runs of {spec.rounds} rounds each, seeds {spec.seed} to "
        f"{spec.seed + spec.runs - 1}: {seconds:.1f} s; *: best for its share of wrong feedback",
        err=aside,
    )
    if output is not None:
        sweep_figures.write(output, spec, played)
        click.echo(f"written to {output}", err=aside)


_BEST = " *"
_SHOWN = ("wrong", "right", "worst", "starved", "regret", "settles")


def _print_sweep(played: Played, form: TableForm) -> None:
    """Print a few measures as text for people, or all as numbers for a program."""
    from bt_agents_lab.experiments.measures import summary
    from bt_agents_lab.experiments.sweep import rule_label
    from bt_agents_lab.experiments.sweep_figures import best_cells, cells, measured

    best = best_cells(played)

    if form.for_program:
        numbers = [measured(cell, summary(found), cell in best) for cell, found in played]
        columns = [Column(key=key) for key in numbers[0]]
        print_table(columns, [list(one.values()) for one in numbers], form)
        return
    columns = [Column(key="strategy"), Column(key="update")]
    columns += [Column(key=key, right=True) for key in _SHOWN]
    rows = []
    for cell, found in played:
        texts = cells(cell, summary(found))
        label = f"{cell.selection.label}{_BEST if cell in best else ''}"
        rows.append([label, rule_label(cell.learning), *(texts[key] for key in _SHOWN)])
    print_table(columns, rows, form)


def _is_equal(console: Console, what: str, largest: float) -> bool:
    """Print whether the largest difference is only of rounding, and return it."""
    fine = largest <= TOLERANCE
    verdict = "[green]equal[/]" if fine else "[red]not equal[/]"
    found = f"largest difference {largest:.1e} (allowed {TOLERANCE:g})"
    console.print(f"{what}: {verdict}, {found}", highlight=False)
    return fine


def _file_of(folder: Path, folders: Sequence[Path], out: Path | None) -> ResultFile | None:
    """Return the file for the results of one experiment, after making sure it is writable."""
    if out is None:
        return None
    apart = out.with_name(f"{out.stem}-{folder.name}{out.suffix}")
    return ResultFile(out if len(folders) == 1 else apart)


@dataclass(frozen=True, kw_only=True)
class _AgentResult:
    """Row of the table of agents, with profiles by parameter."""

    experiment: str
    agent: str
    won: int
    start: Mapping[str, float]
    end: Mapping[str, float]
    feedback: Mapping[str, float]


def _agent_results(
    name: str, folder: Trees, spec: ExperimentSpec, records: Sequence[FeedbackRecord]
) -> list[_AgentResult]:
    names = folder.scene.space.profiles.names

    def known(vector: Sequence[float]) -> dict[str, float]:
        return dict(zip(names, vector, strict=False))

    found = []
    for agent in folder.agents:
        mine = [record for record in records if record.winner == agent.name]
        found.append(
            _AgentResult(
                experiment=name,
                agent=agent.name,
                won=len(mine),
                start=known(agent.profile),
                end=known(mine[-1].after if mine else agent.profile),
                feedback=known(spec.feedback.each.get(agent.name, ())),
            )
        )
    return found


def _print_agents(found: Sequence[_AgentResult], form: TableForm) -> None:
    vectors = {"start": "profile at the start", "end": "profile at the end", "feedback": ""}
    if form.for_program:
        names = list(dict.fromkeys(name for one in found for name in one.start))
        columns = [Column(key=key) for key in ("experiment", "agent", "won")]
        columns += [Column(key=f"{of}_{name}") for of in vectors for name in names]
        rows: list[list[object]] = [
            [one.experiment, one.agent, one.won]
            + [getattr(one, of).get(name) for of in vectors for name in names]
            for one in found
        ]
    else:
        columns = [Column(key="agent"), Column(key="won")]
        columns += [Column(key=of, title=title, text=_row) for of, title in vectors.items()]
        rows = [
            [one.agent, one.won, *(tuple(getattr(one, of).values()) for of in vectors)]
            for one in found
        ]
    print_table(columns, rows, form)


def _judge(
    console: Console, folder: Trees, spec: ExperimentSpec, records: Sequence[FeedbackRecord]
) -> bool:
    """Print whether the profiles match the closed form; return whether nothing differs."""
    starts = {agent.name: agent.profile for agent in folder.agents}
    rates = {agent.name: agent.learning_rate for agent in folder.agents}
    orders = tuple(record.scene for record in records) == spec.order()
    if not orders:
        console.print("[red]the scenes did not come in the order that was drawn[/]")
    winners = {record.winner for record in records}
    if idle := [name for name in starts if name not in winners]:
        console.print(
            f"{', '.join(idle)} never ran, and so learned nothing: a claim that every agent finds "
            "its scenes fails in this run; 'bt-agents experiment plot' judges many runs",
            highlight=False,
        )
    if reason := _no_closed_form(folder, spec):
        console.print(f"not compared with the closed form, as {reason}", highlight=False)
        return orders
    largest = deviation(records, spec.feedback.each, starts, rates)
    what = "every recorded profile against p = f + (p0 - f)(1 - rate)^n"
    return _is_equal(console, what, largest) and orders


def _row(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in values)}]" if values else "-"


def _no_closed_form(folder: Trees, spec: ExperimentSpec) -> str:
    """Return why the profiles do not follow the closed form; empty if they do."""
    if spec.feedback.errors is not None:
        return "some of the feedback is wrong"
    if without := {agent.name for agent in folder.agents} - set(spec.feedback.each):
        return f"{', '.join(sorted(without))} does not get the same feedback after each run"
    if others := [agent.name for agent in folder.agents if agent.learning != LearningRule()]:
        return f"{', '.join(others)} does not learn by the paper's rule"
    return ""
