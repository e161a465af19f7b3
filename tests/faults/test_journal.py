# SPDX-License-Identifier: Apache-2.0
"""Messages in a journal whose process is killed repeatedly."""

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


def recorded(folder: Path) -> list[int]:
    """Return the messages in the files, in whatever state the files are."""
    entries = JournalReader(sorted(folder.glob("*.mcap"))).entries()
    return [entry.decode().revision for entry in entries if entry.topic == "/bt_agents/feedback"]


def test_written_journal_survives_every_kill(system: System) -> None:
    publisher = system.ros.node.create_publisher(Feedback, "bt_agents/feedback", qos.FACTS)
    folder = system.folder / "journal"
    journal = system.start(components.journal(folder))
    number = 0
    before: list[int] = []

    def publishes_until_more_is_recorded() -> bool:
        nonlocal number
        number += 1
        publisher.publish(Feedback(revision=number, reason="x" * 200))
        return number % 10 == 0 and len(recorded(folder)) > len(before) + 10

    for kill in range(KILLS):
        if kill:
            journal.start()
        system.until(publishes_until_more_is_recorded, "more in the file")
        journal.kill()
        now = recorded(folder)
        assert now[: len(before)] == before
        before = now
    assert before == list(range(1, len(before) + 1))
    # One file per start, and one more after midnight.
    assert len(list(folder.iterdir())) in (KILLS, KILLS + 1)
    assert "Traceback" not in journal.said
