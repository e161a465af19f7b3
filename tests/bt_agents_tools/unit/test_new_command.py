# SPDX-License-Identifier: Apache-2.0
"""New agents: patterns, and copies of other agents."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bt_agents_language.tools.templates.first_files import pattern_names, renamed
from bt_agents_tools.cli.main import bt_agents


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(bt_agents, words, catch_exceptions=False)


@pytest.mark.parametrize("pattern", pattern_names())
def test_each_pattern_checks_clean_and_passes_its_tests(pattern: str) -> None:
    made = run("new", "mine", "--pattern", pattern)
    assert made.exit_code == 0, made.output
    checked = run("check", "trees")
    assert (checked.exit_code, checked.stdout) == (0, "1 agent is fine\n")
    tested = run("test", "trees")
    assert tested.exit_code == 0, tested.output


def test_copy_gets_new_name_tests_and_imports(here: Path) -> None:
    assert run("new", "carrier", "--like", "polite_carrier").exit_code == 0
    assert (here / "trees/libraries/manners.yaml").exists()
    other = run("new", "other", "--like", "carrier")
    assert other.exit_code == 0
    assert "still has the title and the profile of carrier" in other.stdout
    assert run("new", "third", "--like", "trees/agents/other.yaml").exit_code == 0
    for name in ("carrier", "other", "third"):
        agent = (here / f"trees/agents/{name}.yaml").read_text()
        assert f"agent: {name}\n" in agent
        assert "yaml-language-server" not in agent
        assert f"test: {name}\n" in (here / f"trees/agents/{name}.test.yaml").read_text()
    assert run("test").exit_code == 0


def test_copy_of_agent_with_texts_speaks_them(here: Path) -> None:
    assert run("new", "carrier").exit_code == 0
    agent = here / "trees/agents/carrier.yaml"
    agent.write_text(agent.read_text().replace("say: Hello.", "say: ${t.hello}"))
    (here / "trees/texts").mkdir()
    (here / "trees/texts/de.yaml").write_text("format: 1\ntexts: {hello: Guten Tag.}\n")
    with (here / "trees/scene.yaml").open("a") as scene:
        scene.write("language: de\n")
    assert run("new", "other", "--like", "carrier").exit_code == 0
    assert "Guten Tag." in run("show", "other").stdout


def test_starting_point_must_be_unique_and_exist() -> None:
    for words, found in (
        (("--like", "attentive_guide", "--pattern", "small_talk"), "give one of them"),
        (("--kind", "library", "--pattern", "small_talk"), "this is a library"),
        (("--pattern", "smal_talk"), "did you mean 'small_talk'?"),
        (("--like", "nobody"), "there is no agent 'nobody'"),
    ):
        with pytest.raises(Exception, match=found.replace("?", r"\?")):
            run("new", "mine", *words)
        assert Path("trees").exists() == ("nobody" in words)
    assert not Path("trees/agents").exists()


def test_copy_incompatible_with_scene_is_refused_with_reason(here: Path) -> None:
    assert run("new", "first").exit_code == 0
    scene = here / "trees" / "scene.yaml"
    scene.write_text(scene.read_text().replace("familiarity", "closeness"))
    with pytest.raises(Exception, match="does not fit the scene") as refused:
        run("new", "mine", "--pattern", "small_talk")
    assert "familiarity" in str(refused.value)
    assert not (here / "trees/agents/mine.yaml").exists()


def test_copy_replaces_only_agent_name() -> None:
    text = "# bt-agents test agents/{0}.test.yaml\nagent: {0}\ntitle: guide\nsay: guide\n"
    assert renamed(text.format("guide"), "guide", "host") == text.format("host")
