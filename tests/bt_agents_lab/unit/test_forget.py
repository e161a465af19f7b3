# SPDX-License-Identifier: Apache-2.0
"""Forgetting a person: what is removed from a state folder, and what stays."""

from __future__ import annotations

import fcntl
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import Result

from bt_agents_core.person_mention import PersonMention
from bt_agents_core.state_folder import StateFolder, claim_state
from bt_agents_lab.recorder.erasure import erase_from_journals
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_tools.cli.connection import NoSystemError
from bt_agents_tools.cli.main import bt_agents
from command_results import split_runner
from feedback_node.ledger import Ledger
from feedback_node.ledger.rows import LAYER, RevisionCause
from journal_fixture import JournaledSystem, index_of
from market_harness import scene
from scene_layer.memory import KnownPerson, save_memory


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StateFolder:
    """Return a state folder in which every file knows carla and dora."""

    def nobody() -> None:
        raise NoSystemError("no running system")

    monkeypatch.setattr("bt_agents_tools.cli.commands.forget.connect", nobody)
    journaled = JournaledSystem(tmp_path / "trees")
    monkeypatch.chdir(tmp_path / "trees")
    state = claim_state(tmp_path / "trees", str(tmp_path / "state"))
    with Ledger(state.ledger) as ledger:
        ledger.enter({"anna": {"age": 1.0}, "bert": {"age": 4.0}})
        for name in ("carla", "dora"):
            layer = f"person/{name}"
            for agent in ("anna", "bert"):
                ledger.append(agent, {"age": 2.0}, RevisionCause(cause=LAYER), layer=layer)
    known = KnownPerson(visits=2)
    save_memory(state.memory, {"carla": known, "dora": known}, {"lobby": known})
    for name in ("dora", "carla", "dora"):
        somebody = replace(scene(f"s of {name}", 4.0, 2.0, 3.0), person_id=name)
        agent = journaled.round(somebody)
        journaled.run(agent, somebody)
    journaled.write(state.journal / "journal-2026-05-04_001.mcap")
    logs = state.path / "logs" / f"2026-05-04-100000-{2**22 + 1}"
    logs.mkdir(parents=True)
    (logs / "scene_layer.log").write_text("carla comes\ndora comes\ncarlas car\n")
    (logs / "scene_layer.log.1").write_text("hello\n'carla' goes\n")
    return state


def forget(kept: StateFolder, *arguments: str, answer: str = "") -> Result:
    command = ["forget", "carla", "--state", str(kept.path), *arguments]
    return split_runner().invoke(bt_agents, command, input=answer)


def places(kept: StateFolder, name: str) -> list[str]:
    """Return the files that name a person."""
    person = PersonMention(name)
    return sorted(
        path.name
        for path in kept.path.rglob("*")
        if path.is_file() and person.is_in(content(path).decode("latin-1"))
    )


def content(path: Path) -> bytes:
    """Return the uncompressed contents of a file."""
    if path.suffix == ".mcap":
        return b"".join(entry.data for entry in JournalReader([path]).entries())
    return path.read_bytes()


def test_person_is_removed_from_every_file_and_reported(kept: StateFolder) -> None:
    assert len(places(kept, "carla")) == 5
    others = places(kept, "dora")
    result = forget(kept, "--yes")
    assert result.exit_code == 0, result.output
    assert places(kept, "carla") == []
    assert places(kept, "dora") == others
    said = dict(line.split(": ", 1) for line in result.stdout.splitlines())
    assert said["ledger"] == f"2 profiles removed from {kept.ledger}"
    assert said["memory"] == f"carla is removed from {kept.memory}"
    assert said["journals"].endswith(f"messages removed from 1 file in {kept.journal}")
    assert said["logs"] == f"2 lines removed from 2 files in {kept.path / 'logs'}"
    again = forget(kept, "--yes")
    assert again.exit_code == 0
    removed = [line.split(": ")[1].split()[0] for line in again.stdout.splitlines()]
    assert removed == ["0", "nothing", "nothing", "0", "0"]


def test_person_is_forgotten_in_any_spelling(kept: StateFolder) -> None:
    carlas = (("person/CARLA", "CARLA"), ("person/carla\u0301", "carla\u0301"))
    with Ledger(kept.ledger) as ledger:
        for layer, _ in carlas:
            ledger.append("anna", {"age": 2.0}, RevisionCause(cause=LAYER), layer=layer)
    known = KnownPerson(visits=2)
    save_memory(kept.memory, {"Carla": known, **{name: known for _, name in carlas}}, {})
    result = split_runner().invoke(
        bt_agents, ["forget", " Carla ", "--state", str(kept.path), "--yes"]
    )
    assert result.exit_code == 0, result.output
    assert list(json.loads(kept.memory.read_text())["persons"]) == ["carla\u0301"]
    with Ledger(kept.ledger) as ledger:
        layers = {one.layer for one in ledger.layers("anna")}
    assert layers == {"person/dora", "person/carla\u0301"}
    assert places(kept, "carla") == []


