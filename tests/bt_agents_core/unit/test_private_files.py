# SPDX-License-Identifier: Apache-2.0
"""Private files: who may read new ones, and which files are left alone."""

from __future__ import annotations

import os
import sqlite3
import stat
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from bt_agents_core.private_files import (
    make_private_database,
    make_private_file,
    make_private_folder,
    open_private,
    tighten,
)


@pytest.fixture(params=[0o000, 0o022, 0o077], ids=oct)
def umask(request: pytest.FixtureRequest) -> Iterator[None]:
    before = os.umask(request.param)
    yield
    os.umask(before)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.usefixtures("umask")
def test_created_files_are_private_under_any_umask(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    make_private_folder(folder)
    make_private_file(folder / "file")
    assert [mode(one) for one in (folder.parent, folder, folder / "file")] == [0o700, 0o700, 0o600]


def test_existing_folder_keeps_its_mode_outside_our_root(tmp_path: Path) -> None:
    ours = tmp_path / "bt-agents"
    folder = ours / "trees" / "one"
    folder.mkdir(parents=True)
    for one in (tmp_path, ours, folder.parent, folder):
        one.chmod(0o755)
    make_private_folder(folder)
    assert mode(folder) == 0o755
    make_private_folder(folder, within=ours)
    assert mode(tmp_path) == 0o755
    assert [mode(one) for one in (ours, folder.parent, folder)] == [0o700] * 3


def test_shared_sticky_folder_is_unchanged(tmp_path: Path) -> None:
    tmp_path.chmod(0o1777)
    make_private_folder(tmp_path, within=tmp_path)
    assert mode(tmp_path) == 0o1777


def test_existing_file_is_tightened_and_keeps_content(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    for before, after in ((0o644, 0o600), (0o666, 0o600), (0o600, 0o600), (0o770, 0o700)):
        file.chmod(before)
        make_private_file(file)
        assert (mode(file), file.read_text()) == (after, "old")


def test_device_files_are_unchanged() -> None:
    device = Path(os.devnull)
    before = mode(device)
    os.close(open_private(device, os.O_WRONLY))
    tighten(device)
    tighten(Path("/no/such/file"))
    assert mode(device) == before


@pytest.mark.usefixtures("umask")
def test_database_and_its_logs_are_private(tmp_path: Path) -> None:
    file = tmp_path / "ledger.sqlite"
    make_private_database(file)
    with closing(sqlite3.connect(file, isolation_level=None)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE t (x)")
        logs = sorted(tmp_path.iterdir())
        assert [one.name.removeprefix(file.name) for one in logs] == ["", "-shm", "-wal"]
        assert [mode(one) for one in logs] == [0o600] * 3
        for one in logs:
            one.chmod(0o644)
        make_private_database(file)
        assert [mode(one) for one in logs] == [0o600] * 3
