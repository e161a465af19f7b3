# SPDX-License-Identifier: Apache-2.0
"""The file of the scene layer's memory: read as a whole or not at all, kept aside when damaged."""

from __future__ import annotations

import json
import stat
from pathlib import Path

import pytest

from bt_agents.errors import BtAgentsError
from bt_agents.scene import SceneParameter, SceneSpace
from scene_layer import memory_file
from scene_layer.memory import MOST_KNOWN, Known, Running

SPACE = SceneSpace(parameters=(SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0),))
ANNA = Known(
    visits=2, values={"age": Running(mean=4.0, scatter=0.5, weight=2.0, at=7.0)}, seen_at=8.0
)
GOOD = memory_file.to_text({"anna": ANNA}, {"lobby": ANNA})


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "state" / "memory.json"
    assert memory_file.read(path, SPACE) == ({}, {})
    memory_file.write(path, GOOD)
    assert memory_file.read(path, SPACE) == ({"anna": ANNA}, {"lobby": ANNA})
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def changed(**person: object) -> str:
    document = json.loads(GOOD)
    document["persons"]["anna"].update(person)
    return json.dumps(document)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "Expecting value"),
        (GOOD[: len(GOOD) // 2], "Expecting|Unterminated"),
        ("[" * 100_000, "not a memory"),
        ("[]", "not a memory"),
        ("null", "not a memory"),
        ('{"format": 2}', "format 2, expected 1"),
        ('{"format": 1}', "no 'persons'"),
        ('{"format": 1, "persons": [], "places": {}}', "not a memory"),
        ('{"format": 1, "persons": {"a": 1}, "places": {}}', "not a memory"),
        (changed(visits=-1), "-1 visits"),
        (changed(visits=True), "True visits"),
        (changed(seen_at=None), "None, expected a number"),
        (changed(seen_at=float("nan")), "nan, expected a finite number"),
        (changed(values={"age": [1.0]}), "not enough values"),
        (changed(values={"age": [4.0, -1.0, 1.0, 0.0]}), "negative scatter"),
        (changed(values={"age": [4.0, 1.0, 0.0, 0.0]}), "negative scatter or weight"),
        (changed(values={"age": ["4", 1.0, 1.0, 0.0]}), "'4', expected a number"),
        (changed(values={"age": [float("inf"), 1.0, 1.0, 0.0]}), "inf, expected a finite"),
        (GOOD.replace("anna", "x" * 300), "a name of 300 characters"),
        (
            json.dumps(
                {"format": 1, "persons": dict.fromkeys(map(str, range(2000))), "places": {}}
            ),
            f"2000 names, expected {MOST_KNOWN}",
        ),
    ],
)
def test_a_damaged_file_is_refused_as_a_whole(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "memory.json"
    path.write_text(text)
    with pytest.raises(BtAgentsError, match=words) as refused:
        memory_file.read(path, SPACE)
    assert str(path) in str(refused.value)
    assert len(str(refused.value)) < 1000


def test_a_file_that_is_no_text_or_too_large_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "memory.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BtAgentsError, match="is not text"):
        memory_file.read(path, SPACE)
    with path.open("wb") as opened:
        opened.truncate(memory_file.MOST_BYTES + 1)
    with pytest.raises(BtAgentsError, match="bytes, expected"):
        memory_file.read(path, SPACE)


def test_values_that_the_parameters_do_not_have_any_more_are_left_out() -> None:
    text = changed(values={"age": [9.0, 1.0, 1.0, 0.0], "gone": [1.0, 1.0, 1.0, 0.0]})
    persons, _ = memory_file.from_text(text, SPACE)
    assert persons["anna"].values == {}


def test_damaged_files_are_kept_aside_each_under_a_name_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "memory.json"
    for text in ("first", "second"):
        path.write_text(text)
        memory_file.set_aside(path)
    assert sorted((p.name, p.read_text()) for p in tmp_path.iterdir()) == [
        ("memory.json.damaged", "first"),
        ("memory.json.damaged1", "second"),
    ]
