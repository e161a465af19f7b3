# SPDX-License-Identifier: Apache-2.0
"""Process that reads recordings for the pages of a studio, and its client in the studio.

Reading is slow, so a thread of the studio would delay current messages. The process receives a
line of JSON for each moment, timeline or excerpt. It answers with a line that reports success
and the length of the message for the page, followed by that message; an excerpt is written to a
file instead. It ends with its standard input.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_studio.protocol import Events, Failure, Moment, encode
from bt_agents_studio.recordings import Recordings

LIMIT_S = 60.0
"""Longest wait for one answer [s]."""

_FOUND, _PART, _FAILURE = b"found", b"part", b"failure"
_END_S = 2.0
_NICENESS = 5
_LARGEST_ANSWER = 256 * 1024 * 1024


@dataclass(frozen=True, kw_only=True)
class RecordedAnswer:
    """Encoded message with the content of a recording, or with the reason why it is unreadable.

    Attributes:
        is_whole: The recording has been read to its end; see :meth:`Recordings.moment`.
    """

    text: str
    is_failure: bool = False
    is_whole: bool = True


class JournalWorker:
    """Client of the process, which starts at the first request and answers one at a time.

    Args:
        mood: The scene parameter that is the mood; empty for none.
        namespace: Namespace of the system.
    """

    def __init__(self, mood: str, namespace: str) -> None:
        self._arguments = (mood, namespace)
        self._turn = asyncio.Lock()
        self._process: asyncio.subprocess.Process | None = None
        self._is_closed = False

    async def moment(self, file: Path, at_s: float, *, waits: bool) -> RecordedAnswer:
        """Return a moment, or why it cannot be shown; see :meth:`Recordings.moment`."""
        return await self._ask(file, at_s=at_s, waits=waits)

    async def events(self, file: Path) -> RecordedAnswer:
        """Return the timeline, or why it cannot be shown; see :meth:`Recordings.events`."""
        return await self._ask(file, at_s=None)

    async def write_excerpt(
        self, file: Path, from_s: float, to_s: float, into: Path, *, waits: bool
    ) -> RecordedAnswer:
        """Write an excerpt, or return why there is none; see :meth:`Recordings.write_excerpt`."""
        return await self._ask(file, from_s=from_s, to_s=to_s, into=str(into), waits=waits)

    async def _ask(self, file: Path, **fields: float | str | None) -> RecordedAnswer:
        request = {"file": str(file), **fields}
        async with self._turn:
            try:
                async with asyncio.timeout(LIMIT_S):
                    return await self._answer(json.dumps(request))
            except TimeoutError:
                reason = f"'{file.name}' was not read within {LIMIT_S:g} s"
            except (OSError, ValueError, asyncio.IncompleteReadError):
                reason = f"'{file.name}' cannot be read: the process that reads it has ended"
            except asyncio.CancelledError:
                await self._end()
                raise
            await self._end()
            failure = Failure(code=RefusalCode.UNREADABLE, message=reason)
            return RecordedAnswer(text=encode(failure), is_failure=True)

    async def close(self) -> None:
        """End the process; requests get no answer any more."""
        self._is_closed = True
        await self._end()

    async def _answer(self, request: str) -> RecordedAnswer:
        if self._is_closed:
            raise OSError("the studio ends")
        if self._process is None or self._process.returncode is not None:
            # In a session of its own, so that Ctrl-C reaches only the studio.
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", __name__, *self._arguments),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                start_new_session=True,
            )
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(request.encode() + b"\n")
        await process.stdin.drain()
        kind, length = (await process.stdout.readline()).split()
        if int(length) > _LARGEST_ANSWER:
            raise ValueError(f"an answer of {int(length)} bytes")
        text = (await process.stdout.readexactly(int(length))).decode()
        return RecordedAnswer(text=text, is_failure=kind == _FAILURE, is_whole=kind != _PART)

    async def _end(self) -> None:
        process = self._process
        if process is None:
            return
        if process.returncode is None:
            process.kill()
        with suppress(TimeoutError):
            async with asyncio.timeout(_END_S):
                await process.wait()
        # Only now, so that "close" also waits while a cancelled request ends the process.
        self._process = None


def main() -> None:
    """Answer requests until the standard input ends."""
    os.nice(_NICENESS)
    # Printed text must not corrupt the answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    mood, namespace = sys.argv[1:]
    recordings = Recordings(mood, namespace)
    for line in sys.stdin:
        message = _message(recordings, json.loads(line))
        text = encode(message).encode() if message is not None else b""
        answers.write(b"%s %d\n%s" % (_kind_of(message), len(text), text))
        answers.flush()


def _message(
    recordings: Recordings, request: Mapping[str, Any]
) -> Moment | Events | Failure | None:
    try:
        file = Path(request["file"])
        if "into" in request:
            span = request["from_s"], request["to_s"]
            recordings.write_excerpt(file, *span, Path(request["into"]), waits=request["waits"])
            return None
        if request["at_s"] is None:
            return recordings.events(file)
        return recordings.moment(file, request["at_s"], waits=request["waits"])
    except Refused as refused:
        return Failure(code=refused.code, message=refused.reason)


def _kind_of(message: Moment | Events | Failure | None) -> bytes:
    if isinstance(message, Failure):
        return _FAILURE
    answer = message.snapshot if isinstance(message, Moment) else message
    return _FOUND if answer is None or answer.is_whole else _PART


if __name__ == "__main__":
    main()
