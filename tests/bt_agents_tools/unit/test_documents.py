# SPDX-License-Identifier: Apache-2.0
"""README, docs and launch files: their statements are true."""

from __future__ import annotations

import re
import shlex
import shutil
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from bag_fixture import write_bag
from bt_agents_lab.experiments.sweep_reader import SWEEP, read_sweep
from bt_agents_language.files.experiment_reader import EXPERIMENT, read_experiment
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.files.market_reader import read_market
from bt_agents_language.files.preset_reader import PRESET, read_preset
from bt_agents_language.files.scene_reader import SCENE
from bt_agents_language.files.script_reader import SCRIPT, read_script
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.files.texts_reader import FolderTexts, read_texts
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES
from bt_agents_language.nodes.plugin_discovery import GROUP, read_plugins
from bt_agents_language.tools.schema.generator import file_schema
from bt_agents_language.yaml.field_tables import FileKind
from bt_agents_language.yaml.source import Source
from bt_agents_tools.cli.main import TASKS, bt_agents
from bt_agents_tools.rehearsal.rehearsal import Limits, rehearse
from bt_agents_tools.rehearsal.suite import failure, run_case
from checkout import PACKAGES, ROOT
from command_results import split_runner
from file_texts import read_agent_text, read_scene_text, read_test_text
from journal_fixture import morning
from marketplace_node.strategies import StrategySpec
from rehearsal_harness import scenario
from tree_harness import SPACE, SYMBOLS, TREES

LAUNCH = ROOT / "bt_agents_bringup" / "launch"
OFFLINE = {*TASKS["Write agents"], "replay", "what-if"}
"""Commands that need neither ROS nor a robot."""

RUN_AS_A_WHOLE = ("tutorial.md", "library_robot.md")
"""Documents whose commands depend on each other; tests/e2e/test_walkthroughs.py runs them."""

WITH_A_PACKAGE = "py_trees_ros.md"
"""Document whose tree needs the package next to it; tests/ros/test_plugin_nodes.py runs both."""

DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
AGENT = """
format: 1
agent: example
profile: {age: 3, familiarity: 3, mood: 3}
tree: {wait: 1 s}
"""
PATROL = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'


def blocks(language: str) -> list[tuple[str, str]]:
    return [
        (path.name, text)
        for path in DOCUMENTS
        for text in re.findall(rf"```{language}\n(.*?)```", path.read_text(), re.DOTALL)
    ]


TRANSCRIPTS = {
    command.strip(): written
    for path in DOCUMENTS
    for command, written in re.findall(
        r"```console\n([^\n]+)\n```\n\n?```text\n(.*?)```", path.read_text(), re.DOTALL
    )
}
"""A command that is alone in its block → the block of text that follows."""


@pytest.mark.parametrize(
    ("document", "text"),
    [block for block in blocks("yaml") if block[0] not in (*RUN_AS_A_WHOLE, WITH_A_PACKAGE)],
)
def test_yaml_examples_are_valid(document: str, text: str, tmp_path: Path) -> None:
    keys = yaml.safe_load(text)
    if {"test", "cases"} <= keys.keys():
        test = read_test_text(text, document, read_trees(TREES).agents, SYMBOLS)
        results = [run_case(test.agent, SPACE, case) for case in test.cases]
        assert not [failure(result) for result in results if not result.passed]
    elif "parameters" in keys:
        assert bool(read_scene_text(text, document).sources) is ("sources" in keys)
    elif "texts" in keys:
        assert read_texts(Source(document, text)).texts
    elif "preset" in keys:
        assert read_preset(Source(document, text)).values
    elif "visits" in keys:
        assert read_script(Source(document, text), SPACE).visits
    elif "rules" in keys:
        assert read_market(Source(document, text), SPACE)
    elif "scenes" in keys:
        assert read_experiment(Source(document, text), SPACE).scenes
    elif "strategies" in keys:
        (tmp_path / "persons").symlink_to(ROOT / "experiments" / "persons")
        assert read_sweep(_written(tmp_path / "sweeps", text)).selections
    elif {"skills", "bindings", "places"} & keys.keys():
        assert read_skills([TREES / "skills" / "robot.yaml", _written(tmp_path / "skills", text)])
    elif "format" in keys and "tree" not in keys:
        _written(tmp_path / "libraries", text)
        assert FolderLibraries(tmp_path, SYMBOLS).load("libraries/their.yaml").subtrees
    else:
        _rehearse(text, document, tmp_path)


