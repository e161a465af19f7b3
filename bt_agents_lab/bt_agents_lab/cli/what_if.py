# SPDX-License-Identifier: Apache-2.0
"""`bt-agents what-if`: shows the effect of other strategies, learning or agents on a journal."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import Update
from bt_agents_core.text import format_known, printable, printable_lines
from bt_agents_core.trees_folder import find_trees
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.assignments import assignments
from bt_agents_tools.cli.table import Column, TableForm, print_json, print_table, table_options

with loading():
    from bt_agents_lab.cli.journal import damage_reported, read_files, show_problems
    from bt_agents_lab.replay.counterfactual_replay import (
        ASSUMED,
        OTHERS_ASSUMED,
        Changes,
        CounterfactualResult,
        RoundComparison,
        replay_with,
    )
    from bt_agents_lab.replay.recording_index import RecordingIndex
    from bt_agents_language.files.folder_reader import Trees, read_trees
    from marketplace_node.strategies.plugins import add_installed

_NOBODY = "nobody"


@click.command()
@click.argument("words", nargs=-1, metavar="[FILES]... [OPTIONS]...")
@click.option("--strategy", default="", help="Rank by this strategy.")
@click.option("--learning-rate", type=click.FloatRange(0.0, 1.0), help="Of every agent.")
@click.option(
    "--update", type=click.Choice([one.value for one in Update]), help="How profiles learn."
)
@click.option("--agents", default="", metavar="DIR", help="The agents of this trees folder bid.")
@click.option("--tags", default="", help="Only agents of --agents with one of these tags.")
@click.option("--all", "everything", is_flag=True, help="Show unchanged rounds, too.")
@table_options
@click.pass_context
def what_if(
    context: click.Context,
    words: tuple[str, ...],
    strategy: str,
    learning_rate: float | None,
    update: str | None,
    agents: str,
    tags: str,
    everything: bool,
    form: TableForm,
) -> None:
    """Show what the FILES of a journal would hold if something had been different.

    OPTIONS belong to the strategy: bt-agents what-if --strategy softmax temperature=0.3
    """
    files = tuple(Path(word) for word in words if "=" not in word or Path(word).exists())
    options = [word for word in words if Path(word) not in files]
    if tags and not agents:
        raise BtAgentsError("tags choose among other agents; name their folder with --agents")
    add_installed()
    trees = _trees(agents, tags) if agents else None
    changes = Changes(
        strategy=strategy,
        options=dict(assignments(context, context.command.params[0], tuple(options))),
        rate=learning_rate,
        update=Update(update) if update else None,
        agents=trees.agents if trees is not None else None,
    )
    changes.check()
    recording = read_files(files)
    if not recording.rounds:
        raise BtAgentsError("there is no round of a market in it")
    if trees is not None:
        _check_parameters(recording, trees)
    with damage_reported():
        result = replay_with(recording, changes)
    assumed = (*ASSUMED, OTHERS_ASSUMED) if agents and not tags else ASSUMED
    console = Console(stderr=form.for_program, highlight=False, soft_wrap=True)
    show_problems(console, recording)
    if form is TableForm.CSV:
        rows = [_as_row(case) for case in result.rounds]
        columns = [Column(key=key) for key in rows[0]]
        print_table(columns, [list(row.values()) for row in rows], form)
        return
    if form is TableForm.JSON:
        print_json(_as_data(result, assumed))
        return
    _show(console, result, everything, form)
    for assumption in assumed:
        console.print(f"[dim]{assumption}[/]")


def _trees(folder: str, tags: str) -> Trees:
    """Return the agents of a trees folder; print what makes others unreadable."""
    trees = read_trees(find_trees(folder)).tagged(tags)
    if trees.broken:
        click.echo(printable_lines(trees.report), err=True)
    if not trees.agents:
        raise BtAgentsError(f"there is no agent that can be read in {folder}")
    return trees


def _check_parameters(recording: RecordingIndex, trees: Trees) -> None:
    """Check that profiles have the values of those in the recording, in the same order."""
    names = trees.scene.space.profiles.names
    spaces = [one.space for one in recording.rounds]
    for space in (*spaces, *(one.space for one in recording.feedbacks)):
        if space is not None and space.profiles.names != names:
            raise BtAgentsError(
                f"profiles have {', '.join(space.profiles.names)} in the recording, and "
                f"{', '.join(names)} in {trees.folder}; name a folder with the same parameters "
                "in the same order"
            )


def _show(
    console: Console, result: CounterfactualResult, everything: bool, form: TableForm
) -> None:
    shown = [case for case in result.rounds if everything or case.problem or case.was != case.now]
    if shown:
        print_table(_COLUMNS, [_row(case) for case in shown], form)
    console.print(
        f"{result.other_winners} of {len(result.rounds)} rounds would have had another winner; "
        f"{result.given} of {result.given + result.withheld} feedbacks would have been given"
    )
    for agent, number in sorted(result.chosen.items(), key=lambda item: (-item[1], item[0])):
        console.print(f"  {escape(printable(agent))} {number}")
    if result.never:
        never = printable(", ".join(result.never))
        console.print(f"never chosen: {escape(never)}", soft_wrap=False)


_COLUMNS = (
    Column(key="round", right=True),
    Column(key="scene"),
    Column(key="was", title="winner then"),
    Column(key="now", title="and now"),
    Column(key="margin_was", title="margin", text=format_known, right=True),
    Column(key="margin_now", title="and now", text=format_known, right=True),
)


def _row(case: RoundComparison) -> tuple[object, ...]:
    now = case.problem or case.now or _NOBODY
    margins = (case.margin_was, case.margin_now)
    return (case.round, case.label, case.was or _NOBODY, now, *margins)


def _as_row(case: RoundComparison) -> dict[str, object]:
    return {
        "epoch": printable(case.epoch),
        "round": case.round,
        "scene": printable(case.label),
        "was": printable(case.was),
        "now": printable(case.now),
        "margin_was": case.margin_was,
        "margin_now": case.margin_now,
        "problem": printable(case.problem),
    }


def _as_data(result: CounterfactualResult, assumed: tuple[str, ...]) -> dict[str, object]:
    return {
        "rounds": [_as_row(case) for case in result.rounds],
        "other_winner": result.other_winners,
        "chosen": dict(result.chosen),
        "never_chosen": list(result.never),
        "feedback_given": result.given,
        "feedback_withheld": result.withheld,
        "profiles": {agent: list(profile) for agent, profile in result.profiles.items()},
        "assumed": list(assumed),
    }
