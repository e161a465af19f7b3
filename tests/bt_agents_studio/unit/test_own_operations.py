# SPDX-License-Identifier: Apache-2.0
"""The studio's own operations: answers, messages, dry runs, kept values and downloads."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor

from bt_agents.host.tuning.tunable import parameters_of
from bt_agents_interfaces.msg import Auction, Bookmark, RankedBid, RecordingStatus
from bt_agents_lab.recorder.file import JournalFile
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_studio.access import SessionRole
from bt_agents_studio.records import BookmarkRecord, ListeningRecord, StrategyRecord
from bt_agents_tools.client.write_back import ParameterState
from checkout import ROOT
from journal_fixture import recorded
from studio_entries import market
from studio_harness import ServedStudio, served

AGENT = """\
format: 1
agent: waiter
title: Waiter
description: Waits.
profile: {age: 3, familiarity: 3, mood: 3}
tunables:
  patience: {default: 5 s, min: 1 s, max: 30 s, description: how long} # a comment
tree: {wait: "${patience}"}
"""
TYPES = "bt_agents_interfaces/msg/"


async def ask(
    one: ServedStudio, operation: str, role: SessionRole = SessionRole.AUTHOR, /, **fields: Any
) -> dict[str, Any]:
    async with one.client(role) as client:
        answer = await client.post(f"/api/do/{operation}", json=fields)
        return dict(await answer.json())


@served
async def test_operators_get_the_address_of_the_page_person(one: ServedStudio) -> None:
    done = await ask(one, "person_link", SessionRole.OPERATE)
    address = f"{one.origin}/person#{one.access.token(SessionRole.PERSON)}"
    assert done["record"] == {"address": address, "is_local": True}
    for role in (SessionRole.VIEW, SessionRole.PERSON):
        assert (await ask(one, "person_link", role))["code"] == "FORBIDDEN"


@served
async def test_answers_and_messages_are_forwarded(one: ServedStudio) -> None:
    done = await ask(one, "answer", text="yes")
    assert done == {"accepted": True, "code": "", "message": "answered yes"}
    done = await ask(one, "publish", topic="door", values=["data=1"])
    assert done["message"] == "published on door"
    assert one.caller.calls == [
        ("answer", {"text": "yes"}),
        ("publish", {"topic": "door", "values": ["data=1"]}),
    ]


@pytest.mark.parametrize(
    ("name", "fields", "code"),
    [
        ("answer", {"text": 1}, "BAD_FIELD"),
        ("publish", {"topic": "a" * 1001}, "BAD_FIELD"),
        ("strategy", {"options": ["c"]}, "BAD_FIELD"),
        ("dry_run", {"across": "age", "up": "height"}, "UNKNOWN_PARAMETER"),
        ("dry_run", {"names": ["weight"], "values": [1]}, "UNKNOWN_PARAMETER"),
        ("dry_run", {"across": "age", "up": "mood", "names": ["age"], "values": [1]}, "BAD_FIELD"),
    ],
)
@served
async def test_invalid_request_is_rejected(
    one: ServedStudio, name: str, fields: dict[str, Any], code: str
) -> None:
    done = await ask(one, name, **fields)
    assert (done.get("accepted", False), done["code"]) == (False, code)
    assert one.caller.calls == []


def previewed(strategy: str) -> Any:
    ranking = [
        RankedBid(agent="young", vector=[1.0, 3.0], contributions=[0.0, 0.0]),
        RankedBid(agent="old", vector=[5.0, 3.0], contributions=[4.0, 0.0]),
    ]
    auction = Auction(
        strategy=strategy, winner="young", ranking=ranking, preview=True, tie_break="name"
    )
    return type("Answer", (), {"accepted": True, "code": "", "message": "", "auction": auction})


DRY_RUN = {"names": ["age", "mood"], "values": [1, 3], "across": "age", "up": "mood"}


@served
async def test_dry_run_asks_once_for_computable_map(one: ServedStudio) -> None:
    one.caller.previewed = previewed("manhattan")
    record = (await ask(one, "dry_run", **DRY_RUN))["record"]
    assert one.caller.calls == [("preview", {"age": 1.0, "mood": 3.0})]
    assert record["round"]["winner"] == "young"
    assert (record["map"]["agents"], record["map"]["is_asked"]) == (["old", "young"], False)
    winners = record["map"]["winners"]
    assert (winners[0], winners[-1]) == (1, 0)


@served
async def test_dry_run_samples_bounded_points_for_other_strategies(one: ServedStudio) -> None:
    one.caller.previewed = previewed("softmax")
    scene = {name: DRY_RUN[name] for name in ("names", "values")}
    record = (await ask(one, "dry_run", **scene))["record"]
    # Without sides, no map is drawn.
    assert len(one.caller.calls) == 1
    assert (record["round"]["winner"], record["map"]) == ("young", None)
    record = (await ask(one, "dry_run", **DRY_RUN))["record"]
    assert len(one.caller.calls) == 1 + 1 + 7 * 7
    assert (record["map"]["is_asked"], record["map"]["winners"]) == (True, [0] * 49)


def add_strategies(one: ServedStudio) -> None:
    """Add a market with the strategies manhattan, which is in force, and ucb."""
    infos = (
        StrategyRecord(name="manhattan", description="nearest", options=()),
        StrategyRecord(name="ucb", description="tries", options=("c",)),
    )
    one.put("market", "", replace(market(), strategies=infos))
    plain = ParameterDescriptor()
    span = FloatingPointRange(from_value=0.0, to_value=100.0)
    ranged = ParameterDescriptor(description="how much", floating_point_range=[span])
    one.caller.parameters = {
        "strategy": (plain, "manhattan"),
        "shadow_strategy": (plain, ""),
        "ucb.c": (ranged, 1.0),
    }


@served
async def test_strategy_and_options_are_set_together(one: ServedStudio) -> None:
    add_strategies(one)
    option = {"name": "c", "minimum": 0.0, "maximum": 100.0, "description": "how much"}
    read = await ask(one, "strategy")
    assert read["record"]["options"] == {"manhattan": [], "ucb": [option | {"value": 1.0}]}
    assert one.caller.calls == []
    done = await ask(one, "strategy", SessionRole.OPERATE, name="ucb", options=["c"], values=[0.5])
    assert one.caller.calls == [("set", {"strategy": "ucb", "ucb.c": 0.5})]
    assert done["message"] == "ucb ranks the bids from the next round on"
    assert done["record"]["options"]["ucb"] == [option | {"value": 0.5}]


@pytest.mark.parametrize(
    ("fields", "code", "words"),
    [
        (
            {"name": "ucbb", "values": [1]},
            "UNKNOWN_STRATEGY",
            "no strategy 'ucbb'; did you mean 'ucb'?",
        ),
        (
            {"values": [1]},
            "UNKNOWN_OPTION",
            "strategy 'manhattan' has no option 'c'; there are none",
        ),
        ({"name": "ucb", "values": [101]}, "OUT_OF_RANGE", "ucb.c: 101, expected 0 to 100"),
        ({"name": "ucb", "values": [None]}, "OUT_OF_RANGE", "ucb.c: nan, expected 0 to 100"),
    ],
)
@served
async def test_invalid_strategy_is_refused_in_words(
    one: ServedStudio, fields: dict[str, Any], code: str, words: str
) -> None:
    add_strategies(one)
    done = await ask(one, "strategy", options=["c"], **fields)
    assert done == {"accepted": False, "code": code, "message": words}
    assert one.caller.calls == []


@served
async def test_refusal_of_market_is_passed_on(one: ServedStudio) -> None:
    add_strategies(one)
    one.caller.not_set = "not during the show"
    done = await ask(one, "strategy", name="ucb")
    assert done == {"accepted": False, "code": "", "message": "not during the show"}


@served
async def test_incomplete_answer_about_strategies_is_refused(one: ServedStudio) -> None:
    add_strategies(one)
    for rest in ({"ucb.c": (ParameterDescriptor(), 1.0)}, {}):
        del one.caller.parameters["ucb.c"]
        one.caller.parameters |= rest
        done = await ask(one, "strategy", name="ucb")
        assert (done["accepted"], done["code"]) == (False, "NO_ANSWER")
    assert one.caller.calls == []


@pytest.fixture
def trees(tmp_path: Path) -> Path:
    folder = tmp_path / "trees"
    (folder / "agents").mkdir(parents=True)
    shutil.copy(ROOT / "trees" / "scene.yaml", folder)
    (folder / "agents" / "waiter.yaml").write_text(AGENT)
    return folder


def tuned(trees: Path, patience: float) -> dict[str, tuple[Path, Sequence[ParameterState]]]:
    [agent] = read_trees(trees).agents
    states = [
        ParameterState(parameter=one, value=patience if one.key == "patience" else one.default)
        for one in parameters_of(agent)
    ]
    return {"/agents": (trees, states)}


@served
async def test_keep_shows_diff_then_writes_exactly_that_diff(
    one: ServedStudio, trees: Path
) -> None:
    file = trees / "agents" / "waiter.yaml"
    one.caller.hosts = tuned(trees, 20.0)
    record = (await ask(one, "keep"))["record"]
    assert "+  patience: {default: 20 s," in record["diff"]
    assert file.read_text() == AGENT
    one.caller.hosts = tuned(trees, 25.0)
    changed = await ask(one, "keep", digest=record["digest"])
    assert (changed["accepted"], changed["code"]) == (False, "CHANGED_MEANWHILE")
    assert file.read_text() == AGENT
    one.caller.hosts = tuned(trees, 20.0)
    done = await ask(one, "keep", digest=record["digest"])
    assert done["message"] == f"waiter.patience: 5 s → 20 s  in {file}"
    assert file.read_text() == AGENT.replace("default: 5 s", "default: 20 s")


@served
async def test_untuned_or_broken_file_is_not_written(one: ServedStudio, trees: Path) -> None:
    one.caller.hosts = tuned(trees, 5.0)
    done = await ask(one, "keep")
    assert (done["accepted"], done["record"]["diff"]) == (True, "")
    one.caller.hosts = tuned(trees, 20.0)
    (trees / "agents" / "waiter.yaml").write_text(AGENT + "tree: twice\n")
    done = await ask(one, "keep")
    assert not done["accepted"]
    assert "waiter.yaml" in done["message"]


@served
async def test_only_journals_are_downloadable(one: ServedStudio, tmp_path: Path) -> None:
    (tmp_path / "rosbag2_2026").mkdir()
    (tmp_path / "rosbag2_2026" / "metadata.yaml").write_text("what it holds")
    file = JournalFile(tmp_path / "journal-2026-03-01_001.mcap")
    file.add(recorded(1), 1)
    file.close()
    content = file.path.read_bytes()
    (tmp_path / "secret.sqlite").write_text("secret")
    async with one.client(SessionRole.VIEW) as client:
        found = await (await client.get("/api/journals")).json()
        assert found == [
            {"name": "rosbag2_2026", "bytes": 13, "label": ""},
            {"name": file.path.name, "bytes": len(content), "label": ""},
        ]
        answer = await client.get(f"/api/journals/{file.path.name}")
        assert await answer.read() == content
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Content-Disposition"].startswith("attachment")
        found = []
        for name in ("rosbag2_2026", "secret.sqlite", "..%2fsecret.sqlite", "%2fetc%2fpasswd"):
            refused = await client.get(f"/api/journals/{name}")
            found.append((refused.status, (await refused.json())["code"]))
        assert found == [(400, "NO_FILE"), *[(404, "NO_JOURNAL")] * 3]
    async with one.client() as client:
        assert (await client.get(f"/api/journals/{file.path.name}")).status == 401


@served
async def test_recording_and_bookmarks_are_shown_while_journal_exists(one: ServedStudio) -> None:
    studio, at_s = one.studio, 1000.0
    status = RecordingStatus(recording=True, file="a.mcap", label="class")
    studio.receive(f"{TYPES}RecordingStatus", status, at_s, False)
    for _ in range(2):  # a latched one comes again
        studio.receive(f"{TYPES}Bookmark", Bookmark(label="odd"), at_s, False)
    heard = {"door": ListeningRecord(type="std_msgs/msg/Bool", fields={"data": "boolean"})}
    studio.graph(heard, True)
    assert studio.store.get("recording").label == "class"
    assert len(studio.store.keys("bookmarks")) == 1
    assert studio.store.keys("listening") == ("door",)
    studio.graph({}, False)
    assert studio.store.get("recording") is None
    assert studio.store.keys("listening") == ()
    [mark] = studio.store.values("bookmarks", BookmarkRecord)
    assert mark.label == "odd"