def _written(folder: Path, text: str) -> Path:
    """Write a file into a new folder; return its path."""
    folder.mkdir()
    path = folder / "their.yaml"
    path.write_text(text)
    return path


def _rehearse(text: str, document: str, folder: Path) -> None:
    """Rehearse an agent of which a page shows some keys."""
    keys = yaml.safe_load(text)
    missing = [line for line in AGENT.splitlines() if line and line.split(":")[0] not in keys]
    symbols = replace(SYMBOLS, texts=_texts(document, folder))
    agent = read_agent_text("\n".join(missing) + "\n" + text, document, symbols)
    # It ends, or runs to the limit, or waits for an event that never comes: it never raises.
    limits = Limits(duration_s=600.0, ticks=2000)
    told = rehearse(agent, SPACE, scenario(agent), limits=limits, force=True)
    assert told.events
    assert told.message


def _texts(document: str, folder: Path) -> FolderTexts:
    """Return the texts whose files are on a page, in the language of the first."""
    files = {
        path: text
        for page, text in blocks("yaml")
        if page == document and (path := text.split("\n")[0].removeprefix("# ")).endswith(".yaml")
        if path.startswith("texts/")
    }
    (folder / "texts").mkdir()
    for path, text in files.items():
        (folder / path).write_text(text)
    return FolderTexts(folder, Path(next(iter(files), "")).stem)


@pytest.mark.parametrize(
    ("document", "kind"),
    [
        ("scene", SCENE),
        ("testing", SCRIPT),
        ("tuning", PRESET),
        ("experiments", EXPERIMENT),
        ("experiments", SWEEP),
    ],
)
def test_file_page_names_every_key(document: str, kind: FileKind) -> None:
    page = (ROOT / "docs" / f"{document}.md").read_text()

    def keys(schema: object) -> set[str]:
        if isinstance(schema, list):
            return {key for item in schema for key in keys(item)}
        if not isinstance(schema, dict):
            return set()
        below = {key for part in schema.values() for key in keys(part)}
        return below | set(schema.get("properties", ()))

    missing = {key for key in keys(file_schema(kind, SPACE)) if f"`{key}`" not in page}
    assert not missing - {"format", *SPACE.names}


@pytest.mark.parametrize(("document", "text"), blocks("console"))
def test_documented_commands_and_options_exist(document: str, text: str) -> None:
    for command in re.findall(r"bt-agents ((?:[^#\n`]|#\S)+)", text):
        name, *words = command.split()
        found = bt_agents.get_command(click.Context(bt_agents), name)
        if isinstance(found, click.Group) and words:
            found = found.resolve_command(click.Context(found), words)[1]
        assert found is not None, f"{document}: bt-agents {command}"
        known = {o for p in found.params for o in (*p.opts, *p.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= known
    for script in re.findall(r"scripts/\w+", text):
        assert (ROOT / script).exists(), f"{document}: {script}"


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small journal, and a bag of the same system."""
    folder = tmp_path_factory.mktemp("kept")
    journaled = morning(folder / "trees")
    journaled.write(folder / "morning.mcap")
    write_bag(folder / "morning", journaled.published)
    return folder


@pytest.fixture
def here(tmp_path: Path, kept: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the trees, as the documents assume."""
    shutil.copytree(TREES, tmp_path / "trees")
    shutil.copy(kept / "morning.mcap", tmp_path)
    shutil.copytree(kept / "morning", tmp_path / "morning")
    (tmp_path / "patrol.xml").write_text(PATROL)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("document", "text"), [block for block in blocks("console") if block[0] not in RUN_AS_A_WHOLE]
)
@pytest.mark.usefixtures("here")
def test_documented_offline_commands_print_documented_output(document: str, text: str) -> None:
    for command, below in _sessions(text):
        output, written = _run(command), below or TRANSCRIPTS.get(command)
        if written and output is not None:
            assert output == written, f"{document}: {command}"


def test_documents_contain_transcripts() -> None:
    assert TRANSCRIPTS


def _sessions(text: str) -> list[tuple[str, str]]:
    """Return the commands of a block, each with the text below it."""
    if not text.startswith("$ "):
        return [(line, "") for line in text.splitlines()]
    parts = re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]
    return [(head, below) for head, _, below in (part.partition("\n") for part in parts)]


