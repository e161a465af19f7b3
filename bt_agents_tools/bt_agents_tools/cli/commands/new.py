# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents new`: writes a first working file, in a new trees folder if needed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.trees_folder import SHIPPED, find_trees
from bt_agents_language.files.agent_file import read_agent_file
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import SUFFIXES, Trees, read_trees
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.files.testing.scenarios import Scenario
from bt_agents_language.files.texts_reader import FolderTexts
from bt_agents_language.reference.node_pages import node_page
from bt_agents_language.tools.schema.folder import folder_symbols
from bt_agents_language.tools.templates.first_files import (
    new_agent,
    new_experiment,
    new_first_test,
    new_library,
    new_script,
    new_skill,
    new_sweep,
    new_test,
    pattern_file,
    renamed,
    tests_beside,
)
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_language.yaml.typed_reader import MAX_NAME, name_meant
from bt_agents_tools.cli.named_agent import named_agent
from bt_agents_tools.rehearsal.rehearsal import rehearse

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_SCHEMA_LINE = re.compile(r"^# yaml-language-server:.*\n", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class _FirstFiles:
    """Files to write, with their texts, and the next steps for the author."""

    texts: Mapping[Path, str]
    steps: Sequence[str]


def _test(name: str, directory: Path) -> _FirstFiles:
    trees = read_trees(directory)
    agent = next((one for one in trees.agents if one.name == name), None)
    if agent is None:
        raise BtAgentsError(
            f"there is no agent '{name}' in '{directory}' that a test could be about; 'bt-agents "
            f"new {name}' makes one with its test"
        )
    space = trees.scene.space
    scene = dict(zip(space.profiles.names, agent.profile, strict=True))
    rehearsed = rehearse(agent, space, Scenario(scene=scene))
    if rehearsed.outcome is None:
        reason = rehearsed.declined or "it does not end by itself"
        raise BtAgentsError(
            f"'{name}' cannot be tested so simply: {reason}; look at 'bt-agents rehearse {name}', "
            "and write what happens meanwhile under 'during'"
        )
    file = Path(agent.file).with_suffix(".test.yaml")
    text = new_first_test(name, str(file), scene, rehearsed.outcome.value)
    return _FirstFiles(
        texts={file: _schema(directory, "test") + text}, steps=[f"bt-agents test {file}"]
    )


def _script(name: str, directory: Path) -> _FirstFiles:
    _make_folder(directory)
    file = directory / "scripts" / f"{name}.yaml"
    text = new_script(name, str(file), read_trees(directory).scene.space)
    return _FirstFiles(
        texts={file: _schema(directory, "script") + text},
        steps=[f"bt-agents demo --script {file}"],
    )


def _skill(name: str, directory: Path) -> _FirstFiles:
    _make_folder(directory)
    if node_page(name, folder_symbols(directory)) is not None:
        raise BtAgentsError(f"there is a node '{name}' already; choose another name")
    file = directory / "skills" / f"{name}.yaml"
    return _FirstFiles(
        texts={file: _schema(directory, "library") + new_skill(name)},
        steps=[f"bt-agents check {directory}", f"{name}: some text, as a node of an agent"],
    )


def _experiment(name: str, directory: Path) -> _FirstFiles:
    folder = directory / name
    texts = new_experiment(name, str(folder))
    return _FirstFiles(
        texts={folder / file: text for file, text in texts.items()},
        steps=[f"bt-agents experiment run {folder}"],
    )


def _sweep(name: str, directory: Path) -> _FirstFiles:
    file = directory / "sweeps" / f"{name}.yaml"
    there = (directory / name / "experiment.yaml").exists()
    about = {} if there else _experiment(name, directory).texts
    return _FirstFiles(
        texts={**about, file: new_sweep(name, str(file))},
        steps=[f"bt-agents experiment sweep {file}"],
    )


def _library(name: str, directory: Path) -> _FirstFiles:
    file = directory / "libraries" / f"{name}.yaml"
    _check_free([file])
    _make_folder(directory)
    text = new_library(name, read_trees(directory).symbols.skills)
    use = f"imports: [libraries/{name}.yaml] in an agent, then bt-agents check again"
    return _FirstFiles(
        texts={file: _schema(directory, "library") + text},
        steps=[f"bt-agents check {directory}", use],
    )


_OTHERS: Mapping[str, Callable[[str, Path], _FirstFiles]] = {
    "library": _library,
    "test": _test,
    "script": _script,
    "skill": _skill,
    "experiment": _experiment,
    "sweep": _sweep,
}


@click.command()
@click.argument("name")
@click.option(
    "--dir",
    "directory",
    type=click.Path(path_type=Path),
    help="The folder of trees or experiments; created if missing.  [default: trees, experiments]",
)
@click.option(
    "--kind",
    type=click.Choice(["agent", *_OTHERS]),
    default="agent",
    show_default=True,
    help="An agent with its test, a test for an existing agent, and so on.",
)
@click.option("--like", default="", metavar="AGENT", help="Start from this agent and its test.")
@click.option("--pattern", "of_pattern", default="", metavar="P", help="Start from a pattern.")
def new(name: str, directory: Path | None, kind: str, like: str, of_pattern: str) -> None:
    """Write a first file for a new agent NAME, with comments, to be changed.

    It starts from a short agent that greets, from a pattern, or from an agent like which it is to
    be; what that imports comes along. A sweep gets an experiment of the same name, unless there is
    one. Nothing that is there is overwritten.
    """
    if like and of_pattern:
        raise BtAgentsError("--like and --pattern are two things to start from; give one of them")
    if kind != "agent" and (like or of_pattern):
        raise BtAgentsError(f"--like and --pattern start an agent, and this is a {kind}")
    _check_name(name)
    if of_pattern:
        pattern_file(of_pattern)  # before anything is written
    if directory is None:
        directory = Path("experiments" if kind in ("experiment", "sweep") else "trees")
    if kind in _OTHERS:
        _write_all(_OTHERS[kind](name, directory))
        return
    file, test = (directory / "agents" / f"{name}{end}" for end in (".yaml", ".test.yaml"))
    _check_free((file, test))
    _make_folder(directory)
    trees = read_trees(directory)
    taken = next((agent for agent in trees.agents if agent.name == name), None)
    if taken is not None:
        raise BtAgentsError(f"there is an agent '{name}' already: {taken.file}")
    if like or of_pattern:
        texts = _copies(name, *_origin(like, of_pattern, trees), directory)
        trees = read_trees(directory)
    else:
        skills = trees.symbols.skills
        texts = (
            new_agent(name, str(directory), str(file), trees.scene, skills),
            new_test(name, str(test), trees.scene, skills),
        )
    try:
        read_agent(Source(str(file), texts[0]), trees.symbols)
    except ReadError as error:
        raise BtAgentsError(
            f"it does not fit the scene and the skills of '{directory}':\n{error}"
        ) from None
    parts = zip((file, test), texts, ("agent", "test"), strict=True)
    steps = [f"check {directory}", f"show {file}", f"rehearse {file}", f"test {test}"]
    _write_all(
        _FirstFiles(
            texts={path: _schema(directory, of) + text for path, text, of in parts if text},
            steps=[f"bt-agents {step}" for step in steps],
        )
    )
    if like:
        click.echo(
            f"\nIt still has the title and the profile of {like}: both suit the same scenes."
        )


def _origin(like: str, of_pattern: str, trees: Trees) -> tuple[Trees, Path]:
    """Return the file that a new agent is copied from, and the folder of its imports."""
    if of_pattern:
        return read_trees(find_trees(SHIPPED)), pattern_file(of_pattern)
    folder = str(trees.folder) if like in {agent.name for agent in trees.agents} else SHIPPED
    origin, agent = named_agent(like, "" if like.endswith(SUFFIXES) else folder)
    return origin, Path(agent.file)


def _copies(name: str, origin: Trees, file: Path, directory: Path) -> tuple[str, str]:
    """Return the texts of an agent and its tests under another name; copy its imports."""
    texts_there = FolderTexts(origin.folder, origin.language)
    libraries = FolderLibraries(origin.folder, origin.symbols, texts=texts_there)
    read = read_agent_file(file, libraries)
    if read.agent is None or read.text is None:
        raise BtAgentsError(str(read.error))
    for path in sorted(read.imports):
        if not (directory / path).exists():
            _write(directory / path, read_source(origin.folder / path).text)
    tests = tests_beside(file)
    texts = (read.text, read_source(tests).text if tests.exists() else "")
    agent, test = (renamed(_SCHEMA_LINE.sub("", text), read.agent.name, name) for text in texts)
    return agent, test


def _check_name(name: str) -> None:
    if _NAME.fullmatch(name) and len(name) <= MAX_NAME:
        return
    meant = name_meant(name)
    hint = f"; write {meant}" if _NAME.fullmatch(meant) and len(meant) <= MAX_NAME else ""
    raise BtAgentsError(
        f"'{name[:MAX_NAME]}' cannot be a name: small letters a-z, digits and '_', a letter "
        f"first, at most {MAX_NAME} characters{hint}"
    )


def _check_free(files: Iterable[Path]) -> None:
    for file in files:
        if file.exists() or file.is_symlink():
            raise BtAgentsError(f"'{file}' is there already; choose another name, or move it away")


def _write_all(made: _FirstFiles) -> None:
    _check_free(made.texts)
    for file, text in made.texts.items():
        _write(file, text)
    click.echo("\n".join(["", "Next:", *(f"  {step}" for step in made.steps)]))


def _make_folder(directory: Path) -> None:
    """Write the shipped scene and skills into an empty or missing folder."""
    if (directory / "scene.yaml").exists():
        return
    if directory.is_dir() and any(directory.iterdir()):
        raise BtAgentsError(
            f"'{directory}' has no scene.yaml, so it is not a trees folder; name one, or a folder "
            "that is empty"
        )
    shipped = find_trees(SHIPPED)
    for source in (shipped / "scene.yaml", *sorted((shipped / "skills").iterdir())):
        if source.suffix in SUFFIXES:
            _write(directory / source.relative_to(shipped), source.read_text(encoding="utf-8"))


def _schema(directory: Path, kind: str) -> str:
    """Return the line that enables completion in editors, if schemas are next to a folder."""
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
