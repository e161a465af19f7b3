# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents rehearse`: runs an agent's tree in the terminal, on a virtual clock."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console
from rich.text import Text

from bt_agents.engine.run import TreeOutcome
from bt_agents.engine.scope import format_value
from bt_agents.host.agent_registry import decline_of
from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.field_types import FieldType
from bt_agents_core.local_time import NOON
from bt_agents_core.scene import Origin, SceneSpace
from bt_agents_core.text import printable_lines
from bt_agents_language.files.folder_reader import TEST_SUFFIXES, Trees, read_trees
from bt_agents_language.files.testing.scenarios import AgentTestCase, RehearsedPerson, Scenario
from bt_agents_language.files.testing.test_reader import read_scenario_text, read_test
from bt_agents_language.model.specs import AgentSpec
from bt_agents_tools.cli.named_agent import named_agent
from bt_agents_tools.cli.prompts import InteractiveAnswers
from bt_agents_tools.cli.scenario_options import scenario_yaml
from bt_agents_tools.cli.trees_choice import take_trees
from bt_agents_tools.rehearsal import rehearsal
from bt_agents_tools.rehearsal.assertions import failed_assertions
from bt_agents_tools.rehearsal.events import Event, Rehearsed
from bt_agents_tools.rehearsal.rehearsal_scenes import awarded
from bt_agents_tools.rehearsal.suite import TreesFolders, with_installed_types
from bt_agents_tools.rehearsal.transcript import WIDTH, ending, lines, style_of, table, tuned_text

_EXAMPLES = """\b
Examples:
  bt-agents rehearse attentive_guide --scene age=4 familiarity=1
  bt-agents rehearse attentive_guide --scene mood=4 --at "3s mood=1.5"
  bt-agents rehearse attentive_guide --answer ask=no --tune patience=3s
  bt-agents rehearse trees/agents/attentive_guide.test.yaml
"""


@click.command(epilog=_EXAMPLES)
@click.argument("arguments", nargs=-1, metavar="AGENT")
@click.option("--dir", "directory", default="", help="The trees folder in which AGENT is.")
@click.option("--scene", multiple=True, metavar="NAME=VALUE ...", help="The scene: age=4 mood=3.")
@click.option(
    "--person", multiple=True, metavar="name=anna", help="Who it is; visits=3, favourite=tea."
)
@click.option("--clock", multiple=True, metavar="hour=22", help="Local time; weekday=sunday.")
@click.option("--answer", multiple=True, metavar="SKILL=ANSWER", help="ask=yes, drive={fails: x}.")
@click.option("--at", multiple=True, metavar="'TIME WHAT'", help="'2s mood=1.5', '5s cancel' …")
@click.option("--tune", multiple=True, metavar="NAME=VALUE", help="A tunable from the start.")
@click.option("--language", default="", help="Language of the texts: de for texts/de.yaml.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of everything random.")
@click.option("--pick", multiple=True, metavar="PATH", help="The child that a 'random' takes.")
@click.option("-i", "--interactive", is_flag=True, help="Type the answers yourself.")
@click.option("--ticks", is_flag=True, help="Show every change of every node.")
@click.option("--realtime", is_flag=True, help="Run in real time.")
def rehearse(
    arguments: tuple[str, ...],
    directory: str,
    scene: tuple[str, ...],
    person: tuple[str, ...],
    clock: tuple[str, ...],
    answer: tuple[str, ...],
    at: tuple[str, ...],
    tune: tuple[str, ...],
    language: str,
    seed: int | None,
    pick: tuple[str, ...],
    interactive: bool,
    ticks: bool,
    realtime: bool,
) -> None:
    """Rehearse an AGENT, by its name or file, without a robot.

    FILE.test.yaml:CASE rehearses a case of a test file; without CASE, the first one.

    The time is virtual. Questions without a given answer get a likely one; with -i you answer.
    Exit code 1 when the run fails or does not end.
    """
    agents = [one for one in arguments if "=" not in one]
    if len(agents) != 1:
        raise click.UsageError("name one agent, or a test file")
    trees, spec, case = _material(agents[0], directory, language)
    space, symbols = trees.scene.space, with_installed_types(trees.symbols)
    options = scenario_yaml(
        spec,
        # --scene takes only the first of its values; the others arrive as arguments.
        scene=(*scene, *(one for one in arguments if "=" in one)),
        person=person,
        clock=clock,
        tunables=tune,
        answers=answer,
        events=at,
        seed=seed,
        picks=pick,
    )
    try:
        from_options = read_scenario_text(options.text, "the options", spec, symbols)
    except ReadError as error:
        explained = options.explained(error)
        raise BtAgentsError(f"an option cannot be understood\n{explained}") from None
    scenario = _joined(case.scenario if case is not None else None, from_options, seed)
    console = Console(highlight=False, soft_wrap=True)
    width = min(max(console.width, WIDTH), 120)
    asked = InteractiveAnswers(console, spec, symbols) if interactive else None
    console.print(_heading(spec, scenario, space, case))
    rehearsed = rehearsal.rehearse(
        spec,
        space,
        scenario,
        on_event=_printer(console, width, ticks, realtime),
        answer_source=asked,
        prompt=asked.event if asked is not None else None,
        force=True,
    )
    sys.exit(_close(console, rehearsed, case))


