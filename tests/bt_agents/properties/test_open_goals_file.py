# SPDX-License-Identifier: Apache-2.0
"""File of open goals: reading returns what was written, even if the writer was killed."""

from __future__ import annotations

import os
import stat
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents.host.environment.open_goals_file import OpenGoalsFile
from bt_agents_core.open_goals import MOST_OPEN_GOALS, OpenGoal
from memory_folder import memory_folder

ids = st.binary(min_size=16, max_size=16).filter(any)
goals = st.builds(
    OpenGoal,
    path=st.text(max_size=300),
    action=st.sampled_from(["/say", "/Robot_2/drive", "/a" * 80]),
    goal_id=ids,
)
lists = st.lists(goals, max_size=5)


def reread(path: Path) -> tuple[OpenGoal, ...]:
    with closing(OpenGoalsFile(path)) as file:
        return file.read()


def write_all(path: Path, written: list[list[OpenGoal]]) -> None:
    with closing(OpenGoalsFile(path)) as file:
        file.read()
        for one in written:
            file.write(one)


@given(starts=st.lists(st.lists(lists, max_size=4), min_size=1, max_size=3))
def test_restart_reads_the_last_written_list(starts: list[list[list[OpenGoal]]]):
    with memory_folder() as folder:
        path = folder / "state" / "open-goals"
        last: list[OpenGoal] = []
        for written in starts:
            write_all(path, written)
            last = [*last] if not written else written[-1]
            assert list(reread(path)) == last


@given(written=st.lists(lists, min_size=2, max_size=4), torn=lists, data=st.data())
def test_torn_write_keeps_the_previous_list(
    written: list[list[OpenGoal]], torn: list[OpenGoal], data: st.DataObject
):
    with memory_folder() as folder:
        path = folder / "open-goals"
        write_all(path, written)
        before = path.read_bytes()
        write_all(path, [torn])
        after = path.read_bytes().ljust(len(before), b"\0")
        before = before.ljust(len(after), b"\0")
        changed = [at for at in range(len(after)) if before[at] != after[at]]
        cut = data.draw(st.integers(0, len(changed)))
        # The system writes bytes in order, so a kill leaves a prefix.
        mixed = bytearray(before)
        for at in changed[:cut]:
            mixed[at] = after[at]
        path.write_bytes(mixed)
        expected = (written[-1], torn) if cut == len(changed) else (written[-1],)
        assert list(reread(path)) in expected


@given(damage=st.binary(max_size=400))
def test_damaged_file_reads_as_empty(damage: bytes):
    with memory_folder() as folder:
        path = folder / "open-goals"
        path.write_bytes(damage)
        assert reread(path) == ()


def test_file_holds_maximum_number_of_goals(tmp_path: Path):
    many = [
        OpenGoal(
            path="😀" * 200,
            action="/" + "a" * 170,
            goal_id=bytes([1 + n // 200, n % 200, *([7] * 14)]),
        )
        for n in range(MOST_OPEN_GOALS)
    ]
    write_all(tmp_path / "f", [many, many[1:]])
    assert list(reread(tmp_path / "f")) == many[1:]
    with (tmp_path / "f").open("r+b") as opened:
        opened.seek(0)
        opened.write(b"x")
    assert list(reread(tmp_path / "f")) in (many, many[1:])


def test_file_is_locked_by_one_process_and_private(tmp_path: Path):
    first = OpenGoalsFile(tmp_path / "f")
    with pytest.raises(OSError, match="temporarily unavailable"):
        OpenGoalsFile(tmp_path / "f")
    first.close()
    OpenGoalsFile(tmp_path / "f").close()
    assert stat.S_IMODE(os.stat(tmp_path / "f").st_mode) == 0o600
