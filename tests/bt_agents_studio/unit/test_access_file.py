# SPDX-License-Identifier: Apache-2.0
"""The file of tokens and sessions: private, bounded, and never fatal."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents_studio.access import LARGEST_STATE
from bt_agents_studio.access_file import AccessFile


def test_written_state_is_private_and_read_back(tmp_path: Path) -> None:
    path = tmp_path / "studio-8770.json"
    assert AccessFile(path).read() == ""
    for text in ("one", "two"):
        AccessFile(path).write(text)
        assert AccessFile(path).read() == text
        assert path.stat().st_mode & 0o777 == 0o600


def test_permissions_of_public_file_are_tightened(tmp_path: Path) -> None:
    path = tmp_path / "studio-8770.json"
    path.write_text("old")
    path.chmod(0o644)
    AccessFile(path).write("new")
    assert path.stat().st_mode & 0o777 == 0o600


def test_oversized_file_is_read_only_to_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "studio-8770.json"
    path.write_text("x" * (3 * LARGEST_STATE))
    assert len(AccessFile(path).read()) == LARGEST_STATE + 1


def test_unusable_path_is_reported_once_and_nothing_saved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    file = AccessFile(tmp_path / "file" / "studio-8770.json")
    for _ in range(3):
        file.write("text")
    assert capsys.readouterr().err.count("not kept over its restart") == 1
    broken = tmp_path / "broken.json"
    broken.write_bytes(b"\xff")
    assert AccessFile(broken).read() == ""
    assert AccessFile(None).read() == ""
