# SPDX-License-Identifier: Apache-2.0
"""Parameters of a host: what it records, what a restart restores, and what a file overrides."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bt_agents.host.agent_registry import AgentRegistry
from bt_agents.host.tuning.change_log import ChangeLog
from bt_agents.host.tuning.history import MOST_REVISIONS, TuningAction, TuningCause
from bt_agents.host.tuning.parameter_store import FILE, ParameterStore, checked_line
from bt_agents.host.tuning.presets import Presets
from bt_agents.host.tuning.tunable import TICK_RATE, TunableParameter, parameters_of
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import FieldType
from faulty_disk import Disk
from tree_harness import SPACE, agent

HEAD = """
tunables:
  patience: {default: 8 s, min: 2 s, max: 30 s, description: how long}
  attempts: {default: 2, min: 1, max: 5}
"""
PARAMETERS = (TICK_RATE, *parameters_of(agent("wait: 0 s", HEAD)))
ANNA = TuningCause(author="anna", reason="slow today")


class Host:
    """A store with the parameters of one agent, as created at the start of a host."""

    def __init__(
        self,
        file: Path | None = None,
        parameters: tuple[TunableParameter, ...] = PARAMETERS,
        *,
        presets: Path = Path("nowhere"),
    ) -> None:
        self.told: list[str] = []
        disk = Disk()
        log = ChangeLog(file, disk) if file is not None else None
        self.changed: list[str] = []
        self.registry = AgentRegistry(SPACE, [agent("wait: 0 s", HEAD)])
        self.store = ParameterStore(
            self.registry.members,
            log,
            Presets(presets),
            disk,
            lambda: 1.0,
            self.told.append,
            lambda parameters: self.changed.extend(one.name for one in parameters),
        )
        starts = {parameter: self.store.start(parameter) for parameter in parameters}
        for parameter, (value, _why) in starts.items():
            self.store.add(parameter, value)
        self.store.overrule({one.name: why for one, (_value, why) in starts.items() if why})

    def undo(self, *agents: str) -> None:
        found, values = self.store.find(TuningAction.UNDO, agents)
        self.store.set(
            values, TuningCause(author="anna", action=TuningAction.UNDO, of=found.number)
        )


def test_values_set_together_share_one_revision(host):
    revision = host.store.set({"a.patience": 12.0, "a.attempts": 3, "tick_rate": 20.0}, ANNA)
    assert (revision.number, revision.cause) == (1, ANNA)
    assert (
        host.store.format_changes(revision.changes) == "a.patience: 8 s → 12 s, a.attempts: 2 → 3"
    )
    assert host.store.set({"a.patience": 12.0}, ANNA) is None
    assert host.store.history.revision == 1


def test_values_count_for_the_agent_at_once(host):
    member = host.registry.members["a"]
    tunables = member.tunables
    host.store.set({"a.patience": 12.0, "a.learning_rate": 0.5, "tick_rate": 30.0}, ANNA)
    assert (tunables["patience"], member.learning_rate) == (12.0, 0.5)
    assert member.tunables is tunables
    assert host.changed == ["a.patience", "a.learning_rate", "tick_rate"]


def test_one_impossible_value_of_a_set_changes_nothing(host):
    with pytest.raises(Refused, match=r"OUT_OF_RANGE: a\.attempts is 9"):
        host.store.set({"a.patience": 12.0, "a.attempts": 9}, ANNA)
    assert host.registry.members["a"].tunables == {"patience": 8.0, "attempts": 2}
    assert (host.changed, host.store.history.revision) == ([], 0)


def test_value_unchanged_since_seen_revision_is_accepted(host):
    host.store.check_unchanged({"a.patience"}, 0)
    host.store.set({"a.patience": 12.0}, ANNA)
    host.store.set({"a.attempts": 3}, ANNA)
    host.store.check_unchanged({"a.patience"}, 1)
    host.store.check_unchanged({"tick_rate"}, 0)


def test_concurrently_changed_value_is_refused_with_its_author(host):
    host.store.set({"a.patience": 12.0}, ANNA)
    with pytest.raises(Refused, match="CHANGED_MEANWHILE") as refused:
        host.store.check_unchanged({"a.attempts", "a.patience"}, 0)
    assert refused.value.reason == (
        "a.patience was changed from 8 s to 12 s by anna (revision 1), expected no change after "
        "revision 0; look at it, and set it again"
    )
    host.undo()
    with pytest.raises(Refused, match="CHANGED_MEANWHILE"):
        host.store.check_unchanged({"a.patience"}, 1)


def test_unknown_seen_revision_counts_as_changed(host):
    with pytest.raises(Refused, match="revision 7 is not known here any more"):
        host.store.check_unchanged({"a.patience"}, 7)
    for number in range(MOST_REVISIONS + 1):
        host.store.set({"a.attempts": 3 + number % 2}, ANNA)
    with pytest.raises(Refused, match="revision 0 is not known here any more"):
        host.store.check_unchanged({"a.patience"}, 0)
    host.store.check_unchanged({"a.patience"}, host.store.history.revision)


@pytest.fixture
def host() -> Host:
    return Host()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The file of a host on which one value was tuned."""
    path = tmp_path / "t.json"
    host = Host(path)
    host.store.set({"a.patience": 12.0}, ANNA)
    host.store.close()
    return path


