# SPDX-License-Identifier: Apache-2.0
"""Erasure of a person from journals: of all messages that name them, and of their rounds."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.person_mention import PersonMention
from bt_agents_lab.recorder.bag import COMPRESSED, is_bag
from bt_agents_lab.recorder.daily_recorder import lock_folder, newest_files
from bt_agents_lab.recorder.file import QOS, JournalFile, RecordedMessage, RecordedTopic
from bt_agents_lab.recorder.reading import JournalReader, StoredMessage

_FLUSHED = 1000

Rounds = Mapping[str, set[int]]
"""Epoch of a market → numbers of rounds in it."""


@dataclass(kw_only=True)
class ErasedJournals:
    """Result of an erasure from the journals of a folder.

    Attributes:
        messages: Number of erased messages.
        files: Files that contained them.
        in_use: File that is being written and still holds some; None for none.
        bags: Bags of ``ros2 bag`` in the folder, which stay unchanged.
        problems: Unreadable parts, which are not in the new files.
    """

    messages: int = 0
    files: tuple[Path, ...] = ()
    in_use: Path | None = None
    bags: tuple[Path, ...] = ()
    problems: tuple[str, ...] = ()


def erase_from_journals(folder: Path, person: PersonMention) -> ErasedJournals:
    """Rewrite the files of a folder without the messages about a person.

    These are the messages that name the person, and all messages of rounds and runs with such a
    message. Empty files are deleted. Sequence numbers keep their gaps, so that a replay reports
    what is missing.

    Raises:
        BtAgentsError: A file cannot be read or written; the file is then unchanged.
    """
    inside = sorted(folder.iterdir()) if folder.is_dir() else []
    paths = [one for one in inside if one.suffix == ".mcap" and one.is_file()]
    bags = tuple(one for one in inside if one.name.endswith(COMPRESSED) or is_bag(one))
    if not paths:
        return ErasedJournals(bags=bags)
    lock, open_file = -1, None
    try:
        lock = lock_folder(folder)
    except Refused:
        open_file = newest_files(folder)[-1]
    try:
        return replace(_erase(paths, open_file, person), bags=bags)
    except OSError as error:
        raise BtAgentsError(
            f"the journal in {folder} cannot be written ({error.strerror}); make room, or look at "
            "its rights, and try again"
        ) from None
    finally:
        if lock >= 0:
            os.close(lock)


def _erase(paths: list[Path], open_file: Path | None, person: PersonMention) -> ErasedJournals:
    reader = JournalReader(paths)
    rounds: defaultdict[str, set[int]] = defaultdict(set)
    for path in paths:
        for one in reader.stored(path):
            if _names(one, person) and (of := _round_of(_decoded(one))):
                epoch, number = of
                rounds[epoch].add(number)
    found = ErasedJournals(problems=tuple(reader.problems))
    for path in paths:
        messages = sum(_is_about(one, person, rounds) for one in reader.stored(path))
        if not messages:
            continue
        if path == open_file:
            found.in_use = path
            continue
        _rewrite(reader, path, person, rounds)
        found.messages += messages
        found.files += (path,)
    return found


def _rewrite(reader: JournalReader, path: Path, person: PersonMention, rounds: Rounds) -> None:
    new = path.with_name(f".{path.name}.new")
    new.unlink(missing_ok=True)
    file = JournalFile(new)
    kept = 0
    try:
        with closing(file):
            for one in reader.stored(path):
                if _is_about(one, person, rounds):
                    continue
                file.add(_recorded(one), one.message.sequence)
                kept += 1
                if kept % _FLUSHED == 0:
                    file.flush()
            file.flush()
        if kept:
            os.replace(new, path)
        else:
            path.unlink()
    finally:
        new.unlink(missing_ok=True)


def _recorded(one: StoredMessage) -> RecordedMessage:
    return RecordedMessage(
        topic=RecordedTopic(
            name=one.channel.topic,
            type=one.schema.name,
            definition=one.schema.data.decode(),
            qos=one.channel.metadata.get(QOS, ""),
        ),
        data=one.message.data,
        sent_ns=one.message.publish_time,
        received_ns=one.message.log_time,
    )


def _is_about(one: StoredMessage, person: PersonMention, rounds: Rounds) -> bool:
    if _names(one, person):
        return True
    # Decoding is slow, and most messages are of other markets or of none.
    if not any(epoch.encode() in one.message.data for epoch in rounds):
        return False
    epoch, number = _round_of(_decoded(one)) or ("", 0)
    return number in rounds.get(epoch, ())


def _names(one: StoredMessage, person: PersonMention) -> bool:
    if not person.may_be_in(one.message.data):
        return False
    message = _decoded(one)
    # An undecodable message cannot be checked, and may name the person.
    return message is None or any(map(person.is_in, _texts(message)))


def _decoded(one: StoredMessage) -> Any:
    """Return the message with its fields as attributes; None if it is damaged."""
    try:
        return one.decoder(one.message.data)
    except Exception:
        # Decoders raise any exception for broken bytes.
        return None


def _round_of(message: Any) -> tuple[str, int] | None:
    epoch, number = getattr(message, "epoch", ""), getattr(message, "round", 0)
    return (epoch, number) if epoch and number else None


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts in a message, including nested messages and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _texts(one)
    elif hasattr(value, "__slots__"):
        for name in value.__slots__:
            yield from _texts(getattr(value, name))
    elif hasattr(value, "__dict__"):
        for one in vars(value).values():
            yield from _texts(one)
