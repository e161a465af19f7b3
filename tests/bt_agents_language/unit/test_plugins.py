# SPDX-License-Identifier: Apache-2.0
"""Nodes of other packages: found, checked, read and ticked like nodes of the language."""

from __future__ import annotations

import os
import sys
import textwrap
from pathlib import Path

import pytest

from programs import HANG_S, ROOT, output_of

CODE = '''
"""Nodes of somebody else."""

from py_trees.behaviour import Behaviour

from bt_agents_language.nodes.node_type import Content, NodeField
from bt_agents_language.model.specs import FieldType


class Blink(Behaviour):
    """Blinks so often, then succeeds."""

    main = "times"
    fields = (
        NodeField(name="times", type=FieldType.INTEGER, minimum=1, description="how often"),
        NodeField(name="pause", type=FieldType.DURATION, required=False, default=0.5),
    )

    def __init__(self, name, times, pause):
        super().__init__(name)


class NoBehaviour:
    pass


class BadType(Blink):
    fields = (NodeField(name="times", type="integer"), NodeField(name="pause"))


class Wave(Behaviour):
    """Waves, as the file says it."""

    fields = (
        NodeField(name="speed", content=Content.CONSTANT, type=FieldType.NUMBER, minimum=1),
        NodeField(name="time", content=Content.CONSTANT, type=FieldType.DURATION),
    )

    def __init__(self, name, speed, time):
        super().__init__(name)


class BadReads(Blink):
    reads = {"key": "nobody"}


class BadWrites(Blink):
    writes = {"key": "name"}


class Hears(Behaviour):
    """Hears a word."""

    reads = {"/wanted": "wanted"}
    writes = {"/word": NodeField(name="word", type=FieldType.TEXT)}
    fields = (NodeField(name="wanted", required=False),)
'''


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a folder with an installed package with nodes, as pip would leave it."""
    (tmp_path / "their_nodes.py").write_text(CODE)
    (tmp_path / "their_exit.py").write_text("raise SystemExit('no licence\\nbye')")
    info = tmp_path / "their_nodes-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-nodes\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[bt_agents.nodes]\nblink = their_nodes:Blink\n")
    return tmp_path


def add_entries(package: Path, lines: str) -> None:
    entries = package / "their_nodes-1.0.dist-info" / "entry_points.txt"
    entries.write_text(f"{entries.read_text()}{lines}\n")


def run(package: Path, script: str) -> str:
    """Run a script in a separate Python with the package; return its output."""
    path = os.pathsep.join([str(package), str(ROOT / "tests" / "harness")])
    command = [sys.executable, "-c", textwrap.dedent(script)]
    return output_of(command, HANG_S, PYTHONPATH=path)


READ = """
from dataclasses import replace
import tree_harness
from bt_agents_core.errors import ReadError
from bt_agents_language.nodes.plugin_discovery import installed_plugins

tree_harness.SYMBOLS = replace(tree_harness.SYMBOLS, plugins=installed_plugins().kinds)
for tree in %s:
    try:
        first, *_ = tree_harness.agent(tree).tree.children
        print(dict(first.outputs))
    except ReadError as error:
        print(error.lines[0])
"""


def read(package: Path, *trees: str) -> list[str]:
    """Return the outputs of the first child, or the first error, of each tree."""
    return run(package, READ % [*trees]).splitlines()


def test_plugin_fields_are_checked_like_own_fields(package):
    lines = read(package, "blink: 0", "blink: {times: 2, pause: 3 m}", "blink: {tims: 2}")
    codes = [line.partition("error[")[2].partition("]")[0] for line in lines]
    assert codes == ["out-of-range", "bad-duration", "unknown-key"]


def test_constants_of_plugins_have_their_types(package):
    add_entries(package, "wave = their_nodes:Wave")
    lines = read(
        package,
        "sequence: [wave: {speed: 1.5, time: 3 s}]",
        "wave: {speed: 0.5, time: 3 s}",
        "wave: {speed: 2, time: 3 m}",
    )
    codes = [line.partition("error[")[2].partition("]")[0] for line in lines]
    assert codes == ["", "out-of-range", "bad-duration"]


def test_plugin_outputs_are_known_and_typed(package):
    add_entries(package, "hears = their_nodes:Hears")
    known, unknown, misfit = read(
        package,
        "sequence: [{hears: {wanted: 3}}, {say: 'So ${word}.'}]",
        "sequence: [{say: 'So ${word}.'}]",
        "sequence: [hears: , check: word > 3]",
    )
    assert known == "{'word': '/word'}"
    assert "error[unknown-name]" in unknown
    assert "error[" in misfit


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("Blink = their_nodes:Blink", "cannot be the key of a node"),
        ("say2 = their_nodes:Missing", "cannot be loaded"),
        ("reader = their_nodes:BadReads", "'reads' must be a mapping from keys"),
        ("writer = their_nodes:BadWrites", "'writes' must be a mapping from keys"),
        ("typed = their_nodes:BadType", "whose type is a FieldType"),
        ("leaving = their_exit:Missing", "cannot be loaded: SystemExit: no licence bye"),
        ("thing = their_nodes:NoBehaviour", "is not a py_trees.behaviour.Behaviour class"),
    ],
)
def test_invalid_plugin_does_not_affect_other_plugins(package, entry, words):
    add_entries(package, entry)
    script = """
    from bt_agents_language.nodes.plugin_discovery import installed_plugins
    plugins = installed_plugins()
    print(sorted(plugins.kinds), *plugins.problems)
    """
    printed = run(package, script)
    assert printed.startswith("['blink']")
    assert words in printed
    assert "their-nodes" in printed


COMMAND = """
from bt_agents_tools.cli.main import bt_agents
bt_agents({arguments}, standalone_mode=False)
"""


def command(package: Path, *arguments: str) -> str:
    """Return the output of a command where the package is installed."""
    words = [str(ROOT / "trees") if word == "TREES" else word for word in arguments]
    return " ".join(run(package, COMMAND.format(arguments=words)).split())


@pytest.fixture
def clashing(package: Path) -> Path:
    """Return the same with a node that cannot be loaded, and one with the name of a skill."""
    add_entries(package, "hop = their_nodes:Missing\nsay = their_nodes:Blink")
    return package


def test_check_warns_about_unusable_plugin(clashing):
    printed = command(clashing, "check", "TREES")
    assert "warning[bad-plugin]: node 'hop' of their-nodes (their_nodes:Missing)" in printed
    assert "cannot be loaded: AttributeError" in printed
    assert "2 warnings" in printed
    assert "error" not in printed.replace("AttributeError", "")
    assert printed.count("node 'say' of their-nodes") == 1
    assert "has the name of the skill 'say' (" in printed
    assert "skills/robot.yaml" in printed


def test_explain_lists_plugins_and_keeps_skill(clashing):
    assert command(clashing, "explain", "say", "--dir", "TREES").startswith("say skill Speak")
    printed = command(clashing, "explain", "--dir", "TREES")
    assert "left out node 'hop' of their-nodes" in printed
    assert "node of a plug-in blink" in printed
