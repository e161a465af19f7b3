# SPDX-License-Identifier: Apache-2.0
"""`bt-agents new`: its files work at once, in any trees folder."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_lab.experiments.core import through_core
from bt_agents_lab.experiments.replicas import opened
from bt_agents_lab.experiments.sweep import sweep
from bt_agents_lab.experiments.sweep_reader import read_sweep
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.model.specs import NodeSpec
from bt_agents_tools.cli.commands.check import check as checking
from bt_agents_tools.cli.commands.new import new
from bt_agents_tools.rehearsal.suite import TreesFolders, coverages, run_file
from tree_harness import TREES

ODD_SCENE = """\
format: 1
parameters:
  distance: {min: -0.0000025, max: 7, default: %s}
"""


@pytest.fixture
def made(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(TREES, tmp_path / "trees")

    def call(*arguments: str) -> str:
        new.main(list(arguments), standalone_mode=False)
        return capsys.readouterr().out

    return call


def kinds(node: NodeSpec) -> set[str]:
    return {node.kind}.union(*map(kinds, node.children))


def check(folder: Path) -> NodeSpec:
    """Check that everything works in a folder; return the new tree."""
    trees = read_trees(folder)
    assert not trees.broken
    result = run_file(folder / "agents" / "fresh.test.yaml", TreesFolders())
    assert result.error is None
    assert [case.failures for case in result.cases] == [()] * len(result.cases)
    (covered,) = coverages([result])
    assert covered.gaps == ()
    return next(agent.tree for agent in trees.agents if agent.name == "fresh")


def test_new_agent_and_its_test_work_at_once(made):
    assert made("fresh").startswith("wrote trees/agents/fresh.yaml\n")
    assert "say" in kinds(check(Path("trees")))


def test_new_profile_uses_scene_of_folder(made):
    made("fresh")
    text = Path("trees/agents/fresh.yaml").read_text(encoding="utf-8")
    assert "\n  age: 3          # 1 to 5: how old the person is\n" in text
    assert "\n  familiarity: 3  # 1 to 5: how well the person knows this robot\n" in text


def test_new_agent_refers_to_neighbouring_schema(made):
    Path("schema").mkdir()
    Path("schema/agent.schema.json").write_text("{}", encoding="utf-8")
    made("fresh")
    first = "# yaml-language-server: $schema=../../schema/agent.schema.json\n"
    assert Path("trees/agents/fresh.yaml").read_text(encoding="utf-8").startswith(first)
    assert "schema" not in Path("trees/agents/fresh.test.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("default", ["1.25", "-0.0000025", "7"])
def test_new_agent_works_without_say_and_mood(made, default):
    Path("odd").mkdir()
    Path("odd/scene.yaml").write_text(ODD_SCENE % default, encoding="utf-8")
    made("fresh", "--dir", "odd")
    assert "log" in kinds(check(Path("odd")))


def test_say_needing_more_than_text_is_not_used(made):
    file = Path("trees/skills/robot.yaml")
    text = file.read_text(encoding="utf-8")
    rate = "rate: {type: number, default: 1.0,"
    assert rate in text
    for folder in ("trees/agents", "trees/libraries", "trees/skills"):
        shutil.rmtree(folder)
    file.parent.mkdir()
    file.write_text(text.replace(rate, "rate: {type: number,"), encoding="utf-8")
    made("fresh")
    assert "say" not in kinds(check(Path("trees")))


def test_new_library_works_and_can_be_imported(made):
    assert made("words", "--kind", "library").startswith("wrote trees/libraries/words.yaml\n")
    Path("trees/agents/user.yaml").write_text(
        "format: 1\nagent: user\nprofile: {age: 3, familiarity: 3, mood: 3}\n"
        "imports: [libraries/words.yaml]\n"
        "tree: {subtree: remind, with: {words: Please take your bag.}}\n",
        encoding="utf-8",
    )
    trees = read_trees(Path("trees"))
    assert not trees.broken
    assert "user" in [agent.name for agent in trees.agents]


@pytest.mark.parametrize("file", ["fresh.yaml", "fresh.test.yaml"])
def test_existing_file_is_not_overwritten(made, file):
    path = Path("trees/agents") / file
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(BtAgentsError, match=f"'{path}' is there already"):
        made("fresh")
    assert path.read_text(encoding="utf-8") == "mine"
    assert len(list(path.parent.glob("fresh*"))) == 1


def test_name_of_another_file_is_rejected(made):
    Path("trees/agents/silent_text.yaml").rename("trees/agents/quiet.yaml")
    Path("trees/agents/silent_text.test.yaml").unlink()
    with pytest.raises(BtAgentsError, match=r"'silent_text' already: trees/agents/quiet\.yaml"):
        made("silent_text")


@pytest.mark.parametrize(
    ("name", "hint"), [("Été 2", "; write ete_2"), ("../x", "; write x"), ("1", "")]
)
def test_invalid_name_is_rejected(made, name, hint):
    with pytest.raises(BtAgentsError) as error:
        made(name)
    assert str(error.value).endswith(f"at most 64 characters{hint}")
    assert str(error.value).startswith(f"'{name}' cannot be a name: ")


def test_unrelated_folder_is_rejected(made):
    Path("other").mkdir()
    Path("other/letter.txt").write_text("Dear", encoding="utf-8")
    with pytest.raises(BtAgentsError, match="'other' has no scene"):
        made("fresh", "--dir", "other")
    assert [path.name for path in Path("other").iterdir()] == ["letter.txt"]


def test_a_broken_scene_is_reported(made):
    Path("trees/scene.yaml").write_text("format: 1\n", encoding="utf-8")
    with pytest.raises(ReadError, match=r"error\[missing-key\]"):
        made("fresh")


def test_unwritable_folder_is_an_error(made):
    Path("file").write_text("", encoding="utf-8")
    with pytest.raises(BtAgentsError, match="cannot be written: Not a directory"):
        made("fresh", "--dir", "file/trees")


@pytest.mark.parametrize("agent", ["attentive_guide", "silent_text"])
def test_new_test_covers_existing_agent_and_passes(made, agent):
    file = Path(f"trees/agents/{agent}.test.yaml")
    file.unlink(missing_ok=True)
    assert made(agent, "--kind", "test") == f"wrote {file}\n\nNext:\n  bt-agents test {file}\n"
    assert [case.failures for case in run_file(file, TreesFolders()).cases] == [()]
    with pytest.raises(BtAgentsError, match="no agent 'nobody' in 'trees' that a test could be"):
        made("nobody", "--kind", "test")


def test_new_script_can_be_played(made):
    output = made("monday", "--kind", "script")
    assert "bt-agents demo --script trees/scripts/monday.yaml" in output
    script = read_script(Path("trees/scripts/monday.yaml"), read_trees(Path("trees")).scene.space)
    assert [visit.person for visit in script.visits] == [True, False]


def test_new_skill_is_usable_in_agents(made):
    made("sing", "--kind", "skill")
    made("fresh")
    agent = Path("trees/agents/fresh.yaml")
    head = agent.read_text(encoding="utf-8").partition("\ntree:")[0]
    agent.write_text(f"{head}\ntree: {{sing: La la.}}\n", encoding="utf-8")
    Path("trees/agents/fresh.test.yaml").unlink()
    made("fresh", "--kind", "test")
    assert "sing" in kinds(check(Path("trees")))
    for taken in ("say", "sequence"):
        with pytest.raises(BtAgentsError, match=f"there is a node '{taken}' already"):
            made(taken, "--kind", "skill")


def test_new_experiment_runs(made):
    made("mine", "--kind", "experiment")
    folder, spec = opened(Path("experiments/mine"))
    assert len(through_core(folder, spec)) == spec.rounds
    assert CliRunner().invoke(checking, ["experiments/mine"]).exit_code == 0


@pytest.mark.parametrize("first", ["experiment", ""])
def test_new_sweep_runs_over_experiment_of_same_name(made, first):
    if first:
        made("mine", "--kind", first)
    assert ("experiment.yaml" in made("mine", "--kind", "sweep")) is not bool(first)
    spec = replace(read_sweep(Path("experiments/sweeps/mine.yaml")), runs=2, rounds=5)
    assert len(sweep(spec, 1, lambda done, total: None)) == 8


@pytest.mark.parametrize("kind", ["test", "script", "skill", "experiment", "sweep"])
def test_no_kind_of_file_is_overwritten(made, kind):
    name = "attentive_guide" if kind == "test" else "mine"
    Path("trees/agents/attentive_guide.test.yaml").unlink()
    made(name, "--kind", kind)
    with pytest.raises(BtAgentsError, match="already"):
        made(name, "--kind", kind)
