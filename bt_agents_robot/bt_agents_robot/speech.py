# SPDX-License-Identifier: Apache-2.0
"""Duration of speech, and the voice of the robot if a speech program is installed."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Protocol

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

CHARACTERS_PER_S = 15.0
"""Speed of calm speech: about 150 words a minute."""

PAUSE_S = 0.3
"""Pause before the first word [s]."""

LONGEST_TEXT = 2000
"""Longest text in characters; far fewer than a pipe takes without a reader."""

WORDS_PER_MINUTE = 175
"""Normal speed of eSpeak; above :data:`FASTEST_WORDS_PER_MINUTE` speech is incomprehensible."""

FASTEST_WORDS_PER_MINUTE = 450
SLOWEST_WORDS_PER_MINUTE = 80
PROGRAMS = ("espeak-ng", "espeak")


def check_text(text: str, what: str) -> str:
    """Return a text without the white space around it.

    Raises:
        Refused: ``EMPTY`` or ``TOO_LONG``.
    """
    stripped = text.strip()
    if not stripped:
        raise Refused(RefusalCode.EMPTY, f"{what} is empty; expected words")
    if len(stripped) > LONGEST_TEXT:
        raise Refused(
            RefusalCode.TOO_LONG,
            f"{what} has {len(stripped)} characters, expected at most {LONGEST_TEXT}",
        )
    return stripped


def check_rate(rate: float) -> float:
    """Return the speed of speech relative to normal; 0 means 1.

    Raises:
        Refused: ``NOT_FINITE`` or ``OUT_OF_RANGE``.
    """
    if not math.isfinite(rate):
        raise Refused(
            RefusalCode.NOT_FINITE, f"rate is {rate}, expected 0.5 to 2, or 0 for normal"
        )
    if rate != 0 and not 0.5 <= rate <= 2:
        raise Refused(
            RefusalCode.OUT_OF_RANGE, f"rate is {rate:g}, expected 0.5 to 2, or 0 for normal"
        )
    return rate or 1.0


def speaking_time(text: str, rate: float, pace: float) -> float:
    """Return the duration of a spoken text [s]; rate and pace are relative to normal."""
    return (len(text) / CHARACTERS_PER_S + PAUSE_S) / rate / pace


def espeak_command(program: str, rate: float, pace: float) -> tuple[str, ...] | None:
    """Return the command that speaks the text from its standard input.

    Returns:
        None if the pace is too fast for a voice; then the text is only shown.
    """
    words_per_minute = round(WORDS_PER_MINUTE * rate * pace)
    if words_per_minute > FASTEST_WORDS_PER_MINUTE:
        return None
    return (program, "--stdin", "-s", str(max(words_per_minute, SLOWEST_WORDS_PER_MINUTE)))


class Process(Protocol):
    """Part of :class:`subprocess.Popen` that this module uses."""

    def poll(self) -> int | None:
        """Return the exit code; None while it runs."""

    def terminate(self) -> None:
        """Ask the process to end."""


def start_process(command: Sequence[str], text: str) -> Process:
    """Start a speech program and write the text to it, never through a shell or as an argument.

    Raises:
        OSError: The program cannot be started.
    """
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    stdin = process.stdin
    if stdin is not None:
        # A program that has already ended reports that by its exit code.
        with suppress(BrokenPipeError):
            stdin.write(text.encode("utf-8", "replace"))
            stdin.close()
    return process


class Voice:
    """Voice of a child process; silent, after a warning, if the program is missing or fails."""

    def __init__(
        self,
        *,
        warn: Callable[[str], None],
        find: Callable[[str], str | None] = shutil.which,
        start: Callable[[Sequence[str], str], Process] = start_process,
    ) -> None:
        self._start = start
        self._warn = warn
        self._program = next(filter(None, map(find, PROGRAMS)), None)
        self._stopped: list[Process] = []

    def say(self, text: str, rate: float, pace: float) -> Process | None:
        """Start speaking a text; return None without sound."""
        self._stopped = [process for process in self._stopped if process.poll() is None]
        command = espeak_command(self._program, rate, pace) if self._program else None
        if command is None:
            return None
        try:
            return self._start(command, text)
        except OSError as error:
            self.disable(str(error))
            return None

    def stop(self, process: Process) -> None:
        """Stop speaking the current text."""
        if process.poll() is None:
            process.terminate()
            # The next text polls it again for its exit code, so that no zombie stays.
            self._stopped.append(process)

    def disable(self, reason: str) -> None:
        """Disable the voice and warn about the reason."""
        if self._program is not None:
            self._warn(f"no sound, texts are only shown: {self._program} failed ({reason})")
        self._program = None
