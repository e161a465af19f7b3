# SPDX-License-Identifier: Apache-2.0
"""`bt-agents import groot` and `export groot`: their output, messages and refusals."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_groot.commands import export, import_
from bt_agents_language.files.agent_reader import read_agent
from tree_harness import SYMBOLS, TREES

XML = """<root BTCPP_format="4"><BehaviorTree ID="Patrol"><Sequence>
  <Say text="Hello"/>{more}</Sequence></BehaviorTree></root>"""


@pytest.fixture
def run(tmp_path, monkeypatch, capsys) -> Callable[..., tuple[str, str]]:
    """Return a function that runs a command in a folder next to the shipped trees."""
    (tmp_path / "trees").symlink_to(TREES)
    monkeypatch.chdir(tmp_path)

    def call(*words: str) -> tuple[str, str]:
        (import_ if words[0] == "import" else export).main([*words[1:]], standalone_mode=False)
        captured = capsys.readouterr()
        return captured.out, captured.err.removeprefix(f"trees folder: {TREES.resolve()}\n")

    return call


def test_import_writes_readable_agent(run, tmp_path):
    (tmp_path / "Night Patrol.xml").write_text(XML.format(more=""))
    out, err = run("import", "groot", "Night Patrol.xml", "-o", "patrol.yaml")
    assert out == "wrote patrol.yaml\n"
    assert err == ""
    assert read_agent(tmp_path / "patrol.yaml", SYMBOLS).name == "night_patrol"


def test_import_without_output_prints_agent(run, tmp_path):
    (tmp_path / "patrol.xml").write_text(XML.format(more=""))
    out, _ = run("import", "groot", "patrol.xml", "--agent", "Walker")
    assert "\nagent: walker\n" in out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["patrol.xml", "trees"]


def test_untranslated_nodes_and_missing_skills_are_listed(run, tmp_path):
    (tmp_path / "patrol.xml").write_text(XML.format(more="<UnsetBlackboard key='x'/><WaveHand/>"))
    _, err = run("import", "groot", "patrol.xml", "-o", "patrol.yaml")
    assert err.splitlines() == [
        'patrol.xml:2:22: not translated: <UnsetBlackboard key="x"> has no equivalent',
        "1 not translated; the file says where",
        "skills that nobody declares yet: wave_hand",
        "the end of the file shows how a skills file would declare them",
    ]


def test_remaining_agent_errors_are_reported(run, tmp_path):
    (tmp_path / "patrol.xml").write_text(XML.format(more="<Say rate='1.2'/>"))
    _, err = run("import", "groot", "patrol.xml", "-o", "patrol.yaml")
    assert err.startswith("fix this before it can run:\npatrol.yaml:")
    assert "error[missing-key]" in err


@pytest.mark.parametrize("command", ["import", "export"])
def test_existing_file_is_not_overwritten(run, tmp_path, command):
    (tmp_path / "there.txt").write_text("mine")
    with pytest.raises(BtAgentsError, match=r"there is a file 'there\.txt' already"):
        run(command, "groot", "attentive_guide", "-o", "there.txt")
    assert (tmp_path / "there.txt").read_text() == "mine"


@pytest.mark.parametrize("command", ["import", "export"])
def test_unwritable_path_is_a_readable_error(run, tmp_path, command):
    (tmp_path / "patrol.xml").write_text(XML.format(more=""))
    source = "patrol.xml" if command == "import" else "attentive_guide"
    with pytest.raises(BtAgentsError, match="'nowhere/x' cannot be written: No such file"):
        run(command, "groot", source, "-o", "nowhere/x")


def test_invalid_file_is_rejected_with_its_errors(run, tmp_path):
    (tmp_path / "patrol.xml").write_text("<root>")
    with pytest.raises(ReadError, match=r"patrol\.xml:1:7: error\[xml-syntax\]"):
        run("import", "groot", "patrol.xml")
    with pytest.raises(ReadError, match=r"error\[no-file\]"):
        run("import", "groot", "elsewhere.xml")


ROUND = """<root BTCPP_format="4">{more}<BehaviorTree ID="Round"><Sequence>
<SubTree ID="Visit" place="kitchen"/><SubTree ID="Visit" place="hall"/>
</Sequence></BehaviorTree></root>"""
VISIT = """<root BTCPP_format="4"><BehaviorTree ID="Visit">
<Sequence><Say text="{place}"/><UnsetBlackboard key="x"/></Sequence></BehaviorTree></root>"""
PROJECT = """<?xml version="1.0" encoding="UTF-8"?>
<root BTCPP_format="4" project_name="Project"><include path="parts/visit.xml"/>
<include path="round.xml"/><TreeNodesModel/></root>"""


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("", ("project.btproj",)),
        ("", ("round.xml", "parts/visit.xml")),
        ('<include path="parts/visit.xml"/>', ("round.xml",)),
        ('<include path="parts/visit.xml"/>', ("parts/visit.xml", "round.xml", "--tree", "Round")),
    ],
)
def test_project_of_several_files_becomes_one_agent(run, tmp_path, more, words):
    (tmp_path / "parts").mkdir()
    (tmp_path / "round.xml").write_text(ROUND.format(more=more))
    (tmp_path / "parts" / "visit.xml").write_text(VISIT)
    (tmp_path / "project.btproj").write_text(PROJECT)
    out, err = run("import", "groot", *words, "--agent", "round")
    assert "\nsubtrees:\n  visit:\n" in out
    assert "parts/visit.xml:2:32: not translated: <UnsetBlackboard" in err


@pytest.mark.parametrize(
    ("more", "words", "code"),
    [
        ("<include/>", (), "missing-attribute"),
        ('<include path="visit.xml"/>', (), "no-file"),
        ('<include path="."/>', (), "no-file"),
        ("", ("parts/visit.xml", "--tree", "Ruond"), "unknown-subtree"),
    ],
)
def test_incomplete_project_is_rejected_with_position(run, tmp_path, more, words, code):
    (tmp_path / "parts").mkdir()
    (tmp_path / "round.xml").write_text(ROUND.format(more=more))
    (tmp_path / "parts" / "visit.xml").write_text(VISIT)
    with pytest.raises(ReadError, match=rf"round\.xml:1:\d+: error\[{code}\]|round\.xml:2:\d+"):
        run("import", "groot", "round.xml", *words)


def test_file_is_read_once_by_any_path(run, tmp_path):
    (tmp_path / "parts").mkdir()
    both = '<include path="parts/visit.xml"/><include path="parts/../parts/visit.xml"/>'
    (tmp_path / "round.xml").write_text(ROUND.format(more=both))
    back = '<include path="../round.xml"/><BehaviorTree '
    (tmp_path / "parts" / "visit.xml").write_text(VISIT.replace("<BehaviorTree ", back))
    out, _ = run("import", "groot", str(tmp_path / "round.xml"), "round.xml")
    assert "\nsubtrees:\n  visit:\n" in out


def test_tree_of_unnamed_file_becomes_skill(run, tmp_path):
    (tmp_path / "round.xml").write_text(ROUND.format(more='<include path="round.xml"/>'))
    out, err = run("import", "groot", "round.xml")
    assert "\n    - visit:\n        place: kitchen\n" in out
    assert "round.xml:2:1: not translated: tree 'Visit' is in none of the named files" in err
    assert "skills that nobody declares yet: visit" in err


@pytest.mark.parametrize("agent", ["attentive_guide", "trees/agents/attentive_guide.yaml"])
def test_export_accepts_agent_name_or_file(run, tmp_path, agent):
    out, _ = run("export", "groot", agent, "-o", "guide.xml")
    assert out == "wrote guide.xml\n"
    assert 'main_tree_to_execute="AttentiveGuide"' in (tmp_path / "guide.xml").read_text()


def test_missing_agent_error_suggests_likely_name(run):
    with pytest.raises(BtAgentsError, match=r"no agent 'atentive_guide' .*mean 'attentive"):
        run("export", "groot", "atentive_guide")
    with pytest.raises(ReadError, match="no-file"):
        run("export", "groot", "trees/agents/nobody.yaml")


def test_folder_stands_for_its_files(run, tmp_path):
    folder = tmp_path / "objectives"
    folder.mkdir()
    call = '<root><BehaviorTree ID="Go Out"><SubTree ID="Greet"/></BehaviorTree></root>'
    (folder / "go_out.xml").write_text(call)
    greet = '<root><BehaviorTree ID="Greet"><Say text="Hello"/></BehaviorTree></root>'
    (folder / "greet.xml").write_text(greet)
    (folder / "notes.txt").write_text("no tree")
    out, err = run("import", "groot", "objectives", "--tree", "Go Out")
    assert "go_out.xml:1:1: note: there is no BTCPP_format" in err
    assert "\nagent: go_out\n" in out
    assert "\n  greet:\n" in out


def test_folder_without_xml_files_is_rejected(run, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(BtAgentsError, match="no XML file in the folder 'empty'"):
        run("import", "groot", "empty")
