# SPDX-License-Identifier: Apache-2.0
"""Memory: its file is read completely or not at all, its estimates follow the formulas."""

from __future__ import annotations

import json
import math
import stat
from dataclasses import replace
from pathlib import Path

import numpy
import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import SceneParameter, SceneSpace
from scene_layer import memory
from scene_layer.memory import DRIFT_S, FADES, MOST_KNOWN, KnownPerson, Memory, Running

AGE = SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0)
SPACE = SceneSpace(parameters=(AGE,))
ANNA = KnownPerson(
    visits=2, values={"age": Running(mean=4.0, scatter=0.5, weight=2.0, at=7.0)}, seen_at=8.0
)
GOOD = memory.to_text({"anna": ANNA}, {"lobby": ANNA})


NOW = 1000.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "memory.json"


def test_written_memory_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "state" / "memory.json"
    assert memory.read_memory(path, SPACE, NOW) == ({}, {})
    memory.save_memory(path, {"anna": ANNA}, {"lobby": ANNA})
    assert json.loads(path.read_text())["persons"]["anna"]["visits"] == 2
    assert memory.read_memory(path, SPACE, NOW) == ({"anna": ANNA}, {"lobby": ANNA})
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.write_text(" \n")
    assert memory.read_memory(path, SPACE, NOW) == ({}, {})


def test_size_limit_drops_entries_seen_longest_ago() -> None:
    persons = {f"p{at}": replace(ANNA, seen_at=float(at)) for at in range(100)}
    places = {"lobby": replace(ANNA, seen_at=98.5), "café": replace(ANNA, seen_at=0.5)}
    text = memory.to_text(persons, places, 1000)
    assert 900 < len(text.encode()) <= 1000
    kept = memory.from_text(text, SPACE, NOW)
    count = len(kept[0])
    assert kept == ({f"p{at}": persons[f"p{at}"] for at in range(100 - count, 100)},
                    {"lobby": places["lobby"]})  # fmt: skip
    assert memory.from_text(memory.to_text(persons, places), SPACE, NOW) == (persons, places)


def test_full_memory_is_read_back_during_a_visit(path: Path) -> None:
    full = Memory(SPACE)
    full.restore({f"p{at}": replace(ANNA, seen_at=float(at)) for at in range(MOST_KNOWN)}, {})
    full.came("ben", 2000.0)
    memory.save_memory(path, *full.snapshot({"ben"}))
    found, _ = memory.read_memory(path, SPACE, 3000.0)
    assert found["ben"].visits == 1
    assert len(found) == MOST_KNOWN + 1


def test_future_timestamps_are_clamped_to_now() -> None:
    for known in (one for found in memory.from_text(GOOD, SPACE, 2.0) for one in found.values()):
        assert (known.seen_at, known.values["age"].at) == (2.0, 2.0)


def changed(**person: object) -> str:
    document = json.loads(GOOD)
    document["persons"]["anna"].update(person)
    return json.dumps(document)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD[: len(GOOD) // 2], "Expecting|Unterminated"),
        ('{"format": 1, "persons": ' + "[" * 100_000, "not a memory"),
        ('{"format": 1, "persons": {}}', "no 'places'"),
        (changed(visits=10**400), "visits, expected a whole number"),
        (changed(values={"age": [10**400, 1.0, 1.0, 0.0]}), "too large"),
        ('{"format": 1, "persons": [], "places": {}}', "not a memory"),
        ('{"format": 1, "persons": {"a": 1}, "places": {}}', "not a memory"),
        (changed(visits=-1), "-1 visits"),
        (changed(visits=True), "True visits"),
        (changed(seen_at=None), "None, expected a number"),
        (changed(seen_at=float("nan")), "nan, expected a finite number"),
        (changed(values={"age": [1.0]}), "not enough values"),
        (changed(values={"age": [4.0, -1.0, 1.0, 0.0]}), "negative scatter"),
        (changed(values={"age": [4.0, 1.0, 0.0, 0.0]}), "negative scatter or weight"),
        (GOOD.replace("anna", "x" * 300), "a name of 300 characters"),
    ],
)
def test_damaged_file_is_rejected_as_a_whole(path: Path, text: str, words: str) -> None:
    path.write_text(text)
    with pytest.raises(memory.DamagedMemoryError, match=words) as refused:
        memory.read_memory(path, SPACE, NOW)
    assert str(path) in str(refused.value)
    assert len(str(refused.value)) < 1000


