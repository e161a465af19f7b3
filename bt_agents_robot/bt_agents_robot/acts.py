# SPDX-License-Identifier: Apache-2.0
"""Acts of the simulated robot, which begin, take time and end; without ROS."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import counted_answer, folded
from bt_agents_robot.speech import Process, Voice, check_rate, check_text, speaking_time

CLIP_S = 5.0
"""Default duration of a clip [s]."""

ANSWER_WAIT_S = 10.0
"""Default time to wait for an answer [s]."""

HEARD_SHARE = 0.3
"""Share of the expected time; a voice that ends earlier counts as silent."""

LONGEST_S = 3600.0
"""Longest time that a caller may request [s]."""

SPEED = 1.0
"""Speed of driving [m/s]."""

DISTANCES = {"here": 0.0, "information desk": 4.0, "check-in": 6.0, "lift": 8.0, "gate": 12.0}
"""Distances of the places of the simulated hall [m]."""

OTHER_DISTANCE = 3.0
"""Distance of any other place [m]."""

UNREACHABLE = "nowhere"
"""Unreachable place, for rehearsing a failure."""


class ActKind(IntEnum):
    """Kind of an act; the numbers match ``RobotAct.msg``."""

    SAY = 1
    ASK = 2
    SHOW = 3
    DRIVE = 4


class Act:
    """Act of the robot; its times are on the steady clock [s].

    Attributes:
        kind: What the robot does.
        text: Text that it says, asks or shows, or its destination.
        line: One line for people, for example ``says: Hello``.
        uses_mouth: Whether it must wait until no other act speaks.
        uses_screen: Whether a page shows it, if the robot appears in a browser.
        clip: Name of the clip that it shows; empty for none.
        choices: Valid answers; none means any.
        rate: Speed of its speech relative to normal.
        begun_at: Time of its beginning; None while it waits.
    """

    kind: ActKind
    uses_mouth = False
    uses_screen = False
    clip = ""
    choices: tuple[str, ...] = ()
    rate = 1.0

    def __init__(self, text: str, line: str, duration_s: float) -> None:
        self.text = text
        self.line = " ".join(line.split())
        self.duration_s = duration_s
        self.begun_at: float | None = None

    def begin(self, now: float) -> None:
        """Start the clock of the act."""
        self.begun_at = now

    def elapsed(self, now: float) -> float:
        """Return the time since its beginning [s]; 0 before."""
        return 0.0 if self.begun_at is None else now - self.begun_at

    def progress(self, now: float) -> float:
        """Return the completed share, 0..1."""
        if self.begun_at is None:
            return 0.0
        return min(1.0, self.elapsed(now) / self.duration_s) if self.duration_s > 0 else 1.0

    def is_over(self, now: float) -> bool:
        """Return whether a begun act has ended."""
        return self.elapsed(now) >= self.duration_s

    def is_speaking(self, _now: float) -> bool:
        """Return whether it uses the mouth now."""
        return False

    @property
    def is_waiting(self) -> bool:
        """True while it only waits for a person."""
        return False

    def stop(self) -> None:
        """End it early."""


class Say(Act):
    """Act of speaking a text.

    Raises:
        Refused: The text or the rate is invalid.
    """

    kind = ActKind.SAY
    uses_mouth = True
    uses_screen = True

    def __init__(
        self, text: str, rate: float, *, pace: float, voice: Voice | None, verb: str = "says"
    ) -> None:
        text = check_text(text, "text")
        self.rate, self._pace, self._voice = check_rate(rate), pace, voice
        self._process: Process | None = None
        self._spoken = False
        super().__init__(text, f"{verb}: {text}", speaking_time(text, self.rate, pace))

    def begin(self, now: float) -> None:
        super().begin(now)
        if self._voice is not None:
            self._process = self._voice.say(self.text, self.rate, self._pace)

    def is_speaking(self, now: float) -> bool:
        """Return whether the voice is still speaking, for at most twice the expected time."""
        if self.begun_at is None or self._spoken:
            return False
        self._spoken = self._has_spoken(self.elapsed(now))
        return not self._spoken

    def is_over(self, now: float) -> bool:
        return self.begun_at is not None and not self.is_speaking(now)

    def stop(self) -> None:
        self._spoken = True
        if self._process is not None and self._voice is not None:
            self._voice.stop(self._process)
        self._process = None

    def _has_spoken(self, elapsed: float) -> bool:
        if self._process is None:
            return elapsed >= self.duration_s
        code = self._process.poll()
        if code is None:
            if elapsed < 2 * self.duration_s:
                return False
            self.stop()
            return True
        self._process = None
        if code != 0 and self._voice is not None:
            self._voice.disable(f"exit code {code}")
        # Without a sound device, a program may end at once and still report success.
        return code == 0 and elapsed >= HEARD_SHARE * self.duration_s


class Ask(Say):
    """Act of asking a question and waiting for an answer; the answer may interrupt the question.

    Raises:
        Refused: The question or the waiting time is invalid.
    """

    kind = ActKind.ASK

    def __init__(
        self, text: str, choices: Sequence[str], wait_s: float, *, pace: float, voice: Voice | None
    ) -> None:
        super().__init__(check_text(text, "question"), 1.0, pace=pace, voice=voice, verb="asks")
        self.answer = ""
        self.choices = tuple(choice for choice in choices if choice.strip())
        if choices and not self.choices:
            raise Refused(
                RefusalCode.EMPTY, "all choices are empty; leave them out to take any answer"
            )
        self._wait_s = check_duration(wait_s, "wait_s", ANSWER_WAIT_S) / pace
        self._waiting_since: float | None = None

    def begins_waiting(self, now: float) -> bool:
        """Return True once, after the question was spoken."""
        if self._waiting_since is None and super().is_over(now):
            self._waiting_since = now
            return True
        return False

    @property
    def is_waiting(self) -> bool:
        return self._waiting_since is not None and not self.answer

    def receive(self, answer: str) -> bool:
        """Take the text of a person; return whether it counts as an answer."""
        if self.begun_at is None or self.answer:
            return False
        self.answer = counted_answer(answer, self.choices)
        if self.answer:
            self.stop()
        return bool(self.answer)

    def progress(self, now: float) -> float:
        """Return the share of speaking and waiting that is over, 0..1."""
        return min(1.0, self.elapsed(now) / (self.duration_s + self._wait_s))

    def is_over(self, now: float) -> bool:
        """Return whether it has an answer, or none came in time."""
        waited = self._waiting_since is not None and now - self._waiting_since >= self._wait_s
        return bool(self.answer) or waited


class Show(Act):
    """Act of showing a clip or a text on the display.

    Raises:
        Refused: There is nothing to show, or the duration is invalid.
    """

    kind = ActKind.SHOW
    uses_screen = True

    def __init__(self, clip: str, text: str, duration_s: float, *, pace: float) -> None:
        parts = [part for part in (clip.strip(), text.strip()) if part]
        shown = check_text(": ".join(parts), "what to show (clip and text)")
        self.clip = clip.strip()
        needed = CLIP_S if self.clip else speaking_time(shown, 1.0, 1.0)
        super().__init__(
            text.strip(),
            f"shows: {shown}",
            check_duration(duration_s, "duration_s", needed) / pace,
        )


class Drive(Act):
    """Act of driving to a place.

    Raises:
        Refused: The place is missing or unreachable.
    """

    kind = ActKind.DRIVE

    def __init__(self, destination: str, *, pace: float) -> None:
        place = check_text(destination, "destination")
        if folded(place) == UNREACHABLE:
            raise Refused(RefusalCode.UNREACHABLE, f"there is no way to '{place}'")
        self.distance = DISTANCES.get(folded(place), OTHER_DISTANCE)
        super().__init__(place, f"drives to: {place}", self.distance / SPEED / pace)

    def driven(self, now: float) -> float:
        """Return the driven distance [m]."""
        return self.distance * self.progress(now)


def check_duration(duration_s: float, what: str, default_s: float) -> float:
    """Return a duration requested by a caller; 0 means the default.

    Raises:
        Refused: ``NOT_FINITE`` or ``OUT_OF_RANGE``.
    """
    if not math.isfinite(duration_s):
        raise Refused(
            RefusalCode.NOT_FINITE, f"{what} is {duration_s}, expected seconds, or 0 for usual"
        )
    if not 0 <= duration_s <= LONGEST_S:
        raise Refused(
            RefusalCode.OUT_OF_RANGE, f"{what} is {duration_s:g} s, expected 0 to {LONGEST_S:g} s"
        )
    return duration_s or default_s
