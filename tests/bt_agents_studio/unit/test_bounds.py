# SPDX-License-Identifier: Apache-2.0
"""Bounds of a studio's entries and bytes, whatever it receives."""

from __future__ import annotations

import json
import random
import time
from string import ascii_letters
from types import SimpleNamespace
from typing import Any

import pytest

from bt_agents_interfaces.msg import (
    AgentCard,
    AgentFiles,
    Auction,
    HostCard,
    MarketStatus,
    Profiles,
    RecordingStatus,
    Run,
)
from bt_agents_studio import node
from bt_agents_studio.history import History
from bt_agents_studio.node import Handover
from bt_agents_studio.projection.health import FAILURES, ROOM
from bt_agents_studio.projection.recording import RECORDING
from bt_agents_studio.records import MOST_ENTRIES, FileRecord, MoodRecord
from bt_agents_studio.store import MOST_BYTES, Change, Store, encode_value, size_of
from bt_agents_studio.studio import Studio
from studio_harness import SPACE

KIB = 1024


def text(size: int = KIB) -> FileRecord:
    return FileRecord(text="x" * size)


def test_least_recently_changed_entry_is_evicted_first() -> None:
    store = Store({"files": 2})
    for key, size in (("a", 1), ("b", 1), ("a", 2), ("c", 1)):
        store.put("files", key, text(size))
    assert store.keys("files") == ("a", "c")
    assert store.dropped == {"files": 1}


def test_largest_collection_makes_room() -> None:
    store = Store(most_bytes=20 * KIB)
    store.put("moods", "1", MoodRecord(at_s=1.0, mood=1.0))
    for number in range(100):
        store.put("files", str(number), text())
    assert store.keys("moods") == ("1",)
    assert store.keys("files")[-1] == "99"
    assert len(json.dumps(store.snapshot(), default=vars)) < 20 * KIB


def test_entries_in_use_are_never_evicted() -> None:
    store = Store({"files": 50}, is_in_use=lambda _store, _collection, key: key.startswith("used"))
    for number in range(50):
        store.put("files", f"used{number}", text())
    store.put("files", "other", text())
    assert store.dropped == {"files": 1}
    store.remove("files", "used0")
    store.put("files", "other", text())
    store.put("files", "used50", text())
    assert store.keys("files") == tuple(f"used{number}" for number in range(1, 51))


def test_entry_exceeding_the_budget_is_dropped() -> None:
    store = Store(most_bytes=20 * KIB)
    store.put("files", "a", text(30 * KIB))
    assert store.keys("files") == ()
    store.put("files", "b", text())
    assert store.keys("files") == ("b",)


@pytest.mark.parametrize("value", ["\x01" * KIB, "ü€😀" * KIB, '"\\' * KIB, "plain" * KIB])
def test_estimated_text_size_covers_its_json(value: str) -> None:
    text = encode_value(value)
    assert json.loads(text) == value
    assert size_of("", text) >= len(json.dumps(value, ensure_ascii=False).encode())


def test_large_removed_keys_are_forgotten() -> None:
    store = Store({"files": 1})
    for number in range(2000):
        store.put("files", f"{number:020000}", text(1))
    assert store.since(1) is None
    assert sum(len(key) for _, key in store._changed) < 5 * KIB * KIB


def test_large_history_forgets_oldest_changes() -> None:
    history = History(most_bytes=20 * KIB)
    store = Store(on_change=lambda change: history.record(float(store.sequence), change))
    numbers = random.Random(1)
    noise = ["".join(numbers.choices(ascii_letters, k=KIB)) for _ in range(100)]
    for one in noise:
        store.put("files", "a", FileRecord(text=one))
    assert 50 < history.first_s < 100
    for number in range(int(history.first_s), 101):
        assert json.loads(history.at(float(number)))["files"]["a"] == {"text": noise[number - 1]}


def test_huge_change_is_still_the_last_moment() -> None:
    history = History(most_bytes=KIB)
    history.record(1.0, Change(collection="files", key="a", value=encode_value(text())))
    assert (history.first_s, history.last_s) == (1.0, 1.0)
    assert json.loads(history.at(1.0))["files"]["a"] == vars(text())


def test_recording_stays_on_timeline_however_much_follows() -> None:
    studio = Studio("studio", space=SPACE, clock=lambda: 1000.0)
    send(studio, RecordingStatus(recording=True, file="a.mcap"))
    for number in range(2 * MOST_ENTRIES["events"]):
        send(studio, Auction(epoch="e", round=number))
    assert len(studio.store.keys("events")) == MOST_ENTRIES["events"]
    assert RECORDING in studio.store.keys("events")


@pytest.fixture(scope="module")
def flooded() -> Studio:
    """A studio of a running system on a ROS domain that somebody floods."""
    studio = Studio("studio", space=SPACE, clock=lambda: 1000.0)
    send(studio, HostCard(host="/agents", agents=[AgentCard(name="guide")]))
    send(studio, MarketStatus(agent="guide"))
    send(studio, Run(agent="guide", event=Run.STARTED))
    studio.beat("/agents")
    for number in range(4000):
        send(studio, Run(agent=f"a{number}", event=Run.STARTED, message="x" * 15_000))
    studio.check_parts()
    return studio