def test_non_text_or_oversized_file_is_damaged(path: Path) -> None:
    path.write_bytes(GOOD.replace("anna", "XXX").encode().replace(b"XXX", b"\xff\xfe\x00"))
    with pytest.raises(memory.DamagedMemoryError, match="is not text"):
        memory.read_memory(path, SPACE, NOW)
    with path.open("r+b") as opened:
        opened.truncate(memory.MOST_BYTES + 1)
    with pytest.raises(memory.DamagedMemoryError, match="bytes"):
        memory.read_memory(path, SPACE, NOW)


@pytest.mark.parametrize(
    "content",
    [b"SQLite format 3\x00", b"\xff\xfe", b"[]", b"null", b'{"format": 2}', b"format: 1"],
)
def test_file_of_another_program_is_not_damaged(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(BtAgentsError, match=r"is not a memory.*name another file") as refused:
        memory.read_memory(path, SPACE, NOW)
    assert not isinstance(refused.value, memory.DamagedMemoryError)


def test_folder_is_not_a_memory(tmp_path: Path) -> None:
    with pytest.raises(BtAgentsError, match="is a folder, expected a file") as refused:
        memory.read_memory(tmp_path, SPACE, NOW)
    assert not isinstance(refused.value, memory.DamagedMemoryError)


def test_values_of_removed_parameters_are_dropped() -> None:
    text = changed(values={"age": [9.0, 1.0, 1.0, 0.0], "gone": [1.0, 1.0, 1.0, 0.0]})
    persons, _ = memory.from_text(text, SPACE, NOW)
    assert persons["anna"].values == {}


def test_damaged_files_are_kept_under_unique_names(path: Path) -> None:
    for text in ("first", "second"):
        path.write_text(text)
        memory.set_aside(path)
    assert sorted((p.name, p.read_text()) for p in path.parent.iterdir()) == [
        ("memory.json.damaged", "first"),
        ("memory.json.damaged1", "second"),
    ]


# Estimates


def running(*samples: tuple[float, float, float]) -> Running:
    """Return the estimate after samples of value, standard deviation and confidence."""
    found = Running()
    for value, std, confidence in samples:
        found = found.after(value, std, confidence, 0.0)
    return found


@pytest.mark.parametrize("count", [1, 2, 7, 300])
def test_estimate_is_weighted_mean_and_scatter_of_measurements(count):
    random = numpy.random.default_rng(count)
    values, stds = random.uniform(1.0, 5.0, count), random.uniform(0.0, 1.0, count)
    confidences = random.uniform(0.1, 1.0, count)
    found = running(*zip(values, stds, confidences, strict=True))
    weights = confidences * FADES ** numpy.arange(count - 1, -1, -1)
    mean = numpy.average(values, weights=weights)
    assert found.mean == pytest.approx(mean)
    assert found.weight == pytest.approx(weights.sum())
    assert found.scatter == pytest.approx(
        (weights * ((values - mean) ** 2 + stds**2)).sum(), abs=1e-12
    )


@pytest.mark.parametrize("age_s", [0.0, 1.0, 600.0, DRIFT_S, 1e7])
def test_uncertainty_grows_by_the_documented_formula(age_s):
    assert AGE.ignorance == 4.0 / math.sqrt(12.0)
    known = (0.5 + AGE.ignorance**2) / (2.0 + 1.0)
    expected = known + (AGE.ignorance**2 - known) * (1.0 - math.exp(-2.0 * age_s / DRIFT_S))
    found = Running(mean=4.0, scatter=0.5, weight=2.0, at=0.0)
    assert found.std(AGE.ignorance, age_s) == pytest.approx(math.sqrt(expected))


def test_snapshot_is_unaffected_by_later_changes():
    memory = Memory(SPACE)
    memory.came("anna", 0.0)
    memory.measured("anna", "age", 4.0, 0.0, 1.0, 0.0)
    memory.left("anna", "lobby", known=True, now=1.0)
    persons, places = memory.snapshot()
    memory.came("anna", 2.0)
    memory.measured("anna", "age", 1.0, 0.0, 1.0, 3.0)
    memory.left("anna", "lobby", known=True, now=4.0)
    assert (persons["anna"].visits, persons["anna"].values["age"].mean) == (1, 4.0)
    assert (places["lobby"].visits, places["lobby"].values["age"].mean) == (1, 4.0)
