# SPDX-License-Identifier: Apache-2.0
"""Source text of a file, opened safely, with the position of every character; and its edits."""

from __future__ import annotations

import os
import re
import stat
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from bt_agents_core.diagnostic import Position
from bt_agents_language.diagnostics.collection import Diagnostics

MAX_BYTES = 1024 * 1024
"""Maximum size of a file; a larger one is not a script that a person wrote."""

_LINE = re.compile(r"[^\r\n]*")
_LINE_BREAK = re.compile(r"\r\n|\n|\r")
_TOP_LEVEL = re.compile(r"^[\w\"']", re.MULTILINE)
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


class Source:
    """A file's name and text; ``text`` has no byte order mark."""

    def __init__(self, file: str, text: str) -> None:
        self.file = file
        self.text = text

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *[match.end() for match in _LINE_BREAK.finditer(self.text)]]

    def position(self, index: int) -> Position:
        """Return the position of the character at ``index``; a too large index means the end."""
        starts = self._starts
        if not 0 <= index <= len(self.text):
            index = min(max(index, 0), len(self.text))
        line = bisect_right(starts, index)
        return Position(self.file, line, index - starts[line - 1] + 1)

    def line(self, number: int) -> str:
        """Return a line, counted from 1, without its line end; empty beyond the last line."""
        if not 1 <= number <= len(self._starts):
            return ""
        start = self._starts[number - 1]
        end = self._starts[number] if number < len(self._starts) else len(self.text)
        return self.text[start:end].rstrip("\r\n")


@dataclass(frozen=True, kw_only=True)
class Edit:
    """Edit: a text that replaces a range of another text, without its end index."""

    start: int
    stop: int
    text: str


class PatchedSource(Source):
    """Text with one edit applied; positions still refer to the unchanged file."""

    def __init__(self, source: Source, edit: Edit) -> None:
        before, after = source.text[: edit.start], source.text[edit.stop :]
        super().__init__(source.file, before + edit.text + after)
        self._source = source
        self._edit = edit

    def position(self, index: int) -> Position:
        edit = self._edit
        if index >= edit.start + len(edit.text):
            index += edit.stop - edit.start - len(edit.text)
        elif index > edit.start:
            index = edit.start
        return self._source.position(index)

    def line(self, number: int) -> str:
        return self._source.line(number)


def without_section(source: Source, index: int) -> PatchedSource | None:
    """Return a text without the top-level key of a character, and all below it.

    Returns:
        The text; None if nothing would be left.
    """
    starts = [match.start() for match in _TOP_LEVEL.finditer(source.text)]
    start = max((one for one in starts if one <= index), default=0)
    stop = min((one for one in starts if one > index), default=len(source.text))
    patched = PatchedSource(source, Edit(start=start, stop=stop, text=""))
    return patched if start < stop and patched.text.strip() else None


def read_source(path: Path) -> Source:
    """Return the text of a regular file in UTF-8.

    Raises:
        ReadError: The file is missing, not a regular file, too large, or not UTF-8.
    """
    file = str(path)
    data = _read_bytes(path)
    # Without its mark, too, the first letter takes two bytes there, one of them zero.
    if data.startswith(_UTF16) or data[:2].count(0) == 1:
        raise _refusal(
            file,
            "not-utf8",
            "the file is saved as UTF-16",
            "save it as UTF-8 (in the editor: Save as …, encoding UTF-8)",
        )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # It counts in its own bytes, which start after a byte order mark.
        before = error.object[: error.start].decode("utf-8", "replace")
        problems = Diagnostics(Source(file, before))
        problems.add(
            "not-utf8",
            Source(file, before).position(len(before)),
            f"the byte 0x{error.object[error.start]:02x} is not UTF-8 text",
            "save the file as UTF-8 (in the editor: Save as …, encoding UTF-8)",
        )
        raise problems.error() from None
    return Source(file, text)


def _read_bytes(path: Path) -> bytes:
    file = str(path)
    try:
        # Check before opening: opening a device or a pipe could already have an effect.
        _check_regular(file, os.stat(path).st_mode)
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as opened:
            _check_regular(file, os.fstat(descriptor).st_mode)
            data = opened.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise _refusal(file, "no-file", "there is no such file", "check the name") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise _refusal(
            file, "no-file", f"the file cannot be read: {reason}", "check its permissions"
        ) from None
    if len(data) > MAX_BYTES:
        raise _refusal(file, "too-large", *TOO_LARGE)
    return data


TOO_LARGE = (
    "the file is larger than 1 MiB",
    "split it; a script that a person wrote is a few KiB",
)


def _check_regular(file: str, mode: int) -> None:
    if stat.S_ISREG(mode):
        return
    kind = "a folder" if stat.S_ISDIR(mode) else "a pipe, socket or device"
    raise _refusal(file, "not-a-file", f"this is {kind}, not a text file", "name a file")


def _refusal(file: str, code: str, message: str, hint: str) -> Exception:
    problems = Diagnostics(None)
    problems.add(code, Position(file, 1, 1), message, hint)
    return problems.error()


def aligned(text: str, written: str) -> list[int]:
    """Return the place of every character of a value, and of its end, in the text of the file.

    Folding, indentation and escapes make the two differ, but every visible character occurs in the
    same order, so searching for one after another finds them.
    """
    whole = written.find(text)
    if whole >= 0:
        return [whole + i for i in range(len(text) + 1)]
    places: list[int] = []
    at = 0
    for character in text:
        place = -1 if character.isspace() else written.find(character, at)
        places.append(place if place >= 0 else min(at, len(written) - 1))
        at = place + 1 if place >= 0 else at
    return [*places, min(at, len(written) - 1)]


def line_start(source: Source, index: int) -> int:
    """Return the index of the first character of a line."""
    text = source.text
    return max(text.rfind("\n", 0, index), text.rfind("\r", 0, index)) + 1


def line_at(source: Source, start: int) -> str:
    """Return the line that starts at an index, without its end."""
    match = _LINE.match(source.text, start)
    return match[0] if match is not None else ""


def indentation(line: str) -> int:
    """Return the number of characters before the first visible one."""
    return len(line) - len(line.lstrip())
