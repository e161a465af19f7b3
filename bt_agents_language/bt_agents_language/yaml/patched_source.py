# SPDX-License-Identifier: Apache-2.0
"""Source with a syntax error fixed, so that the rest of it can be read in the same pass."""

from __future__ import annotations

import re
from dataclasses import dataclass

from bt_agents_core.diagnostic import Position
from bt_agents_language.yaml.source import Source

_TOP_LEVEL = re.compile(r"^[\w\"']", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class Edit:
    """A piece of a text and what is to stand there instead.

    Attributes:
        start: Index of the first character that goes.
        stop: Index behind the last one; equal to ``start`` when nothing goes.
        text: What comes.
    """

    start: int
    stop: int
    text: str


class PatchedSource(Source):
    """A text with one edit made; places are still those of the file as it is.

    Args:
        source: The text before.
        edit: The edit.
    """

    def __init__(self, source: Source, edit: Edit) -> None:
        before, after = source.text[: edit.start], source.text[edit.stop :]
        super().__init__(source.file, before + edit.text + after)
        self._source = source
        self._edit = edit

    def position(self, index: int) -> Position:
        """Return where the character at ``index`` stands in the file."""
        edit = self._edit
        if index >= edit.start + len(edit.text):
            index += edit.stop - edit.start - len(edit.text)
        elif index > edit.start:
            index = edit.start
        return self._source.position(index)

    def line(self, number: int) -> str:
        """Return a line as it stands in the file."""
        return self._source.line(number)


def without_section(source: Source, index: int) -> PatchedSource | None:
    """Return a text without the key of the file, and all below it, that a character belongs to.

    Returns:
        None when nothing would be left.
    """
    starts = [match.start() for match in _TOP_LEVEL.finditer(source.text)]
    start = max((one for one in starts if one <= index), default=0)
    stop = min((one for one in starts if one > index), default=len(source.text))
    patched = PatchedSource(source, Edit(start=start, stop=stop, text=""))
    return patched if start < stop and patched.text.strip() else None
