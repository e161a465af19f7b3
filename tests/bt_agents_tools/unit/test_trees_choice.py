# SPDX-License-Identifier: Apache-2.0
"""The trees folder that commands use, and their messages about it."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from click.testing import Result

from bt_agents.host.tuning.change_log import ChangeLog
from bt_agents.host.tuning.history import TuningCause, TuningChange, TuningRevision
from bt_agents_core.state_folder import claim_state
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_tools.cli.commands import demo, profile, tune, why
from bt_agents_tools.cli.connection import NoSystemError
from bt_agents_tools.cli.main import bt_agents
from command_results import split_runner
from feedback_node.ledger import Ledger
from feedback_node.ledger.rows import RevisionCause
from journal_fixture import EPOCH, morning
from tree_harness import TREES

Run = Callable[..., Result]
PROFILE = {"age": 3.0, "familiarity": 1.0, "mood": 3.0}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a command in an empty folder; no system is running."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)

    def no_system() -> None:
        raise NoSystemError("no running system")

    for module in (profile, tune, why):
        monkeypatch.setattr(module, "connect", no_system)
    return lambda *words: split_runner().invoke(bt_agents, words)


@pytest.fixture
def trees(run: Run) -> Path:
    """A trees folder in the current folder."""
    return Path(shutil.copytree(TREES, Path.cwd() / "trees"))


@pytest.mark.parametrize(
    ("words", "example"),
    [
        ("check", "bt-agents check shipped"),
        ("up", "bt-agents up shipped"),
        ("schema", "bt-agents schema shipped"),
        ("rehearse attentive_guide", "bt-agents rehearse … --dir shipped"),
    ],
)
def test_missing_trees_folder_error_says_what_to_write(run: Run, words: str, example: str) -> None:
    said = str(run(*words.split()).exception)
    assert "no trees folder here" in said
    assert example in said.replace("bt-agents-", "bt-agents ")
    assert "'bt-agents new NAME'" in said


@pytest.mark.parametrize("words", ["forget anna", "profile show", "why", "tune --history a"])
def test_hint_fits_commands_without_a_folder(run: Run, words: str) -> None:
    assert "go to one with 'cd'" in str(run(*words.split()).exception)
    shutil.copytree(TREES, Path.cwd() / "near" / "trees")
    assert "go there with 'cd near/trees'" in str(run(*words.split()).exception)


def test_chosen_trees_folder_is_printed_to_stderr(run: Run, trees: Path) -> None:
    for words in (("check",), ("test", "-k", "own words"), ("explain", "wait")):
        assert f"trees folder: {trees}\n" in run(*words).stderr, words
    assert run("check", "trees").stderr == ""
    assert run("check", "--format", "json").stderr == ""
    shown = run("show", "attentive_guide", "--dir", "shipped")
    assert shown.exit_code == 0
    assert "trees folder: " in shown.stderr


def test_demo_uses_installed_trees_by_default(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[Path] = []
    monkeypatch.setattr(demo, "Interrupt", lambda: None)
    monkeypatch.setattr(demo, "run_system", lambda *given: taken.append(given[2].resolve()))
    assert f"trees folder: {TREES.resolve()}" in run("demo").stderr
    here = Path.cwd() / "trees"
    here.mkdir()
    shutil.copy(TREES / "scene.yaml", here)
    run("demo")
    run("demo", "--script", "mine.yaml")
    shutil.copytree(TREES / "scripts", here / "scripts")
    run("demo")
    assert taken == [TREES.resolve(), TREES.resolve(), here, here]


def test_demo_with_script_takes_all_agents(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[str] = []
    monkeypatch.setattr(demo, "Interrupt", lambda: None)
    monkeypatch.setattr(demo, "run_system", lambda *given: taken.append(given[3]))
    for words in ((), ("--script", "mine.yaml"), ("--script", "mine.yaml", "--tags", "ward")):
        run("demo", *words)
    assert taken == ["airport", "", "ward"]


def learn(trees: Path, age: float) -> Path:
    kept = claim_state(trees)
    with Ledger(kept.ledger) as ledger:
        ledger.enter({"attentive_guide": PROFILE})
        ledger.append("attentive_guide", PROFILE | {"age": age}, RevisionCause(source="anna"))
    return kept.ledger


def test_ledger_is_read_offline_per_trees_folder(
    run: Run, trees: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "nothing was learned in" in str(run("profile").exception)
    ledger = learn(trees, 4.5)
    before = ledger.read_bytes()
    assert json.loads(run("profile", "--json").stdout)[0]["age"] == 4.5
    lines = run("profile", "history", "attentive_guide").stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["revision", "0", "1"]
    assert "age 3 → 4.5" in lines[2]
    assert "2 revisions are as they were written" in run("profile", "check").stdout
    assert run("profile", "export", "out.json").stdout == "1 profile written to out.json\n"
    assert ledger.read_bytes() == before
    other = tmp_path / "other"
    shutil.copytree(trees, other / "trees")
    monkeypatch.chdir(other)
    copied = run("profile")
    assert "is a copy of" in copied.stderr
    assert "nothing was learned in" in str(copied.exception)
    # A given state folder is read whichever system runs.
    assert run("profile", "--state", str(other / "robot")).exit_code == 1


def test_ledger_is_readable_during_writes(run: Run, trees: Path) -> None:
    with Ledger(learn(trees, 4.0)) as open_one:
        open_one.append("attentive_guide", PROFILE | {"age": 4.2}, RevisionCause(source="anna"))
        assert json.loads(run("profile", "--json").stdout)[0]["age"] == 4.2


def test_tunings_are_read_offline(run: Run, trees: Path) -> None:
    assert "nothing was tuned in" in str(run("tune", "--history").exception)
    kept = claim_state(trees)
    with ThreadPoolExecutor(1) as disk:
        log = ChangeLog(kept.tunings, disk)
        change = TuningChange(name="attentive_guide.patience", before=8.0, after=12.0)
        cause = TuningCause(author="anna", reason="slow")
        revision = TuningRevision(number=1, stamp=time.time(), cause=cause, changes=(change,))
        log.write(log.history.with_revision(revision, {change.name: 8.0}))
        assert "slow" in run("tune", "--history").output
        log.close()
    row = json.loads(run("tune", "--history", "--json").stdout)[0]
    assert (row["name"], row["after"], row["author"]) == ("attentive_guide.patience", 12.0, "anna")
    assert run("tune", "quick", "--history", "--json").stdout == "[]\n"
    assert run("tune", "--state", "there", "patience=3").exit_code == 2


def test_decision_is_read_from_journal_offline(run: Run, trees: Path, tmp_path: Path) -> None:
    assert "there is no journal in" in str(run("why").exception)
    kept = claim_state(trees)
    kept.journal.mkdir()
    journaled = morning(tmp_path / "journaled")
    stop = {"event": RunMsg.CANCELLING, "stopped_by": RunMsg.OPERATOR, "stop_reason": "it is late"}
    stopped = RunMsg(epoch=EPOCH, round=4, agent="attentive_guide", **stop)
    journaled.publish("/bt_agents/runs", stopped)
    journaled.write(kept.journal / "journal-2026-05-04_001.mcap")
    last = run("why")
    assert last.exit_code == 0
    said = "attentive_guide was told to stop (operator): it is late\n"
    assert last.stdout.endswith(said)
    assert said not in run("why", "1").stdout
    assert run("why", "1").stdout.startswith("round 1")
    assert json.loads(run("why", "1", "--json").stdout)["round"] == 1
    assert "no decision of round 9" in str(run("why", "9").exception)
    assert run("journal").exit_code == 0