def _run(line: str) -> str | None:
    """Return the output of a command, None if it needs more than this test has."""
    program, *words = shlex.split(line, comments=True)
    if Path(program).name != "bt-agents" or words[0] not in OFFLINE:
        return None
    # It would watch for ever.
    words = [word for word in words if word != "--watch"]
    result = split_runner().invoke(bt_agents, words, catch_exceptions=False)
    assert result.exit_code == 0, f"{line}\n{result.output}"
    return result.stdout


def test_reference_lists_nodes_and_decorators_in_order() -> None:
    text = (ROOT / "docs" / "language.md").read_text()
    for kind in NODE_TYPES:
        assert re.search(rf"^\| .*`{kind}[:` ]", text, re.MULTILINE), kind
    table = text.partition("## Decorators")[2].partition("\n## ")[0]
    assert re.findall(r"^\| `(\w+):", table, re.MULTILINE) == ["name", *DECORATORS]


@pytest.mark.parametrize(("document", "text"), blocks("python"))
def test_python_examples_define_working_nodes_or_strategies(document: str, text: str) -> None:
    found: dict[str, object] = {}
    exec(compile(text, document, "exec"), found)
    if "SPEC" in found:
        assert isinstance(found["SPEC"], StrategySpec)
        return
    classes = [one for one in found.values() if isinstance(one, type) and "fields" in vars(one)]
    assert len(classes) == 1
    point = EntryPoint(name="example", value=document, group=GROUP)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EntryPoint, "load", lambda _: classes[0])
        assert read_plugins([point]).problems == ()


def launched(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the arguments and the nodes of a launch file."""
    entries = yaml.safe_load(path.read_text())["launch"]
    arguments = {entry["arg"]["name"]: entry["arg"] for entry in entries if "arg" in entry}
    return arguments, [entry["node"] for entry in entries if "node" in entry]


@pytest.mark.parametrize("path", sorted(LAUNCH.glob("*.yaml")))
def test_launch_file_nodes_are_executables_of_their_package(path: Path) -> None:
    packages = {package.name: package for package in PACKAGES}
    _, nodes = launched(path)
    assert nodes
    for node in nodes:
        assert node["exec"] in packages[node["pkg"]].executables(), node


@pytest.mark.parametrize("path", sorted(LAUNCH.glob("*.yaml")))
def test_parameter_file_wins_over_launch_arguments(path: Path) -> None:
    _, nodes = launched(path)
    for node in nodes:
        assert [one for one in node["param"] if "from" in one] == node["param"][-1:], node


@pytest.mark.parametrize("folder", ["", "/data/day"])
def test_launched_system_keeps_journal_only_on_request(folder: str) -> None:
    arguments, nodes = launched(LAUNCH / "system.launch.yaml")
    assert arguments["journal"]["default"] == ""
    [node] = [node for node in nodes if node["pkg"] == "bt_agents_lab"]
    assert {"name": "folder", "value": "$(var journal)", "type": "str"} in node["param"]
    [condition] = re.findall(r'^\$\(eval "(.*)"\)$', node["if"])
    assert eval(condition.replace("$(var journal)", folder)) is bool(folder)


def test_demo_launch_passes_system_arguments_and_namespace() -> None:
    system, nodes = launched(LAUNCH / "system.launch.yaml")
    assert {"tags", "robot", "tick_rate", "live_rate", "log_level", "respawn"} <= system.keys()
    own, more = launched(LAUNCH / "demo.launch.yaml")
    assert own["tags"]["default"] == "airport"
    assert {node["namespace"] for node in nodes + more} == {"$(var namespace)"}
    assert {node["ros_args"] for node in nodes + more} == {"--log-level $(var log_level)"}
