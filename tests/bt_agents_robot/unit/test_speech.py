# SPDX-License-Identifier: Apache-2.0
"""Speech and other acts of the simulated robot, on a manual clock and without sound."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from bt_agents_core.errors import Refused
from bt_agents_robot.acts import CLIP_S, Act, ActKind, Ask, Drive, Say, Show
from bt_agents_robot.speech import (
    LONGEST_TEXT,
    Voice,
    check_rate,
    espeak_command,
    speaking_time,
    start_process,
)

TEXT = "x" * 27  # 27 / 15 + 0.3 = 2.1 s


class FakeProcess:
    """A speech program that a test ends."""

    def __init__(self) -> None:
        self.code: int | None = None
        self.terminated = False

    def poll(self) -> int | None:
        return self.code

    def terminate(self) -> None:
        self.terminated = True


class Studio:
    """A voice whose programs, processes and warnings a test sees."""

    def __init__(self, *installed: str, broken: bool = False) -> None:
        self.started: list[tuple[tuple[str, ...], str]] = []
        self.processes: list[FakeProcess] = []
        self.warnings: list[str] = []
        self.broken = broken
        self.voice = Voice(
            warn=self.warnings.append,
            find=lambda name: f"/usr/bin/{name}" if name in installed else None,
            start=self.start,
        )

    def start(self, command: Sequence[str], text: str) -> FakeProcess:
        if self.broken:
            raise PermissionError("not executable")
        self.started.append((tuple(command), text))
        self.processes.append(FakeProcess())
        return self.processes[-1]


@pytest.fixture
def studio() -> Studio:
    return Studio("espeak")


def say(text: str = TEXT, rate: float = 1.0, *, voice: Voice | None = None) -> Say:
    act = Say(text, rate, pace=1.0, voice=voice)
    act.begin(100.0)
    return act


@pytest.mark.parametrize(
    ("rate", "pace", "seconds"), [(1.0, 1.0, 2.1), (0.5, 1.0, 4.2), (1.0, 10.0, 0.21)]
)
def test_speaking_time_follows_rate_and_pace(rate, pace, seconds):
    assert speaking_time(TEXT, rate, pace) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("rate", "pace", "command"),
    [
        (1.0, 1.0, ("espeak-ng", "--stdin", "-s", "175")),
        (0.5, 0.1, ("espeak-ng", "--stdin", "-s", "80")),
        (1.0, 2.5, ("espeak-ng", "--stdin", "-s", "438")),
        (1.0, 5.0, None),
    ],
)
def test_pace_sets_the_speed_within_its_range(rate, pace, command):
    assert espeak_command("espeak-ng", rate, pace) == command


@pytest.mark.parametrize(
    ("text", "rate", "code"),
    [
        ("", 1.0, "EMPTY"),
        (" \n\t", 1.0, "EMPTY"),
        ("x" * (LONGEST_TEXT + 1), 1.0, "TOO_LONG"),
        (TEXT, math.nan, "NOT_FINITE"),
        (TEXT, math.inf, "NOT_FINITE"),
        (TEXT, 0.4, "OUT_OF_RANGE"),
        (TEXT, -1, "OUT_OF_RANGE"),
    ],
)
def test_impossible_text_or_rate_is_refused(text, rate, code):
    with pytest.raises(Refused, match=f"^{code}: "):
        say(text, rate)


def test_zero_rate_means_normal_rate():
    assert (check_rate(0.0), check_rate(2.0)) == (1.0, 2.0)


def test_text_without_program_takes_its_expected_time():
    studio = Studio()
    act = say(voice=studio.voice)
    assert not act.is_over(102.0)
    assert act.is_over(102.2)
    assert studio.warnings == []


def test_speech_ends_with_its_program(studio):
    act = say("-f /etc/passwd; rm -rf x", voice=studio.voice)
    assert studio.started == [
        (("/usr/bin/espeak", "--stdin", "-s", "175"), "-f /etc/passwd; rm -rf x")
    ]
    assert not act.is_over(102.5)
    studio.processes[0].code = 0
    assert act.is_over(102.5)
    assert not studio.processes[0].terminated


def test_espeak_ng_is_preferred():
    studio = Studio("espeak", "espeak-ng")
    say(voice=studio.voice)
    assert studio.started[0][0][0] == "/usr/bin/espeak-ng"


def test_hanging_program_is_terminated_at_twice_expected_time(studio):
    act = say(voice=studio.voice)
    assert not act.is_over(104.1)
    assert act.is_over(104.3)
    assert studio.processes[0].terminated


def test_failing_program_causes_silence_and_one_warning(studio):
    act = say(voice=studio.voice)
    studio.processes[0].code = 1
    assert not act.is_over(100.1)
    assert act.is_over(102.2)
    say(voice=studio.voice)
    assert len(studio.started) == 1
    assert len(studio.warnings) == 1
    assert "exit code 1" in studio.warnings[0]


def test_unstartable_program_causes_silence_and_one_warning():
    studio = Studio("espeak", broken=True)
    acts = [say(voice=studio.voice), say(voice=studio.voice)]
    assert [act.is_over(102.2) for act in acts] == [True, True]
    assert len(studio.warnings) == 1


@pytest.mark.parametrize("program", ["cat", "true"])
def test_program_may_ignore_text_on_stdin(program):
    process = start_process((program,), "Hello. " * 200)
    assert process.wait(timeout=10.0) == 0


def test_instantly_ending_program_still_takes_expected_time(studio):
    act = say(voice=studio.voice)
    studio.processes[0].code = 0
    assert not act.is_over(100.1)
    assert act.is_over(102.2)


def test_stop_terminates_the_program(studio):
    act = say(voice=studio.voice)
    act.stop()
    assert studio.processes[0].terminated
    assert not act.is_speaking(100.1)


def asked(*choices: str, wait_s: float = 4.0) -> Ask:
    act = Ask("Shall we go?", choices, wait_s, pace=1.0, voice=None)
    act.begin(100.0)
    return act


def test_question_begins_waiting_once_after_speech():
    act = asked()
    assert not act.is_waiting
    steps = [(act.is_speaking(now), act.begins_waiting(now)) for now in (100.5, 101.2, 101.3)]
    assert steps == [(True, False), (False, True), (False, False)]
    assert (act.is_waiting, act.is_over(101.2)) == (True, False)


def test_first_answer_ends_the_question():
    act = asked()
    act.begins_waiting(101.2)
    assert act.receive("  later ")
    assert (act.answer, act.is_over(101.3), act.is_waiting) == ("later", True, False)
    assert not act.receive("now"), "the first answer counts"


def test_early_answer_interrupts_the_question():
    act = asked()
    assert act.receive("yes")
    assert (act.is_over(100.2), act.is_speaking(100.2)) == (True, False)


def test_only_choices_count_in_any_case():
    act = asked("Yes", "No")
    assert [act.receive(answer) for answer in ("maybe", "", "YES")] == [False, False, True]
    assert act.answer == "Yes"


def test_queued_question_neither_speaks_nor_hears():
    act = Ask("Shall we go?", (), 4.0, pace=1.0, voice=None)
    assert not act.is_speaking(100.0)
    assert not act.receive("yes")


def test_question_times_out_without_answer():
    act = asked(wait_s=4.0)
    assert act.begins_waiting(101.2)
    assert [act.is_over(now) for now in (105.1, 105.3)] == [False, True]
    assert act.answer == ""


@pytest.mark.parametrize(
    ("choices", "wait_s", "words"),
    [
        (("", " "), 4.0, "EMPTY"),
        ((), math.nan, "wait_s"),
        ((), math.inf, "wait_s"),
        ((), -1.0, "wait_s"),
        ((), 1e9, "wait_s"),
    ],
)
def test_empty_choices_and_invalid_waits_are_refused(choices, wait_s, words):
    with pytest.raises(Refused, match=words):
        asked(*choices, wait_s=wait_s)


def test_clip_and_text_have_separate_durations():
    assert Show("first_time", "", 0.0, pace=1.0).duration_s == CLIP_S
    assert Show("", TEXT, 0.0, pace=2.0).duration_s == pytest.approx(1.05)
    assert Show("", TEXT, 8.0, pace=2.0).duration_s == 4.0
    assert Show("first_time", "Hello", 0.0, pace=1.0).line == "shows: first_time: Hello"
    with pytest.raises(Refused, match="EMPTY"):
        Show(" ", "", 0.0, pace=1.0)


def test_drive_covers_its_distance_at_walking_speed():
    gate, elsewhere = Drive("Gate", pace=1.0), Drive("the moon", pace=3.0)
    assert (gate.distance, gate.duration_s) == (12.0, 12.0)
    assert (elsewhere.distance, elsewhere.duration_s) == (3.0, 1.0)
    gate.begin(100.0)
    assert gate.driven(103.0) == pytest.approx(3.0)
    assert gate.driven(999.0) == 12.0


def test_drive_without_reachable_destination_is_refused():
    with pytest.raises(Refused, match="UNREACHABLE"):
        Drive("Nowhere", pace=1.0)
    with pytest.raises(Refused, match="EMPTY"):
        Drive("", pace=1.0)


def test_act_is_described_in_one_line():
    assert say("Hello.\n  Who are you?").line == "says: Hello. Who are you?"


def _shown(act: Act) -> tuple[ActKind, str, str, tuple[str, ...], float]:
    return act.kind, act.text, act.clip, act.choices, act.rate


def test_each_act_describes_its_visible_effect():
    ask = Ask("Shall we go?", ["Yes", " "], 0.0, pace=1.0, voice=None)
    assert _shown(say(" Hello ", 1.5)) == (ActKind.SAY, "Hello", "", (), 1.5)
    assert _shown(ask) == (ActKind.ASK, "Shall we go?", "", ("Yes",), 1.0)
    assert _shown(Show("map", "Gate 4", 0.0, pace=1.0)) == (ActKind.SHOW, "Gate 4", "map", (), 1.0)
    assert _shown(Drive("gate", pace=1.0)) == (ActKind.DRIVE, "gate", "", (), 1.0)
