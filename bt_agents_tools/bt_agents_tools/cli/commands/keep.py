# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents keep`: write-back of tuned values into the agents' files."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bt_agents.host.tuning.tunable import TunableKind, TunableParameter, shown_value
from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import BtAgentsError
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_tools.cli.connection import connect, find_host, find_hosts
from bt_agents_tools.client.write_back import ParameterState, default_text, write_defaults
from bt_agents_tools.rehearsal.suite import broken_by, find_tests

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer


@dataclass(frozen=True, kw_only=True)
class _Edit:
    """New text of a file, and its agent then, with a line for each changed value."""

    trees: Path
    path: Path
    before: str
    after: str
    agent: AgentSpec
    changes: tuple[str, ...]


@click.command()
@click.argument("agents", nargs=-1, metavar="[AGENT]...")
@click.option("--profile", is_flag=True, help="Keep the profiles too, with what was learned.")
@click.option("--dry-run", is_flag=True, help="Show what would be changed, change nothing.")
@click.option("--yes", is_flag=True, help="Write without a question also when tests fail then.")
def keep(agents: tuple[str, ...], profile: bool, dry_run: bool, yes: bool) -> None:
    """Write tuned values of AGENTs, or of all, into their files as the new defaults.

    Only those values change in the files; comments, order and quotes stay. tick_rate belongs to
    no agent and is not kept. Before that the agents' tests are run with the new values; when one
    fails that passed, you are asked.
    """
    with connect() as observer:
        edits = [
            edit
            for host in sorted({find_host(observer, a) for a in agents} or find_hosts(observer))
            for edit in _edits(observer, host, agents, profile)
        ]
    if not edits:
        click.echo("nothing to keep: everything stands as the files say")
        return
    for edit in edits if dry_run else ():
        before, after = (text.splitlines(keepends=True) for text in (edit.before, edit.after))
        diff = difflib.unified_diff(before, after, str(edit.path), str(edit.path))
        click.echo("".join(diff), nl=False)
    breaks = _print_tests(edits)
    if dry_run:
        return
    if breaks and not yes:
        click.confirm("write it all the same? (--yes does not ask)", abort=True)
    for edit in edits:
        try:
            write_atomically(edit.path, edit.after)
        except OSError as error:
            raise BtAgentsError(
                f"{edit.path} cannot be written: {error.strerror or error}"
            ) from error
        for change in edit.changes:
            click.echo(f"{change}  in {edit.path}")


def _print_tests(edits: Sequence[_Edit]) -> bool:
    """Print the tests of the agents that would fail; return whether there are any."""
    results = [
        result
        for folder in sorted({edit.trees for edit in edits})
        for result in broken_by(
            find_tests([folder]), {e.agent.name: e.agent for e in edits if e.trees == folder}
        )
    ]
    for result in results:
        for case in result.cases:
            click.echo(f"passes now, would fail: {case.case.name}  in {result.file}")
            click.echo(f"    {case.failures[0].message}")
        if result.error is not None:
            click.echo(f"not run, as the file has errors: {result.file}")
    breaks = any(result.cases for result in results)
    if not breaks and any(result.agent is not None for result in results):
        names = ", ".join(sorted({edit.agent.name for edit in edits}))
        click.echo(f"tests of {names}: none fails that passes now")
    return breaks


def _edits(observer: Observer, host: str, agents: Sequence[str], profile: bool) -> list[_Edit]:
    from bt_agents_tools.client import tuning

    kinds = {TunableKind.TUNABLE, TunableKind.LEARNING_RATE}
    if profile:
        kinds.add(TunableKind.PROFILE)
    tuned: dict[str, list[ParameterState]] = {}
    for state in tuning.parameters(observer, host, agents):
        if state.parameter.kind in kinds and state.value != state.parameter.default:
            tuned.setdefault(state.parameter.agent, []).append(state)
    if not tuned:
        return []
    folder = Path(observer.cards[host].trees)
    if not (folder / "scene.yaml").is_file():
        raise BtAgentsError(
            f"the trees folder '{folder}' of {host} is not on this machine; run this where it is"
        )
    trees = read_trees(folder)
    return [_edit(trees, agent, tuned[agent]) for agent in sorted(tuned)]


def _edit(trees: Trees, agent: str, tuned: Sequence[ParameterState]) -> _Edit:
    spec = next((one for one in trees.agents if one.name == agent), None)
    if spec is None:
        for broken in trees.broken:
            if re.search(rf"^agent:\s*{re.escape(agent)}\s*(#|$)", _text(broken.file), re.M):
                raise broken.error
        raise BtAgentsError(f"no file in '{trees.folder}' has the agent '{agent}' any more")
    source = read_source(Path(spec.file))

    def read(text: str) -> AgentSpec:
        return read_agent(Source(source.file, text), trees.symbols)

    after = write_defaults(source, tuned, trees.symbols.space, read)
    written = Source(source.file, after)
    return _Edit(
        trees=trees.folder,
        path=Path(spec.file),
        before=source.text,
        after=after,
        agent=read(after),
        changes=tuple(
            f"{one.name}: {_default(source, one)} → {_default(written, one)}"
            for one in (override.parameter for override in tuned)
        ),
    )


def _default(source: Source, parameter: TunableParameter) -> str:
    """Return a default as a file spells it, formatted when the file leaves it out."""
    return default_text(source, parameter) or shown_value(parameter, parameter.default)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
