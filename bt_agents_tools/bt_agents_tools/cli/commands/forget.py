# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents forget`: removes a person from all stored data."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from bt_agents_core.errors import BtAgentsError, Refused, RefusedElsewhere
from bt_agents_core.optional_packages import journal_needs
from bt_agents_core.person_mention import PersonMention
from bt_agents_core.profile_layers import PERSON, checked_layer
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.state_folder import StateFolder
from bt_agents_core.text import folded, join_first
from bt_agents_tools.cli.commands.tune import author_option
from bt_agents_tools.cli.connection import NoSystemError, connect
from bt_agents_tools.cli.formatting import counted
from bt_agents_tools.cli.trees_choice import kept_state, state_option
from bt_agents_tools.launcher.log_files import erase_lines, log_home


@click.command()
@click.argument("person")
@state_option
@click.option("--ledger", default="", help="File of the learned profiles.")
@click.option("--memory", default="", help="File of remembered values of persons.")
@click.option("--journal", default="", metavar="FOLDER", help="Folder of the journal.")
@click.option("--yes", is_flag=True, help="Do not ask.")
@author_option
def forget(
    person: str, state: str, ledger: str, memory: str, journal: str, yes: bool, author: str
) -> None:
    """Remove a PERSON from memory, learned profiles, journals and logs of the trees folder here.

    For example: bt-agents forget anna. It cannot be undone, and says what it has removed where.
    Exports, copies and backups are not reached. Exit code 1 means that something is left.
    """
    mention = PersonMention(person.strip().removeprefix(f"{PERSON}/"))
    layer = checked_layer(f"{PERSON}/{mention.name}")
    kept = kept_state(state)
    if not yes:
        click.confirm(f"remove {mention.name} from all that is kept, for ever?", abort=True)
    runs, left = _ask_system(layer, author)
    places: dict[str, Callable[[], str]] = {
        "ledger": lambda: _from_ledger(Path(ledger or kept.ledger), layer, author, runs),
        "memory": lambda: _from_memory(Path(memory or kept.memory), mention),
        "market": lambda: _from_market(kept, mention),
        "journals": lambda: _from_journals(Path(journal or kept.journal), mention),
        # Last, because the nodes log whom they have forgotten.
        "logs": lambda: _from_logs(kept, state, mention),
    }
    for place, erase in places.items():
        try:
            click.echo(f"{place}: {erase()}")
        except (BtAgentsError, OSError) as error:
            click.echo(f"{place}: not done: {error}", err=True)
            left = True
    sys.exit(1 if left else 0)


def _ask_system(layer: str, author: str) -> tuple[bool, bool]:
    """Make the nodes of a running system forget; return whether there is one, and what remains."""
    try:
        observer = connect()
        asked: dict[str, Any] = {"action": "FORGET", "layer": layer, "author": author}
        answers = {
            "feedback node": observer.ask("feedback/manage", **asked),
            "scene layer": observer.ask("scene_layer/manage", **asked),
        }
    except NoSystemError:
        return False, False
    left = False
    for node, answer in answers.items():
        if answer is None:
            click.echo(f"{node}: not done: it does not answer; try again", err=True)
            left = True
        elif answer.accepted or answer.code == RefusalCode.UNKNOWN_LAYER:
            # Without such a layer there is nothing to forget.
            click.echo(f"{node}: {answer.message}")
        else:
            click.echo(
                f"{node}: not done: {RefusedElsewhere(answer.code, answer.message)}", err=True
            )
            left = True
    return True, left


def _from_ledger(file: Path, layer: str, author: str, runs: bool) -> str:
    from feedback_node.ledger import Ledger

    if not file.exists():
        return f"nothing was learned yet, there is no {file}"
    try:
        with Ledger(file) as ledger:
            found = [
                (agent, one.layer)
                for agent in ledger.agents()
                for one in ledger.layers(agent)
                if folded(one.layer) == folded(layer)
            ]
            delayed = ledger.forget(found, source=author)
    except Refused as refused:
        if runs and refused.code == RefusalCode.LEDGER_IN_USE:
            return "the feedback node has it, see above"
        raise
    if delayed:
        raise BtAgentsError(f"traces stay in free parts of {file}: {delayed}; try again")
    return f"{counted(len(found), 'profile')} removed from {file}"


def _from_memory(file: Path, person: PersonMention) -> str:
    from scene_layer.memory import forget_in_file

    found = forget_in_file(file, person.name)
    done = f"{person.name} is removed from {file}" if found else f"nothing is known in {file}"
    # Damaged files that were set aside, and new ones of a process that was killed.
    others = sorted(file.parent.glob(f"*{file.name}.*"))
    names = [str(one) for one in others if one.is_file() and _mentions(one, person)]
    if names:
        raise BtAgentsError(
            f"{done}, but files beside it name the person; delete them: {join_first(names)}"
        )
    return done


def _mentions(file: Path, person: PersonMention) -> bool:
    try:
        return person.is_in(file.read_text("utf-8", errors="replace"))
    except FileNotFoundError:  # also if a running node has put it in place meanwhile
        return False


def _from_market(kept: StateFolder, person: PersonMention) -> str:
    named = [str(one) for one in (kept.scenes, kept.orders) if _mentions(one, person)]
    if named:
        raise BtAgentsError(
            f"{join_first(named)}: a waiting scene, or the reason of a pin or veto, names the "
            "person; try again after its end, or delete the file while no system uses it"
        )
    return f"nothing names the person in {kept.path}"


def _from_journals(folder: Path, person: PersonMention) -> str:
    if not any(any(folder.glob(one)) for one in ("*.mcap", "*.mcap.zstd", "*/metadata.yaml")):
        return f"there is none in {folder}"
    try:
        # The journal is an optional extra.
        lab = import_module("bt_agents_lab.recorder.erasure")
    except ModuleNotFoundError as error:
        raise BtAgentsError(journal_needs(error.name)) from None
    found = lab.erase_from_journals(folder, person)
    for problem in found.problems:
        click.echo(f"journals: {problem}", err=True)
    done = (
        f"{counted(found.messages, 'message')} removed from {counted(len(found.files), 'file')} "
        f"in {folder}"
    )
    if found.in_use is not None:
        raise BtAgentsError(
            f"{done}, but {found.in_use.name} is being written; end that system and try again"
        )
    if found.bags:
        names = join_first(one.name for one in found.bags)
        raise BtAgentsError(
            f"{done}, but bags are not changed; delete those that may name the person: {names}"
        )
    return done


def _from_logs(kept: StateFolder, state: str, person: PersonMention) -> str:
    home = log_home(str(kept.path) if state else "")
    erased = erase_lines(home, person)
    lines, files = sum(erased.values()), len(erased)
    return f"{counted(lines, 'line')} removed from {counted(files, 'file')} in {home}"
