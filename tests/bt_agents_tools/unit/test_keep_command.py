# SPDX-License-Identifier: Apache-2.0
"""Keeping tuned values as defaults: the tests of their agents run first."""

from __future__ import annotations

import codecs
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters

from bt_agents.host.tuning.tunable import parameters_of
from bt_agents.host.tuning.tune_service import info_from_msg, info_to_msg
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.yaml.source import Source
from bt_agents_tools.cli.commands import keep as keeping
from bt_agents_tools.client.file_edits import FileEdit, compare_tests, edits_of
from bt_agents_tools.client.printable_messages import make_printable
from bt_agents_tools.client.write_back import ParameterState
from bt_agents_tools.rehearsal.suite import broken_by, find_tests
from checkout import ROOT

AGENT = """\
format: 1
agent: waiter
profile: {age: 3, familiarity: 3, mood: 3}
tunables: {patience: {default: 5 s, min: 1 s, max: 30 s}}
tree: {sequence: [wait: "${patience}", say: Hello.]}
"""
TESTS = """\
format: 1
test: waiter
cases:
  - {name: it does not take long, scene: {mood: 3}, expect: {within: 10 s}}
  - {name: it greets, scene: {mood: 3}, expect: {says: [Hello.]}}
  - {name: it sings, scene: {mood: 3}, expect: {says: [La.]}}
"""
SLOW = AGENT.replace("default: 5 s", "default: 20 s")


@pytest.fixture
def trees(tmp_path: Path) -> Path:
    """A trees folder with one agent that already fails a test, and tests of another."""
    folder = tmp_path / "trees"
    agents = folder / "agents"
    agents.mkdir(parents=True)
    shutil.copy(ROOT / "trees" / "scene.yaml", folder)
    shutil.copytree(ROOT / "trees" / "skills", folder / "skills")
    (agents / "waiter.yaml").write_text(AGENT)
    (agents / "waiter.test.yaml").write_text(TESTS)
    (agents / "other.yaml").write_text(AGENT.replace("agent: waiter", "agent: other"))
    (agents / "other.test.yaml").write_text(TESTS.replace("test: waiter", "test: other"))
    return folder


def edit(trees: Path, after: str) -> FileEdit:
    path = trees / "agents" / "waiter.yaml"
    return FileEdit(
        trees=trees,
        path=path,
        before=AGENT,
        after=after,
        agent=read_agent(Source(path, after), read_trees(trees).symbols),
        changes=("waiter.patience: 5 s → 20 s",),
    )


def test_only_cases_broken_by_change_are_found(trees: Path) -> None:
    [result] = broken_by(find_tests([trees]), {"waiter": edit(trees, SLOW).agent})
    assert [case.case.name for case in result.cases] == ["it does not take long"]
    compared = compare_tests([edit(trees, AGENT)])
    assert compared.lines == ("tests of waiter: all that pass now would still pass",)
    assert not compared.breaks


@pytest.mark.parametrize(
    ("value", "shown"), [("one\ntwo", "one\\ntwo"), ("", "''")], ids=["two lines", "empty"]
)
def test_kept_text_is_the_tuned_one(trees: Path, value: str, shown: str) -> None:
    path = trees / "agents" / "waiter.yaml"
    text = AGENT.replace("5 s, min: 1 s, max: 30 s", '"so\u00adfa"').replace("wait:", "say:")
    path.write_text(f"\ufeff{text}")
    words = parameters_of(read_agent(path, read_trees(trees).symbols))[0]
    info = make_printable(info_to_msg(words))
    assert info.default_value.string_value == "so\u00adfa"
    answer = GetParameters.Response(values=[ParameterValue(type=4, string_value=value)])
    [state] = [
        ParameterState(parameter=info_from_msg(info), value=one.string_value)
        for one in make_printable(answer).values
    ]
    [kept] = edits_of("/agents", trees, [state], profile=False)
    assert kept.changes == (f"waiter.patience: so\\xadfa → {shown}",)
    kept.write()
    assert path.read_bytes().startswith(codecs.BOM_UTF8)
    assert parameters_of(kept.agent)[0].default == value


def test_broken_test_file_is_named(trees: Path) -> None:
    path = trees / "agents" / "waiter.test.yaml"
    path.write_text(TESTS.replace("within", "withn"))
    [result] = broken_by([path], {"waiter": edit(trees, SLOW).agent})
    assert result.error is not None


@pytest.mark.parametrize(
    ("arguments", "typed", "code", "after"),
    [
        ((), "y\n", 0, SLOW),
        ((), "n\n", 1, AGENT),
        ((), "", 1, AGENT),
        (("--yes",), "", 0, SLOW),
        (("--dry-run",), "", 0, AGENT),
    ],
)
def test_change_that_breaks_test_requires_confirmation(
    trees: Path, monkeypatch: pytest.MonkeyPatch, arguments, typed, code, after
) -> None:
    monkeypatch.setattr(keeping, "connect", lambda: None)
    monkeypatch.setattr(keeping, "find_hosts", lambda _: ["/agents"])
    monkeypatch.setattr(keeping, "_edits", lambda *_: [edit(trees, SLOW)])
    result = CliRunner().invoke(keeping.keep, arguments, input=typed)
    assert result.exit_code == code, result.output
    assert "passes now, would fail: it does not take long  in " in result.output
    assert "it greets" not in result.output
    assert "it sings" not in result.output
    assert (trees / "agents" / "waiter.yaml").read_text() == after
