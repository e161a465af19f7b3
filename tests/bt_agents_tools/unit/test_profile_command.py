# SPDX-License-Identifier: Apache-2.0
"""`bt-agents profile` with a feedback node that answers from memory."""

from __future__ import annotations

import json
import time
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner, Result

from bt_agents_core.errors import Refused
from bt_agents_tools.cli.commands import profile as command
from bt_agents_tools.cli.main import bt_agents
from feedback_node.management.management import ManagementAction
from ledger_fixture import ManagedLedger

ANNA = "person/anna"


class ProfileCommandHarness:
    """The commands, and a management that carries out their orders."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.managed = ManagedLedger()
        self.asked: list[tuple[str, str]] = []
        monkeypatch.setattr(command, "connect", lambda: self)
        monkeypatch.setenv("COLUMNS", "200")

    def ask(self, service: str, *, action: str, find_s: float = 10.0, **fields: Any) -> Any:
        self.asked.append((service, action))
        try:
            done = self.managed.execute(ManagementAction[action], **fields)
        except Refused as refused:
            return SimpleNamespace(accepted=False, code=refused.code, message=refused.reason)
        return SimpleNamespace(
            accepted=True, code="", message=done.message, document=done.document
        )

    def run(self, *words: str, answer: str = "") -> Result:
        return CliRunner().invoke(bt_agents, ["profile", *words], input=answer)


@pytest.fixture
def harness(monkeypatch: pytest.MonkeyPatch) -> ProfileCommandHarness:
    return ProfileCommandHarness(monkeypatch)


def test_profile_table_has_row_per_layer(harness):
    harness.managed.teach("f1")
    harness.managed.teach_layer(ANNA, age=2.0)
    head, express, guide, anna = (line.split() for line in harness.run().output.splitlines())
    assert " ".join(head) == "agent for age mood revision feedbacks changed seem wrong"
    assert express[:2] == ["express", "everybody"]
    assert guide[:6] == ["guide", "everybody", "4", "3", "1", "1"]
    assert anna[:4] == ["guide", ANNA, "2", "3"]
    assert harness.run("--csv").output.splitlines()[3].startswith(f"guide,{ANNA},2.0,3.0,1,0,")
    assert json.loads(harness.run("guide", "--json").output)[0]["age"] == 4.0
    assert len(harness.run("guide").output.splitlines()) == 3
    assert harness.run("show", "guide").output == harness.run("guide").output


def test_profile_history_shows_change_author_and_reason(harness):
    harness.managed.teach("f1")
    assert harness.run("undo", "guide", "--author", "eva", "--reason", "[wrong]").output == (
        "guide: age 4 → 3 (revision 2)\n"
    )
    lines = harness.run("history", "guide").output.splitlines()
    assert [line.split()[0] for line in lines] == ["revision", "0", "1", "2"]
    assert lines[2].split()[3:] == ["direct", "t", "age", "3", "→", "4"]
    assert lines[3].split()[3:] == ["undo", "eva", "age", "4", "→", "3", "[wrong]"]
    assert '"cause": "undo"' in harness.run("history", "guide", "--json").output


def test_export_can_be_imported_without_overwriting(harness, tmp_path):
    harness.managed.teach("f1")
    file = tmp_path / "learned.json"
    assert harness.run("export", str(file)).output == f"2 profiles written to {file}\n"
    assert "File exists; choose another name" in str(harness.run("export", str(file)).exception)
    harness.run("reset", "guide")
    assert "guide: age 3 → 4" in harness.run("import", str(file)).output
    assert "was taken in before" in harness.run("import", str(file)).output
    (tmp_path / "bad.json").write_bytes(b"\xff\xfe")
    assert "cannot be read" in str(harness.run("import", str(tmp_path / "bad.json")).exception)


@pytest.mark.parametrize(
    ("text", "seconds"), [("90d", 7_776_000), ("2 weeks", 1_209_600), ("12 h", 43_200)]
)
def test_age_accepts_days_weeks_and_usual_units(harness, text, seconds):
    harness.managed.teach_layer(ANNA)
    harness.managed.now += seconds - 1
    expire = ("expire", "--yes", "--older", text)
    assert harness.run(*expire).output == "nothing to forget\n"
    harness.managed.now += 2
    assert harness.run(*expire, "--kind", "place").output == "nothing to forget\n"
    assert harness.run(*expire).output == "1 profile forgotten\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [("90", "without a unit"), ("1.5", "without a unit"), ("-3d", "more than 0"), ("soon", "90d")],
)
def test_invalid_age_forgets_no_person(harness, text, words):
    harness.managed.teach_layer(ANNA)
    refused = harness.run("expire", "--yes", f"--older={text}").exception
    assert f"BAD_AGE: --older {text}: " in str(refused)
    assert words in str(refused)
    assert harness.asked == []


def test_expire_lists_affected_persons_and_asks(harness):
    harness.managed.now = time.time() - 200 * 86_400.0
    harness.managed.teach_layer(ANNA)
    harness.managed.teach_layer("place/lobby")
    harness.managed.now = time.time()
    harness.managed.teach_layer("person/bob")
    asked = harness.run("expire", "--older", "90d", "--kind", "person", answer="n\n")
    assert (asked.exit_code, "person/anna" in asked.output) == (1, True)
    assert "bob" not in asked.output
    assert "lobby" not in asked.output
    assert harness.asked == [("feedback/manage", "HISTORY")]
    done = harness.run("expire", "--older", "90d", answer="y\n")
    assert done.output.splitlines()[-1] == "2 profiles forgotten"
    assert harness.run("expire", "--older", "90d").output == "nothing to forget\n"


def test_refusal_keeps_its_original_text(harness):
    assert str(harness.run("undo", "nobody").exception) == (
        "UNKNOWN_AGENT: no agent 'nobody'; known are: express, guide"
    )
