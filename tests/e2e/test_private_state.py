# SPDX-License-Identifier: Apache-2.0
"""Files of a session: only their owner can read them."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from programs import Ask, Start

pytestmark = pytest.mark.e2e


@pytest.fixture
def for_everybody() -> Iterator[None]:
    """Use the umask of users who share all their files."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("for_everybody")
def test_session_files_are_private_during_and_after_run(
    start_up: Start, ask: Ask, tmp_path: Path
) -> None:
    kept = tmp_path / "kept"
    up = start_up("--state", str(kept), "--memory", "--journal")
    ask("trigger", "age=4.5", "familiarity=1", "mood=3")
    up.until("starts")
    ask("feedback", "positive", "--reason", "kind")
    ask("tune", "attentive_guide.patience=9")
    ask("veto", "silent_text")
    assert "scene layer: " in ask("forget", "anna", "--yes", "--state", str(kept))
    shared = {path: mode for path, mode in modes(kept).items() if mode not in (0o700, 0o600)}
    assert shared == {}
    names = {path.name for path in modes(kept)}
    assert {"ledger.sqlite-wal", "tunings.json.lock", "agents.log"} <= names
    assert up.stop()[0] == 0
    found = modes(kept)
    assert {mode for path, mode in found.items() if path.is_dir()} == {0o700}
    assert {mode for path, mode in found.items() if path.is_file()} == {0o600}
    names = {path.name for path in found}
    assert {
        "ledger.sqlite", "tunings.json", "orders.json", "people.json",
        "trees-folder", "journal", "agents.log",
    } <= names  # fmt: skip


def modes(folder: Path) -> dict[Path, int]:
    """Return the modes of a folder and of everything in it."""
    found = {}
    for path in (folder, *folder.rglob("*")):
        try:
            found[path] = stat.S_IMODE(path.stat().st_mode)
        except FileNotFoundError:
            # The file was replaced meanwhile.
            continue
    return found