def _material(
    agent: str, directory: str, language: str
) -> tuple[Trees, AgentSpec, AgentTestCase | None]:
    file, _, name = agent.partition(":")
    if not file.endswith(TEST_SUFFIXES):
        return (*named_agent(agent, directory, language=language), None)
    path = Path(file)
    trees = (
        read_trees(take_trees(directory), language=language)
        if directory
        else TreesFolders(language).trees_of(path)
    )
    test = read_test(path, trees.agents, with_installed_types(trees.symbols))
    case = _chosen(test.cases, name, file)
    return trees, case.agent, case


def _chosen(cases: Sequence[AgentTestCase], name: str, file: str) -> AgentTestCase:
    if not name:
        return cases[0]
    found = [case for case in cases if name.casefold() in case.name.casefold()]
    if len(found) == 1 or (found and found[0].name == name):
        return found[0]
    known = "\n".join(f"  {case.name}" for case in cases)
    which = "several cases have" if found else "no case has"
    raise BtAgentsError(f"{which} '{name}' in their names in {file}; there are\n{known}")


def _joined(first: Scenario | None, options: Scenario, seed: int | None) -> Scenario:
    """Return a case's scenario, with options that replace or extend it."""
    if first is None:
        return options
    return replace(
        first,
        scene={**first.scene, **options.scene},
        person=first.person and options.person,
        known=options.known or first.known,
        clock=first.clock if options.clock == NOON else options.clock,
        tunables={**first.tunables, **options.tunables},
        seed=first.seed if seed is None else seed,
        picks=options.picks or first.picks,
        answers=(*options.answers, *first.answers),
        during=(*first.during, *options.during),
    )


def _who(known: RehearsedPerson) -> str:
    remembers = known.remembers.items()
    remembered = [f"{key} {format_value(value, FieldType.ANY)}" for key, value in remembers]
    return ", ".join([f"{known.name}'s visit {known.visits}", *remembered])


def _heading(
    spec: AgentSpec, scenario: Scenario, space: SceneSpace, case: AgentTestCase | None
) -> Text:
    parts = []
    scene = awarded(space, scenario)
    for parameter, value in zip(space.parameters, scene.values, strict=True):
        if value.origin is Origin.MISSING:
            parts.append(f"{parameter.name} missing")
            continue
        notes = (
            parameter.labels.get(value.value, ""),
            "default" if value.origin is Origin.DEFAULT else "",
        )
        known = ", ".join(filter(None, notes))
        parts.append(f"{parameter.name} {value.value:g}" + (f" ({known})" if known else ""))
    required = spec.requires.names if spec.requires is not None else ()
    if "scene.person" in required or not scenario.person:
        parts.append("a person is there" if scenario.person else "nobody is there")
    if scenario.known is not None:
        parts.append(_who(scenario.known))
    about_time = any(name.startswith("clock.") for name in required)
    if about_time or scenario.clock != NOON:
        parts.append(f"{scenario.clock.weekday} at {scenario.clock.hour} h")
    parts += [
        tuned_text(one, scenario.tunables[one.name])
        for one in spec.tunables
        if one.name in scenario.tunables
    ]
    heading = Text(spec.title, style="bold")
    if case is not None:
        heading.append(f" · {case.name}")
    heading.append(f"\n{', '.join(parts)}\n", style="not bold dim")
    decline = decline_of(spec.requires, scene, lambda: scenario.clock)
    if decline is not None:
        note = f"The market would not call it: it does not bid, it {decline.reason}.\n"
        heading.append(note, style="not bold yellow")
    return heading


def _printer(console: Console, width: int, ticks: bool, realtime: bool) -> Callable[[Event], None]:
    start = time.monotonic()

    def print_event(event: Event) -> None:
        for line in lines(event, ticks, width):
            if realtime:
                time.sleep(max(0.0, start + event.at_s - time.monotonic()))
            console.print(Text(line, style=style_of(event)))

    return print_event


def _close(console: Console, rehearsed: Rehearsed, case: AgentTestCase | None) -> int:
    console.print(Text(f"\n{ending(rehearsed)}", style="dim"))
    failures = failed_assertions(case, rehearsed) if case is not None else ()
    for failure in failures:
        place = f"{failure.position.file}:{failure.position.line}"
        console.print(Text(f"✘ {place}: {printable_lines(failure.message)}", style="red"))
        for row in table(failure.rows) if failure.rows else ():
            console.print(Text(row))
    if case is not None and not failures:
        console.print(Text("✔ as the test expects", style="green"))
        return 0
    sound = rehearsed.outcome not in (TreeOutcome.FAILED, None) and not rehearsed.undecided
    return int(bool(failures) or not sound)