def test_undo_without_effect_still_counts_as_undone(file):
    again = Host(file)
    launched = again.store.parameter("a.patience")
    again.store.remove("a.patience")
    again.store.add(launched, 8.0)
    again.undo()
    assert again.store.value("a.patience") == 8.0
    with pytest.raises(Refused, match="NOTHING_TO_UNDO"):
        again.undo()
    again.store.close()
    assert Host(file).store.find(TuningAction.REDO, ())[1] == {"a.patience": 12.0}


def test_restart_restores_values_and_undo_history(tmp_path):
    first = Host(tmp_path / "t.json")
    first.store.set({"a.patience": 12.0, "tick_rate": 30.0}, ANNA)
    first.store.set({"a.attempts": 4}, ANNA)
    first.undo()
    first.store.close()
    again = Host(tmp_path / "t.json")
    names = ("a.patience", "tick_rate", "a.attempts")
    assert [again.store.value(name) for name in names] == [12.0, 30.0, 2]
    again.undo()
    assert again.store.value("a.patience") == 8.0
    assert again.store.find(TuningAction.REDO, ())[1] == {"a.patience": 12.0, "tick_rate": 30.0}
    again.store.close()


PATIENCE = PARAMETERS[1]


def _changed(**changes: Any) -> tuple[TunableParameter, ...]:
    return (TICK_RATE, replace(PATIENCE, **changes), *PARAMETERS[2:])


@pytest.mark.parametrize(
    ("changes", "value", "why"),
    [
        ({"default": 6.0}, 6.0, "the file says 6 s now"),
        ({"maximum": 10.0}, 8.0, r"a.patience is 12 s, expected 2 s to 10 s"),
    ],
)
def test_changed_file_overrides_tuned_value(file, changes, value, why):
    again = Host(file, _changed(**changes))
    assert again.store.value("a.patience") == value
    revision = again.store.history.shown[-1]
    [change] = revision.changes
    assert revision.cause.author == FILE
    assert why in revision.cause.reason
    assert (change.before, change.after) == (12.0, value)
    again.store.close()
    third = Host(file, _changed(**changes)).store
    assert (third.value("a.patience"), third.history.revision) == (value, 2)


def test_tuned_value_survives_absence_of_its_agent(file):
    without = Host(file, (TICK_RATE,))
    with pytest.raises(Refused, match=r"revision 1 cannot be: its value of a\.patience is not"):
        without.store.find(TuningAction.UNDO, ())
    without.store.set({"tick_rate": 30.0}, ANNA)
    without.store.close()
    assert Host(file).store.value("a.patience") == 12.0


@pytest.mark.parametrize(
    ("changes", "value"),
    [
        ({"default": 6.0}, 6.0),
        ({"maximum": 20.0}, 12.0),
        ({"maximum": 10.0}, 8.0),
        ({"description": "how very long"}, 12.0),
    ],
)
def test_only_changed_default_or_range_replaces_tuned_value(host, changes, value):
    host.store.set({"a.patience": 12.0}, ANNA)
    assert host.store.replace(replace(PATIENCE, **changes)) == value


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.patiense", "'a' has no 'patiense'; did you mean 'a.patience'"),
        ("b.patience", "nothing here is called 'b.patience'; possible here: a"),
        ("tickrate", "nothing here is called 'tickrate'"),
        ("", "nothing here is called ''"),
        ("patience", r"whose 'patience'\? a\.patience$"),
    ],
)
def test_unknown_parameter_is_refused_with_suggestion(name, words):
    with pytest.raises(Refused, match=f"UNKNOWN_PARAMETER: {words}"):
        Host().store.read([name], ["1"])


