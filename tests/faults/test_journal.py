# SPDX-License-Identifier: Apache-2.0
"""What a journal keeps when its process is killed again and again."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents_interfaces.msg import Feedback
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_ros import qos
from bt_agents_tools.launcher import components
from processes import System

pytestmark = pytest.mark.e2e

KILLS = 4


def kept(folder: Path) -> list[int]:
    """Return what is in the file, whatever state it is in."""
    entries = JournalReader(sorted(folder.glob("*.mcap"))).entries()
    return [entry.decode().revision for entry in entries if entry.topic == "/feedback"]


def test_what_a_journal_has_written_outlives_every_kill_in_one_file(
    system: System, tmp_path: Path
) -> None:
    said = system.ros.node.create_publisher(Feedback, "feedback", qos.FACTS)
    folder = tmp_path / "journal"
    journal = system.start(components.journal(folder))
    number = 0
    before: list[int] = []

    def says_until_more_is_kept() -> bool:
        nonlocal number
        number += 1
        said.publish(Feedback(revision=number, reason="x" * 200))
        return number % 10 == 0 and len(kept(folder)) > len(before) + 10

    for kill in range(KILLS):
        if kill:
            journal.start()
        system.until(says_until_more_is_kept, "more in the file")
        journal.kill()
        now = kept(folder)
        assert now[: len(before)] == before
        before = now
    assert before == list(range(1, len(before) + 1))
    assert len({path.stem for path in folder.glob("journal-*.mcap")}) <= 2
    assert "Traceback" not in journal.said