def test_waiting_scene_with_person_is_left(kept: StateFolder) -> None:
    kept.orders.touch()
    kept.scenes.write_text('{"scenes": [{"scene": {"person_id": "Carla"}}]}')
    result = forget(kept, "--yes")
    assert result.exit_code == 1
    assert f"{kept.scenes}: a waiting scene" in result.stderr


def test_damaged_memory_beside_is_left_and_named(kept: StateFolder) -> None:
    aside = kept.memory.with_name("people.json.damaged")
    aside.write_text('{"persons": {"carla": ')
    kept.memory.with_name("people.json.damaged1").write_text("dora")
    result = forget(kept, "--yes")
    assert result.exit_code == 1
    assert f"files beside it name the person; delete them: {aside}\n" in result.stderr


def test_journal_keeps_other_rounds_and_counts_removed_messages(kept: StateFolder) -> None:
    [path] = kept.journal.glob("*.mcap")
    before = index_of(path)
    found = erase_from_journals(kept.journal, PersonMention("carla"))
    after = index_of(path)
    assert [one.auction.round for one in before.rounds] == [1, 2, 3]
    assert [one.auction.round for one in after.rounds] == [1, 3]
    assert found.messages == sum(before.counts.values()) - sum(after.counts.values())
    # Including messages that only belong to the person's round: ticks, and told values.
    decoded = [entry.decode() for entry in JournalReader([path]).entries()]
    assert 2 not in {getattr(message, "round", 0) for message in decoded}
    assert after.lost["/bt_agents/auctions"] == 1
    assert path.stat().st_mode & 0o777 == 0o600
    assert [one.name for one in kept.journal.iterdir()] == [path.name]


def test_nothing_is_removed_without_confirmation(kept: StateFolder) -> None:
    before = places(kept, "carla")
    assert forget(kept, answer="n\n").exit_code == 1
    assert places(kept, "carla") == before


def test_journal_being_written_is_left_and_named(kept: StateFolder) -> None:
    lock = os.open(kept.journal, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)
    try:
        result = forget(kept, "--yes")
    finally:
        os.close(lock)
    assert result.exit_code == 1
    assert "journal-2026-05-04_001.mcap is being written; end that system" in result.stderr
    assert places(kept, "carla") == ["journal-2026-05-04_001.mcap"]


def test_bag_beside_journals_is_left_and_named(kept: StateFolder) -> None:
    bag = kept.journal / "rosbag2_2026"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    (kept.journal / "b.mcap.zstd").touch()
    result = forget(kept, "--yes")
    assert result.exit_code == 1
    assert "messages removed from 1 file" in result.stderr
    assert "delete those that may name the person: b.mcap.zstd and rosbag2_2026\n" in result.stderr
    assert bag.exists()


def test_ledger_in_use_is_left_and_others_cleaned(kept: StateFolder) -> None:
    with Ledger(kept.ledger):
        result = forget(kept, "--yes")
    assert result.exit_code == 1
    assert "ledger: not done: LEDGER_IN_USE" in result.stderr
    assert places(kept, "carla") == ["ledger.sqlite"]


def test_emptied_file_is_deleted(tmp_path: Path) -> None:
    journaled = JournaledSystem(tmp_path / "trees")
    journaled.published.clear()
    journaled.round(replace(scene("s", 4.0, 2.0, 3.0), person_id="carla"))
    journaled.write(tmp_path / "journal" / "journal-2026-05-04_001.mcap")
    erase_from_journals(tmp_path / "journal", PersonMention("carla"))
    assert list((tmp_path / "journal").iterdir()) == []
    assert erase_from_journals(tmp_path / "journal", PersonMention("carla")).messages == 0


@pytest.mark.parametrize(
    ("name", "text", "is_named"),
    [
        ("anna", "person/anna is forgotten", True),
        ("anna", "annabel, hanna and anna_2", False),
        ("anna", "Anna laughed", True),
        ("änne", '{"label": "\\u00c4NNE"}', True),
        ("Änne", '{"person_id": "\\u00c4nne"}', True),
        ("Änne", "für Änne", True),
        ("7", "7", True),
        ("7", "person/7 is forgotten", True),
        ("7", "7 bids in 0.7 s, round 7", False),
        ("a.b", "aXb", False),
        ('O\'Neil "Bo"', repr('O\'Neil "Bo"') + " stands twice", True),
        ("Zoe\u0308", "Zo\u00eb comes", True),
        ("Zo\u00eb", "Zoe\u0308 comes", True),
        ("Zo\u00eb", '{"label": "ZOE\\u0308"}', True),
    ],
)
def test_person_is_matched_by_whole_word(name: str, text: str, is_named: bool) -> None:
    person = PersonMention(name)
    assert person.is_in(text) == is_named
    assert person.may_be_in(b"\xc3" + text.encode()) >= is_named