@pytest.mark.parametrize(
    ("names", "texts", "code"),
    [
        ([], [], "WRONG_LENGTH"),
        (["a.patience"], [], "WRONG_LENGTH"),
        (["a.patience", "a.patience"], ["1", "2"], "DUPLICATE|OUT_OF_RANGE"),
    ],
)
def test_names_and_values_must_match(names, texts, code):
    with pytest.raises(Refused, match=code):
        Host().store.read(names, texts)


def test_preset_restores_tuned_and_default_values(tmp_path):
    store = Host(presets=tmp_path).store
    assert store.save("evening", ["a"])[0] == 3
    store.set({"a.patience": 12.0, "tick_rate": 30.0}, ANNA)
    assert store.save("morning", [])[0] == 3
    values = {"a.patience": 8.0, "a.attempts": 2, "a.learning_rate": 0.2}
    assert store.preset("evening") == (values, [])
    assert store.presets.get("morning").values["a.patience"] == "12 s"


def test_preset_skips_missing_and_refuses_invalid_values(tmp_path):
    store = Host(presets=tmp_path).store
    store.presets.save("old", {"a.patience": "12 s", "b.rate": "1"})
    assert store.preset("old") == ({"a.patience": 12.0}, ["b.rate"])
    store.presets.save("bad", {"a.patience": "12 s", "a.attempts": "9"})
    with pytest.raises(Refused, match=r"OUT_OF_RANGE: a\.attempts is 9, expected 1 to 5"):
        store.preset("bad")
    store.presets.save("gone", {"b.rate": "1"})
    with pytest.raises(Refused, match="NOTHING_LEFT"):
        store.preset("gone")


def test_unknown_agent_is_refused_with_suggestion(host):
    for ask in (
        lambda agents: host.store.find(TuningAction.UNDO, agents),
        lambda agents: host.store.find(TuningAction.REDO, agents),
        lambda agents: host.store.save("x", agents),
    ):
        with pytest.raises(Refused, match="UNKNOWN_AGENT: no agent 'b' here; possible here: a"):
            ask(["b"])


def test_file_change_applies_even_if_storing_fails(tmp_path, monkeypatch):
    host = Host(tmp_path / "t.json")

    def full(*_arguments: object) -> None:
        raise Refused("CANNOT_WRITE", "the disk is full")

    monkeypatch.setattr(ChangeLog, "write", full)
    with pytest.raises(Refused, match="CANNOT_WRITE"):
        host.store.set({"a.patience": 12.0}, ANNA)
    assert (host.store.value("a.patience"), host.store.history.revision) == (8.0, 0)
    host.store.set({"a.patience": 12.0}, TuningCause(author=FILE), must_be_stored=False)
    assert host.store.value("a.patience") == 12.0
    assert host.told == ["the disk is full"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x" * 301, ""),
        ("\x1b[2J", ""),
        ("two\nlines", r"'two lines', with the character '\\n'; expected"),
    ],
)
def test_external_text_must_be_one_printable_line(text, words):
    with pytest.raises(Refused, match=f"BAD_TEXT: the reason is {words}"):
        checked_line(text, "the reason")


def test_empty_text_is_shown_in_quotes():
    text = replace(PATIENCE, name="a.place", key="place", type=FieldType.TEXT, default="dock")
    store = Host(None, (text,)).store
    revision = store.set({"a.place": ""}, ANNA)
    assert store.format_changes(revision.changes) == "a.place: dock → ''"


@pytest.mark.parametrize("is_reloaded", [True, False])
def test_value_written_into_file_is_no_longer_tuned(file, is_reloaded):
    if is_reloaded:
        running = Host(file)
        assert running.store.replace(replace(PATIENCE, default=12.0)) == 12.0
        running.store.close()
    again = Host(file, _changed(default=12.0))
    assert again.store.history.revision == 1
    again.store.close()
    assert Host(file).store.value("a.patience") == 8.0
