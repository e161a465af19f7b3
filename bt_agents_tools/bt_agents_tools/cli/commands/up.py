# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents up`: the agents of a trees folder until Ctrl-C."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import click

from bt_agents_core.state_folder import claim_state, state_home
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.run_system import journal_components, journal_option, run_system
from bt_agents_tools.cli.trees_choice import state_option, take_trees
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.former_state import adopt_former_state
from bt_agents_tools.launcher.log_files import new_log_folder


@click.command()
@click.argument("directory", required=False, default="")
@click.option("--robot/--no-robot", default=True, help="Start the simulated robot.")
@click.option("--tags", default="", help="Only agents with one of these tags, as in a,b.")
@click.option("--language", default="", help="Language of the texts; else that of scene.yaml.")
@click.option("--bindings", default="", help="Robot whose bindings of skills are preferred.")
@click.option("--voice/--no-voice", default=True, help="Speak aloud when espeak-ng is installed.")
@state_option
@click.option("--ledger", default="", help="Another file of the learned profiles.")
@click.option(
    "--memory",
    is_flag=False,
    flag_value="",
    metavar="[FILE]",
    help="Keep measurements of known persons, in this FILE or in the state folder.",
)
@click.option(
    "--on-new-scene",
    type=click.Choice(["queue", "reject", "preempt"]),
    help="What becomes of a scene that comes during a run.  [default: queue]",
)
@click.option("--strategy", default="", help="How bids are ranked; see 'bt-agents strategy'.")
@click.option(
    "--selector",
    default="",
    metavar="URL",
    help="Have a language model rank bids: a server that speaks OpenAI's protocol.",
)
@click.option("--model", default="", help="Name of the model of the selector.")
@click.option(
    "--key-variable", default="", help="Environment variable with the key of that server."
)
@click.option(
    "--params",
    type=click.Path(exists=True, dir_okay=False, resolve_path=True, path_type=Path),
    help="ROS parameter file for all nodes; what 'up' sets by itself wins.",
)
@journal_option
def up(
    directory: str,
    robot: bool,
    tags: str,
    language: str,
    bindings: str,
    voice: bool,
    state: str,
    ledger: str,
    memory: str | None,
    on_new_scene: str | None,
    strategy: str,
    selector: str,
    model: str,
    key_variable: str,
    params: Path | None,
    journal: str | None,
) -> None:
    """Keep the agents of a trees DIRECTORY running.

    In another terminal: bt-agents trigger age=4.5 mood=2, sense, cancel, status, why, feedback.
    """
    if bool(selector) != bool(model):
        raise click.UsageError("--selector and --model go together: the server, and its model")
    interrupt = Interrupt()
    trees = take_trees(directory)
    kept = claim_state(trees, state)
    click.echo(f"kept in {kept.path}", err=True)
    for note in (kept.note, adopt_former_state(kept, state_home(), lambda: _agents(trees))):
        if note:
            click.echo(note, err=True)
    profiles = ledger or str(kept.ledger)
    memory = str(kept.memory) if memory == "" else memory or ""
    if memory and Path(memory).resolve() == Path(profiles).resolve():
        raise click.UsageError("--memory names the ledger; it needs a file of its own")
    logs = new_log_folder(state)
    processes = [
        components.market(
            trees,
            on_new_scene or "",
            strategy or ("external" if selector else ""),
            orders=str(kept.orders),
            scenes=str(kept.scenes),
        ),
        components.scene_layer(trees, memory=memory),
        components.host(trees, tags, bindings, str(kept.tunings), language, str(kept.open_goals)),
        components.feedback(trees, ledger=profiles),
    ]
    if selector:
        # The other processes inherit the environment of this one.
        key = os.environ.pop(key_variable, "")
        processes.append(components.selector(trees, selector, model, key_variable, key))
        if strategy not in ("", "external"):
            click.echo(f"{strategy} ranks; 'bt-agents strategy external' has the selector asked")
    if robot:
        processes.append(components.robot(pace=1.0, voice="auto" if voice else "off"))
    processes += journal_components(journal, kept)
    processes = [replace(component, file=params) for component in processes]
    run_system("up", processes, trees, tags, interrupt, logs=logs)


def _agents(trees: Path) -> set[str]:
    found = read_trees(trees)
    return {one.name for one in found.agents} | {one.file.stem for one in found.broken}
