# SPDX-License-Identifier: Apache-2.0
"""Commands `bt-agents import groot` and `export groot`, for BehaviorTree.CPP and Groot2."""

from __future__ import annotations

from pathlib import Path

import click

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.trees_folder import find_trees
from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent
from bt_agents_groot.naming import snake
from bt_agents_groot.translation import Remark, RemarkLevel
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import read_symbols, read_trees
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.source import Source, read_source

_OUT = click.option("-o", "--out", metavar="OUT", default="", help="The file to write.")
_TREES = click.option("--dir", "directory", default="", help="The trees folder.")


@click.group("import")
def import_() -> None:
    """Make an agent from a file of another program."""


@click.group("export")
def export() -> None:
    """Make a file for another program from an agent."""


@import_.command("groot")
@click.argument("files", nargs=-1, required=True)
@_OUT
@click.option(
    "--agent",
    default="",
    help="Name of the agent; by default the name of --tree or the first file.",
)
@click.option(
    "--tree",
    default="",
    help="ID of the main tree; only trees that it calls are imported with it.",
)
@_TREES
def import_groot(files: tuple[str, ...], out: str, agent: str, tree: str, directory: str) -> None:
    """Make an agent from FILES of BehaviorTree.CPP 4 or Groot2, or from a project (.btproj).

    A folder stands for its XML files. Included files are read, too. Without -o the agent is
    printed. Nodes without a translation are listed, and are comments in the file. Skills of the
    trees folder are used where their names fit.
    """
    _refuse_existing(out)
    folder = _take(directory)
    symbols = read_symbols(folder)
    first, *others = _xml_files(files)
    imported = import_agent(
        read_source(first),
        snake(agent or tree or first.stem),
        symbols,
        [read_source(other) for other in others],
        read_source,
        tree,
    )
    _write(out, imported.text)
    _print_remarks(imported.remarks)
    if imported.missing:
        names = ", ".join(skill.name for skill in imported.missing)
        click.echo(f"skills that nobody declares yet: {names}", err=True)
        click.echo("the end of the file shows how a skills file would declare them", err=True)
    else:
        try:
            read_agent(Source(out or "(the agent)", imported.text), symbols)
        except ReadError as error:
            click.echo(f"fix this before it can run:\n{error.report}", err=True)


@export.command("groot")
@click.argument("agent", metavar="FILE|AGENT")
@_OUT
@_TREES
def export_groot(agent: str, out: str, directory: str) -> None:
    """Make a file for Groot2 from an agent, by its name or file.

    Without -o it is printed. Nodes that BehaviorTree.CPP does not have are declared in it, so that
    Groot2 shows them, and are listed.
    """
    _refuse_existing(out)
    path, symbols = _find(agent, directory)
    exported = export_agent(read_source(path), symbols)
    _write(out, exported.text)
    _print_remarks(exported.remarks)


def _xml_files(named: tuple[str, ...]) -> list[Path]:
    """Return the named files, and those in named folders."""
    found: list[Path] = []
    for path in map(Path, named):
        inside = sorted(path.glob("*.xml")) if path.is_dir() else [path]
        if not inside:
            raise BtAgentsError(f"there is no XML file in the folder '{path}'")
        found += [one for one in inside if one not in found]
    return found


def _find(agent: str, directory: str) -> tuple[Path, SymbolTable]:
    """Return the file of an agent, and the symbols that it may use."""
    path = Path(agent)
    if agent.endswith((".yaml", ".yml")) or "/" in agent:
        above = (one for one in path.absolute().parents if (one / "scene.yaml").is_file())
        folder = _take(directory or str(next(above, "")))
        return path, read_symbols(folder)
    trees = read_trees(_take(directory))
    files = {one.name: Path(one.file) for one in trees.agents}
    files |= {broken.file.stem: broken.file for broken in trees.broken}
    if agent not in files:
        hint = did_you_mean(agent, files)
        raise BtAgentsError(f"there is no agent '{agent}' in {trees.folder}; {hint}")
    return files[agent], trees.symbols


def _take(named: str) -> Path:
    """Return the trees folder; print it if the user named none."""
    folder = find_trees(named)
    if not named:
        click.echo(f"trees folder: {folder.resolve()}", err=True)
    return folder


def _refuse_existing(out: str) -> None:
    if out and Path(out).exists():
        raise BtAgentsError(f"there is a file '{out}' already; remove it, or name another one")


def _write(out: str, text: str) -> None:
    if not out:
        click.echo(text, nl=False)
        return
    try:
        Path(out).write_text(text, encoding="utf-8")
    except OSError as error:
        raise BtAgentsError(f"'{out}' cannot be written: {error.strerror}") from None
    click.echo(f"wrote {out}")


def _print_remarks(remarks: tuple[Remark, ...]) -> None:
    for remark in remarks:
        click.echo(str(remark), err=True)
    lost = sum(remark.level is RemarkLevel.LOST for remark in remarks)
    if lost:
        click.echo(f"{lost} not translated; the file says where", err=True)
