# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents up`: runs the agents of a trees folder until Ctrl-C."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import click

from bt_agents_core.state_folder import claim_state
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.fleet_plan import fleet_plan
from bt_agents_tools.cli.params_file import params_option
from bt_agents_tools.cli.run_parts import PARTS, join_network, lan_options, named_parts, run_parts
from bt_agents_tools.cli.run_system import (
    journal_components,
    journal_option,
    one_process_option,
    run_system,
    studio_plan,
)
from bt_agents_tools.cli.trees_choice import state_option, take_trees
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.log_files import new_log_folder
from bt_agents_tools.launcher.parameter_file import ParameterFile


@click.command()
@click.argument("directory", required=False, default="")
@click.option(
    "--robot",
    type=click.Choice(["simulated", "browser"]),
    default="simulated",
    show_default=True,
    help="Robot to start; you meet the one in the browser on its page Person.",
)
@click.option("--no-robot", is_flag=True, help="Start no robot, because one runs already.")
@click.option("--studio/--no-studio", default=True, help="Show the system in a browser.")
@click.option("--tags", default="", help="Only agents with one of these tags, as in a,b.")
@click.option(
    "--language", default="", help="Language of the texts; by default the language of scene.yaml."
)
@click.option(
    "--bindings", default="", help="Robots whose bindings of skills are preferred: ros4hri,nav2."
)
@click.option("--voice/--no-voice", default=True, help="Speak aloud when espeak-ng is installed.")
@state_option
@click.option("--ledger", default="", help="File of the learned profiles.")
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
    help="What happens to a scene that arrives during a run.  [default: queue]",
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
@params_option
@one_process_option
@click.option(
    "--only",
    default="",
    metavar="PARTS",
    help="Parts to start, of market, scene, agents, feedback and robot; the others run elsewhere.",
)
@lan_options
@journal_option
@click.option("--no-fleet", is_flag=True, help="Do not share learning with the joined fleet.")
def up(
    directory: str,
    robot: str,
    no_robot: bool,
    studio: bool,
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
    params: ParameterFile | None,
    one_process: bool,
    only: str,
    lan: bool,
    slow_network: float,
    journal: str | None,
    no_fleet: bool,
) -> None:
    """Keep the agents of a trees DIRECTORY running.

    In another terminal: bt-agents trigger age=4.5 mood=2, sense, cancel, status, why, feedback.
    """
    if bool(selector) != bool(model):
        raise click.UsageError("--selector and --model go together: the server, and its model")
    in_browser = robot == "browser"
    if in_browser and (no_robot or not studio):
        raise click.UsageError("--robot browser needs the robot and the studio")
    if in_browser and only:
        raise click.UsageError("--robot browser needs the whole system; leave --only out")
    parts = named_parts(only)
    if no_robot:
        parts -= {"robot"}
    if selector and "market" not in parts:
        raise click.UsageError("--selector ranks for the market; name it in --only, too")
    if not parts:
        raise click.UsageError("--only robot and --no-robot leave nothing to run")
    interrupt = Interrupt()
    trees = take_trees(directory)
    kept = claim_state(trees, state)
    click.echo(f"kept in {kept.path}", err=True)
    if kept.note:
        click.echo(kept.note, err=True)
    profiles = ledger or str(kept.ledger)
    memory = str(kept.memory) if memory == "" else memory or ""
    if memory and Path(memory).resolve() == Path(profiles).resolve():
        raise click.UsageError("--memory names the ledger; it needs a file of its own")
    logs = new_log_folder(state)
    join_network(lan, slow_network)
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
        # In the browser, the robot speaks with the browser's voice.
        components.robot("auto" if voice and not in_browser else "off", needs_screen=in_browser),
    ]
    wanted = {PARTS[part] for part in parts}
    processes = [one for one in processes if one.name in wanted]
    if slow_network != 1.0:
        processes = [components.on_slow_network(one, slow_network) for one in processes]
    if one_process:
        processes = [components.one_process(processes)]
    if selector:
        # The other processes inherit the environment of this one.
        key = os.environ.pop(key_variable, "")
        processes.append(components.selector(trees, selector, model, key_variable, key))
        if strategy not in ("", "external"):
            click.echo(f"{strategy} ranks; 'bt-agents strategy external' has the selector asked")
    processes += journal_components(journal, kept)
    processes = [replace(component, file=params) for component in processes]
    learns_together = "feedback" in parts and not no_fleet
    fleet = fleet_plan(trees, kept.path, profiles) if learns_together else None
    if only:
        run_parts(f"up --only {only}", processes, interrupt, logs, fleet)
        return
    recordings = Path(journal).resolve() if journal else kept.journal
    plan = studio_plan(trees, kept.path, recordings, browser_robot=in_browser) if studio else None
    run_system("up", processes, trees, tags, interrupt, logs=logs, studio=plan, fleet=fleet)