def send(studio: Studio, message: object) -> None:
    kind = f"bt_agents_interfaces/msg/{type(message).__name__}"
    studio.receive(kind, message, 1000.0, False)


def test_flood_leaves_a_bounded_view(flooded: Studio) -> None:
    view = json.dumps(flooded.store.snapshot(), default=vars)
    assert len(view) < MOST_BYTES
    assert len(flooded.history.at(0.0)) < MOST_BYTES
    for collection, key in (("agents", "guide"), ("runs", "guide"), ("hosts", "/agents")):
        assert flooded.store.get(collection, key) is not None


def test_dropped_entries_are_reported_in_health(flooded: Studio) -> None:
    told: Any = flooded.store.get("health", ROOM)
    assert told.level == "WARN"
    left = len(flooded.store.keys("runs"))
    assert int(told.values["runs"]) == 4001 - left
    assert "log" not in told.values


@pytest.mark.parametrize(
    "message",
    [
        AgentFiles(files=["a.yaml", "b.yaml"], texts=["format: 1"]),
        Profiles(agents=["guide", "other"], layers=["", ""], revisions=[1], parameters=["mood"]),
        SimpleNamespace(header=None),
    ],
)
def test_unreadable_message_is_counted_and_logged_once(
    message: object, caplog: pytest.LogCaptureFixture
) -> None:
    studio = Studio("studio", space=SPACE)
    kind = "MarketStatus" if isinstance(message, SimpleNamespace) else type(message).__name__
    for _ in range(3):
        studio.receive(f"bt_agents_interfaces/msg/{kind}", message, 1000.0, False)
    studio.check_parts()
    told: Any = studio.store.get("health", FAILURES)
    assert told.level == "ERROR"
    assert told.values[kind].startswith("3, first: ")
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith(f"{kind} cannot be shown: ")
    assert not studio.store.get("files", "a.yaml")
    assert not studio.store.keys("profiles")
    send(studio, MarketStatus(agent="guide"))
    assert studio.store.get("market") is not None


def test_number_that_json_lacks_is_refused_and_counted() -> None:
    studio = Studio("studio", space=SPACE)
    send(studio, Run(agent="guide", event=Run.STARTED, duration_s=1.0))
    send(studio, Run(agent="guide", event=Run.ENDED, duration_s=float("nan")))
    studio.check_parts()
    json.dumps(studio.store.snapshot(), default=vars, allow_nan=False)
    assert studio.store.get("runs", "guide").event == "STARTED"
    assert "Run" in studio.store.get("health", FAILURES).values


def test_failure_reasons_are_bounded_and_cleaned(caplog: pytest.LogCaptureFixture) -> None:
    studio = Studio("studio", space=SPACE)
    for number in range(100):
        studio.fail(f"Type{number}", ValueError("\x1b[31m" + "x" * 10_000))
    studio.check_parts()
    told: Any = studio.store.get("health", FAILURES)
    assert told.values["others"].startswith("70, first: ValueError: [31mxxx")
    assert len(told.values) == len(caplog.messages) == 31
    assert max(map(len, caplog.messages)) < 400
    assert "\x1b" not in "".join(caplog.messages)


def unexpected(name: str, error: Exception) -> None:
    raise AssertionError(f"{name} has failed") from error


def test_calls_are_delivered_in_order() -> None:
    done: list[int] = []
    woken: list[None] = []
    handover = Handover(lambda: woken.append(None), unexpected)
    post = handover.to(done.append)
    for number in range(3):
        post(number)
    handover.deliver(60.0)
    assert (done, len(woken), handover.waits) == ([0, 1, 2], 1, False)


@pytest.mark.parametrize(("value", "most"), [(0, node.MOST_HANDED_OVER), (HostCard(), 2)])
def test_handover_accepts_no_more_calls_when_full(value: object, most: int) -> None:
    handover = Handover(lambda: None, unexpected)
    post = handover.to(lambda _value: None)
    for _ in range(most):
        assert handover.wait_for_room(0.0)
        post(value)
    assert not handover.wait_for_room(0.0)
    handover.deliver(60.0)
    assert handover.wait_for_room(0.0)


def test_failed_call_does_not_block_others() -> None:
    done: list[int] = []
    failed: list[tuple[str, Exception]] = []
    handover = Handover(lambda: None, lambda name, error: failed.append((name, error)))

    def divide(number: int) -> None:
        done.append(1 // number)

    handover.to(divide)(0)
    handover.to(divide)(1)
    handover.deliver(60.0)
    assert done == [1]
    [(name, error)] = failed
    assert (name, type(error)) == ("divide", ZeroDivisionError)


def test_delivery_ends_within_its_time_limit() -> None:
    handover = Handover(lambda: None, unexpected)
    for _ in range(1000):
        handover.to(lambda: time.sleep(0.001))()
    handover.deliver(0.001)
    assert handover.waits
