# SPDX-License-Identifier: Apache-2.0
"""`bt-agents fmt`: what it changes, what it says, and what it leaves alone."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from click.testing import CliRunner

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.commands.fmt import fmt

UGLY = "a:   1\nb: {c: 2}\n"
NEAT = "a: 1\nb: {c: 2}\n"


@dataclass(frozen=True)
class Outcome:
    exit_code: int
    stdout: str
    stderr: str


@pytest.fixture
def run(capsys) -> Callable[..., Outcome]:
    def call(*arguments: object) -> Outcome:
        with pytest.raises(SystemExit) as end:
            fmt.main([str(one) for one in arguments], standalone_mode=False)
        captured = capsys.readouterr()
        return Outcome(end.value.code, captured.out, captured.err)

    return call


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "agents").mkdir()
    (tmp_path / "agents" / "a.yaml").write_text(UGLY)
    (tmp_path / "scene.yml").write_text(NEAT)
    (tmp_path / "note.txt").write_text(UGLY)
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden" / "x.yaml").write_text(UGLY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_files_of_a_folder_are_changed_and_named(run, folder):
    result = run(".")
    assert result.exit_code == 0
    assert result.stdout == "agents/a.yaml: changed\n"
    assert result.stderr == "1 of 2 files changed\n"
    assert (folder / "agents" / "a.yaml").read_text() == NEAT
    assert (folder / ".hidden" / "x.yaml").read_text() == UGLY
    assert run(".").stdout == ""
    assert sorted(path.name for path in (folder / "agents").iterdir()) == ["a.yaml"]


def test_without_a_path_it_is_the_trees_folder(run, folder, monkeypatch):
    (folder / "agents").rename(folder / "scripts")
    trees = folder / "trees"
    trees.mkdir()
    (trees / "scene.yaml").write_text(UGLY)
    assert run().stdout == "trees/scene.yaml: changed\n"
    assert (folder / "scripts" / "a.yaml").read_text() == UGLY


def test_check_changes_nothing_and_fails_when_a_file_would_change(run, folder):
    result = run("--check", ".")
    assert (result.exit_code, result.stdout) == (1, "agents/a.yaml: would change\n")
    assert (folder / "agents" / "a.yaml").read_text() == UGLY
    assert run("--check", "scene.yml").exit_code == 0


def test_diff_shows_what_would_change_and_changes_nothing(run, folder):
    result = run("--diff", ".")
    assert result.exit_code == 0
    assert result.stdout == (
        "--- agents/a.yaml\n+++ agents/a.yaml\n@@ -1,2 +1,2 @@\n-a:   1\n+a: 1\n b: {c: 2}\n"
    )
    assert (folder / "agents" / "a.yaml").read_text() == UGLY
    assert run("--diff", "--check", ".").exit_code == 1


def test_a_diff_has_colours_on_a_terminal_unless_they_are_unwanted(folder, monkeypatch):
    def coloured() -> str:
        return CliRunner().invoke(fmt, ["--diff", "."], color=True).output

    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[31m-a:   1\x1b[0m" in coloured()
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in coloured()


def test_a_broken_file_is_left_alone_and_the_others_go_on(run, folder):
    (folder / "agents" / "0.yaml").write_text("a: 1\na:   2\n")
    result = run(".")
    assert result.exit_code == 1
    assert "agents/0.yaml:2:1: error[duplicate-key]" in result.stdout
    assert "agents/a.yaml: changed" in result.stdout
    assert result.stderr == "1 of 3 files changed, 1 left as it is because of errors\n"
    assert (folder / "agents" / "0.yaml").read_text() == "a: 1\na:   2\n"


def test_a_file_that_is_not_there_is_an_error(run, folder):
    result = run("nobody.yaml", "scene.yml")
    assert result.exit_code == 1
    assert "nobody.yaml:1:1: error[no-file]" in result.stdout


def test_a_folder_without_files_is_an_error(tmp_path):
    with pytest.raises(BtAgentsError, match="there is no YAML file in"):
        fmt.main([str(tmp_path)], standalone_mode=False)


def test_permissions_stay_and_a_link_stays_a_link(run, folder):
    file = folder / "agents" / "a.yaml"
    file.chmod(0o640)
    (folder / "link.yaml").symlink_to(file)
    assert run("link.yaml").exit_code == 0
    assert (folder / "link.yaml").is_symlink()
    assert file.read_text() == NEAT
    assert stat.S_IMODE(file.stat().st_mode) == 0o640


def test_a_file_that_cannot_be_written_stays_and_is_reported(run, folder, monkeypatch):
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)
    result = run("agents/a.yaml")
    assert result.exit_code == 1
    assert result.stdout == (
        "agents/a.yaml: cannot be written: Permission denied; check its permissions\n"
    )
    assert (folder / "agents" / "a.yaml").read_text() == UGLY
    assert sorted(path.name for path in (folder / "agents").iterdir()) == ["a.yaml"]
