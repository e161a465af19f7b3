# SPDX-License-Identifier: Apache-2.0
"""Excerpts of a journal: a journal with the messages of the span and earlier facts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mcap.reader import make_reader
from rclpy.serialization import serialize_message

from bag_fixture import write_bag
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import AgentFiles, Auction, HostCard, Run, Scene, TreeStatus
from bt_agents_lab.node import definition_text
from bt_agents_lab.recorder.excerpt import write_excerpt
from bt_agents_lab.recorder.file import JournalFile, RecordedMessage, RecordedTopic, definition
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.decisions import replay_decisions
from bt_agents_lab.replay.findings import FindingCounts
from bt_agents_lab.replay.replay_learning import replay_feedback
from journal_fixture import JournaledSystem, index_of

Sent = tuple[int, str, Any]
"""When a message was sent [s], its topic, and the message."""


def excerpt(path: Path, from_s: float, to_s: float, **limits: int) -> Path:
    into = path.with_name("excerpt.mcap")
    into.unlink(missing_ok=True)
    reader = JournalReader([path])
    write_excerpt(reader, into, round(from_s * 1e9), round(to_s * 1e9), **limits)
    return into


def recorded_topic(kind: type, name: str) -> RecordedTopic:
    type_name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
    text = definition(type_name, definition_text)
    return RecordedTopic(name=name, type=type_name, definition=text, qos="- depth: 1")


def journal(path: Path, *sent: Sent, dropped: Sequence[int] = ()) -> Path:
    """Write a journal; dropped messages leave only a gap in the numbers."""
    file = JournalFile(path)
    numbers: dict[str, int] = {}
    for place, (at_s, name, message) in enumerate(sent):
        numbers[name] = numbers.get(name, 0) + 1
        if place in dropped:
            continue
        one = RecordedMessage(
            topic=recorded_topic(type(message), name),
            data=serialize_message(message),
            sent_ns=at_s * 10**9,
            received_ns=max(one[0] for one in sent[: place + 1]) * 10**9 + 1,
        )
        file.add(one, numbers[name])
    file.close()
    return path


def card(host: str, version: str) -> HostCard:
    return HostCard(host=host, host_instance=version)


def health(node: str, message: str) -> DiagnosticArray:
    return DiagnosticArray(status=[DiagnosticStatus(name=node, message=message)])


def contents(path: Path) -> list[tuple[str, float]]:
    """Return topic and time of sending [s] of all messages."""
    return [(one.topic, one.sent_ns / 1e9) for one in JournalReader([path]).entries()]


def sent_ns(journaled: JournaledSystem, kind: type) -> list[int]:
    """Return when messages of a type were sent [ns]."""
    return [n for n, one in enumerate(journaled.published, 1) if isinstance(one.message, kind)]


def test_excerpt_replays_equal_and_has_no_gaps(journaled: JournaledSystem, tmp_path: Path) -> None:
    whole = journaled.write(tmp_path / "a.mcap")
    _, second, third, _ = sent_ns(journaled, Auction)
    # From after the call of the second round to before the decision of the third.
    path = excerpt(whole, second * 1e-9, (third - 1) * 1e-9)
    found = index_of(path)
    assert (found.problems, found.lost, found.is_counted) == ([], {}, True)
    assert [one.auction.round for one in found.rounds] == [2]
    assert len(found.feedbacks) == 1
    replayed = FindingCounts([*replay_decisions(found.rounds), *replay_feedback(found.feedbacks)])
    assert replayed.unequal == []
    # Earlier facts come first, followed by the unchanged messages of the span.
    entries = JournalReader([path]).entries()
    inside = [one for one in entries if one.sent_ns >= second]
    facts = {one.type.rpartition("/")[2] for one in entries if one not in inside}
    assert facts == {"AgentFiles", "HostCard"}
    by_time = {one.sent_ns: one for one in JournalReader([whole]).entries()}
    assert [one.sent_ns for one in inside] == list(range(second, third))
    assert all(one.data == by_time[one.sent_ns].data for one in entries)


def test_other_programs_read_excerpt(journaled: JournaledSystem, tmp_path: Path) -> None:
    whole = journaled.write(tmp_path / "a.mcap")
    _, second, third, _ = sent_ns(journaled, Auction)
    with excerpt(whole, second * 1e-9, third * 1e-9).open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        messages = list(reader.iter_messages())
    assert summary.statistics.message_count == len(messages)
    # Nothing precedes the span: a player begins with it.
    assert messages[0][2].log_time == second
    assert {channel.topic for _, channel, _ in messages} >= {"/agents/files", "/agents/status"}
    for schema, channel, _ in messages:
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        assert b"float64" in schema.data or b"string" in schema.data


def test_excerpt_begins_with_last_of_each_fact(tmp_path: Path) -> None:
    path = journal(
        tmp_path / "a.mcap",
        (1, "/a/files", AgentFiles(host="/a")),
        (2, "/r/bt_agents/cards", card("/a", "old")),
        (3, "/r/bt_agents/cards", card("/b", "only")),
        (4, "/r/bt_agents/cards", card("/a", "new")),
        (5, "/diagnostics", health("x", "ill")),
        (6, "/diagnostics", health("y", "well")),
        (7, "/diagnostics", health("x", "well")),
        (8, "/bt_agents/scene", Scene()),
        (9, "/bt_agents/runs", Run()),
        (10, "/a/status", TreeStatus()),
        (20, "/a/status", TreeStatus()),
        (30, "/r/bt_agents/cards", card("/a", "newest")),
        (31, "/a/status", TreeStatus()),
    )
    assert contents(excerpt(path, 15, 30)) == [
        ("/a/files", 1),
        ("/r/bt_agents/cards", 3),
        ("/r/bt_agents/cards", 4),
        ("/diagnostics", 6),
        ("/diagnostics", 7),
        ("/a/status", 20),
        ("/r/bt_agents/cards", 30),
    ]


def test_excerpt_counts_only_messages_lost_in_span(tmp_path: Path) -> None:
    sent = [(second, "/a/status", TreeStatus()) for second in range(1, 11)]
    path = journal(tmp_path / "a.mcap", *sent, dropped=(1, 6, 7))
    found = index_of(excerpt(path, 5, 10))
    assert found.counts["/a/status"] == 4
    assert found.lost == {"/a/status": 2}


def test_fact_received_late_is_not_left_out(tmp_path: Path) -> None:
    path = journal(
        tmp_path / "a.mcap", (6, "/a/status", TreeStatus()), (4, "/a/files", AgentFiles())
    )
    assert contents(excerpt(path, 5, 10)) == [("/a/files", 4), ("/a/status", 6)]


def test_excerpt_of_bag_claims_no_count(journaled: JournaledSystem, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", journaled.published, files=2)
    found = index_of(excerpt(bag, 0, 1))
    assert len(found.rounds) == 4
    reader = JournalReader([bag.with_name("excerpt.mcap")])
    assert len(reader.entries()) == len(journaled.published)
    assert not reader.is_counted


@pytest.mark.parametrize(("from_s", "to_s"), [(0, 0.5), (2, 3), (5, 4)])
def test_span_without_messages_is_refused(tmp_path: Path, from_s: float, to_s: float) -> None:
    path = journal(tmp_path / "a.mcap", (1, "/a/files", AgentFiles()))
    with pytest.raises(Refused, match=r"OUT_OF_RANGE: a\.mcap has no message") as refused:
        excerpt(path, from_s, to_s)
    assert refused.value.code == "OUT_OF_RANGE"


def test_span_with_too_many_bytes_is_refused(tmp_path: Path) -> None:
    path = journal(
        tmp_path / "a.mcap",
        (1, "/a/files", AgentFiles(host="x" * 900)),
        (2, "/a/files", AgentFiles(host="x" * 900)),
        (3, "/a/status", TreeStatus(tip="x" * 400)),
    )
    # A fact replaced by a later one is omitted.
    assert len(contents(excerpt(path, 3, 3, most_bytes=1700))) == 2
    with pytest.raises(Refused, match="TOO_LARGE: the chosen span has more than 1300 bytes"):
        excerpt(path, 2, 3, most_bytes=1300)


def test_broken_part_of_journal_is_left_out(tmp_path: Path) -> None:
    path = journal(
        tmp_path / "a.mcap", *((one, "/a/status", TreeStatus(tick=one)) for one in range(1, 5))
    )
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 4])
    with pytest.raises(Refused, match=r"no message in the chosen span; .*a\.mcap"):
        excerpt(path, 1, 5)
