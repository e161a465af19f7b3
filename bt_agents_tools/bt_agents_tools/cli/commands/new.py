# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents new`: a first file that works, in a new trees folder if there is none yet."""

from __future__ import annotations

import re
from pathlib import Path

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.trees_folder import SHIPPED, find_trees
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import SUFFIXES, read_trees
from bt_agents_language.tools.templates.first_files import new_agent, new_library, new_test
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import MAX_NAME

_NAME = re.compile(r"[a-z][a-z0-9_]*")


@click.command()
@click.argument("name")
@click.option(
    "--dir",
    "directory",
    type=click.Path(path_type=Path),
    default=Path("trees"),
    show_default=True,
    help="The trees folder; one that is not there yet is made.",
)
@click.option(
    "--kind",
    type=click.Choice(["agent", "library"]),
    default="agent",
    show_default=True,
    help="An agent with its test, or a library of subtrees.",
)
def new(name: str, directory: Path, kind: str) -> None:
    """Write a first file for a new agent NAME, with comments, to be changed.

    Nothing that is there is overwritten.
    """
    _check_name(name)
    files = _names(name, directory, kind)
    for file in files:
        if file.exists() or file.is_symlink():
            raise BtAgentsError(f"'{file}' is there already; choose another name, or move it away")
    _make_folder(directory)
    trees = read_trees(directory)
    skills = trees.symbols.skills
    if kind == "library":
        _write(files[0], _schema(directory, kind) + new_library(name, skills))
    else:
        taken = next((agent for agent in trees.agents if agent.name == name), None)
        if taken is not None:
            raise BtAgentsError(f"there is an agent '{name}' already: {taken.file}")
        text = new_agent(name, str(directory), str(files[0]), trees.scene, skills)
        # Fails for a scene so odd that the new file would have errors.
        read_agent(Source(str(files[0]), text), trees.symbols)
        _write(files[0], _schema(directory, kind) + text)
        test = new_test(name, str(files[1]), trees.scene, skills)
        _write(files[1], _schema(directory, "test") + test)
    _next_steps(name, directory, kind)


def _check_name(name: str) -> None:
    if _NAME.fullmatch(name) and len(name) <= MAX_NAME:
        return
    meant = re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_")
    hint = f"; write {meant}" if _NAME.fullmatch(meant) and len(meant) <= MAX_NAME else ""
    raise BtAgentsError(
        f"'{name[:MAX_NAME]}' cannot be a name: small letters a-z, digits and '_', a letter "
        f"first, at most {MAX_NAME} characters{hint}"
    )


def _names(name: str, directory: Path, kind: str) -> list[Path]:
    if kind == "library":
        return [directory / "libraries" / f"{name}.yaml"]
    return [directory / "agents" / f"{name}{end}" for end in (".yaml", ".test.yaml")]


def _make_folder(directory: Path) -> None:
    """Give a folder that is empty or not there the scene and the skills that are shipped."""
    if (directory / "scene.yaml").exists():
        return
    if directory.is_dir() and any(directory.iterdir()):
        raise BtAgentsError(
            f"'{directory}' has no scene.yaml, so it is no trees folder; name one, or a folder "
            "that is empty"
        )
    shipped = find_trees(SHIPPED)
    for source in (shipped / "scene.yaml", *sorted((shipped / "skills").iterdir())):
        if source.suffix in SUFFIXES:
            _write(directory / source.relative_to(shipped), source.read_text(encoding="utf-8"))


def _schema(directory: Path, kind: str) -> str:
    """Return the line that gives an editor completion, where there are schemas beside a folder."""
    schema = f"schema/{kind}.schema.json"
    if not (directory.absolute().parent / schema).is_file():
        return ""
    return f"# yaml-language-server: $schema=../../{schema}\n"


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as opened:
            opened.write(text)
    except OSError as error:
        raise BtAgentsError(f"'{path}' cannot be written: {error.strerror}") from None
    click.echo(f"wrote {path}")


def _next_steps(name: str, directory: Path, kind: str) -> None:
    agent = directory / "agents" / f"{name}.yaml"
    click.echo(f"\nNext:\n  bt-agents check {directory}")
    if kind == "agent":
        click.echo(f"  bt-agents show {agent}\n  bt-agents rehearse {agent}")
        click.echo(f"  bt-agents test {agent.with_suffix('.test.yaml')}")
    else:
        click.echo(f"  imports: [libraries/{name}.yaml] in an agent, then bt-agents check again")
