# SPDX-License-Identifier: Apache-2.0
"""Speech and the other acts of the simulated robot, with a clock turned by hand and no sound."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from bt_agents_core.errors import Refused
from bt_agents_robot.acts import ANSWER_WAIT_S, CLIP_S, Ask, Drive, Say, Show, check_duration
from bt_agents_robot.speech import (
    LONGEST_TEXT,
    Voice,
    check_rate,
    check_text,
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


def say(
    text: str = TEXT, rate: float = 1.0, *, pace: float = 1.0, voice: Voice | None = None
) -> Say:
    act = Say(text, rate, pace=pace, voice=voice)
    act.begin(100.0)
    return act


def test_a_text_takes_its_length_over_fifteen_and_a_breath():
    assert speaking_time(TEXT, 1.0, 1.0) == pytest.approx(2.1)
    assert speaking_time(TEXT, 0.5, 1.0) == pytest.approx(4.2)
    assert speaking_time(TEXT, 1.0, 10.0) == pytest.approx(0.21)


def test_the_text_never_stands_on_the_command_line():
    assert espeak_command("espeak-ng", 1.0, 1.0) == ("espeak-ng", "--stdin", "-s", "175")
    assert espeak_command("espeak-ng", 0.5, 0.1) == ("espeak-ng", "--stdin", "-s", "80")


def test_at_a_pace_beyond_a_voice_texts_are_silent():
    assert espeak_command("espeak-ng", 1.0, 2.5) is not None
    assert espeak_command("espeak-ng", 1.0, 5.0) is None


@pytest.mark.parametrize(
    ("text", "code"), [("", "EMPTY"), (" \n\t", "EMPTY"), ("x" * (LONGEST_TEXT + 1), "TOO_LONG")]
)
def test_a_text_without_words_or_without_end_is_refused(text, code):
    with pytest.raises(Refused) as refused:
        check_text(text, "text")
    assert refused.value.code == code


@pytest.mark.parametrize(
    ("rate", "code"),
    [
        (math.nan, "NOT_FINITE"),
        (math.inf, "NOT_FINITE"),
        (0.4, "OUT_OF_RANGE"),
        (-1, "OUT_OF_RANGE"),
    ],
)
def test_a_rate_that_nobody_can_speak_is_refused(rate, code):
    with pytest.raises(Refused) as refused:
        check_rate(rate)
    assert refused.value.code == code


def test_a_rate_of_zero_is_the_normal_one():
    assert check_rate(0.0) == 1.0
    assert check_rate(2.0) == 2.0


def test_without_a_program_a_text_takes_its_expected_time():
    studio = Studio()
    act = say(voice=studio.voice)
    assert not studio.voice.audible
    assert not act.over(102.0)
    assert act.over(102.2)
    assert studio.warnings == []


def test_a_spoken_text_ends_with_its_program():
    studio = Studio("espeak")
    act = say("-f /etc/passwd; rm -rf x", voice=studio.voice)
    assert studio.started == [
        (("/usr/bin/espeak", "--stdin", "-s", "175"), "-f /etc/passwd; rm -rf x")
    ]
    assert not act.over(102.5)
    studio.processes[0].code = 0
    assert act.over(102.5)
    assert not studio.processes[0].terminated


def test_espeak_ng_is_preferred():
    studio = Studio("espeak", "espeak-ng")
    say(voice=studio.voice)
    assert studio.started[0][0][0] == "/usr/bin/espeak-ng"


def test_a_program_that_hangs_is_ended_after_twice_the_expected_time():
    studio = Studio("espeak")
    act = say(voice=studio.voice)
    assert not act.over(104.1)
    assert act.over(104.3)
    assert studio.processes[0].terminated


def test_a_failing_program_leaves_silence_and_one_warning():
    studio = Studio("espeak")
    act = say(voice=studio.voice)
    studio.processes[0].code = 1
    assert not act.over(100.1)
    assert act.over(102.2)
    say(voice=studio.voice)
    assert len(studio.started) == 1
    assert len(studio.warnings) == 1
    assert "exit code 1" in studio.warnings[0]


def test_a_program_that_cannot_be_started_leaves_silence_and_one_warning():
    studio = Studio("espeak", broken=True)
    acts = [say(voice=studio.voice), say(voice=studio.voice)]
    assert [act.over(102.2) for act in acts] == [True, True]
    assert len(studio.warnings) == 1


@pytest.mark.parametrize("program", ["cat", "true"])
def test_a_program_is_handed_the_text_whether_it_reads_it_or_not(program):
    process = start_process((program,), "Hello. " * 200)
    assert process.wait(timeout=10.0) == 0


def test_a_program_that_ends_at_once_has_not_been_heard():
    studio = Studio("espeak")
    act = say(voice=studio.voice)
    studio.processes[0].code = 0
    assert not act.over(100.1)
    assert act.over(102.2)


def test_stopping_ends_the_program():
    studio = Studio("espeak")
    act = say(voice=studio.voice)
    act.stop()
    assert studio.processes[0].terminated
    assert not act.speaking(100.1)


def test_the_mouth_is_held_while_speaking_only():
    act = Ask("Shall we go?", (), 10.0, pace=1.0, voice=None)
    assert not act.speaking(100.0)
    act.begin(100.0)
    assert act.speaking(100.5)
    assert not act.speaking(101.2)
    assert not act.over(101.2), "it waits for the answer now"


def asked(*choices: str, wait_s: float = 4.0) -> Ask:
    act = Ask("Shall we go?", choices, wait_s, pace=1.0, voice=None)
    act.begin(100.0)
    return act


def test_a_question_is_asked_once_when_it_has_been_spoken():
    act = asked()
    assert [act.asked(now) for now in (100.5, 101.2, 101.3)] == [False, True, False]


def test_an_answer_ends_the_question():
    act = asked()
    act.asked(101.2)
    assert act.take("  later ")
    assert act.answer == "later"
    assert act.over(101.3)
    assert not act.take("now"), "the first answer counts"


def test_an_early_answer_interrupts_the_question():
    act = asked()
    assert act.take("yes")
    assert act.over(100.2)
    assert not act.speaking(100.2)


def test_with_choices_only_those_count_in_whatever_case():
    act = asked("Yes", "No")
    assert not act.take("maybe")
    assert not act.take("")
    assert act.take("YES")
    assert act.answer == "Yes"


def test_a_question_that_waits_for_its_turn_takes_no_answer():
    act = Ask("Shall we go?", (), 4.0, pace=1.0, voice=None)
    assert not act.take("yes")


def test_no_answer_ends_the_waiting():
    act = asked(wait_s=4.0)
    assert act.asked(101.2)
    assert not act.over(105.1)
    assert act.over(105.3)
    assert act.answer == ""


def test_choices_that_are_all_empty_are_refused():
    with pytest.raises(Refused, match="EMPTY"):
        asked("", " ")


@pytest.mark.parametrize("wait_s", [math.nan, math.inf, -1.0, 1e9])
def test_a_waiting_time_that_makes_no_sense_is_refused(wait_s):
    with pytest.raises(Refused, match="wait_s"):
        asked(wait_s=wait_s)


def test_a_duration_of_zero_is_the_usual_one():
    assert check_duration(0.0, "wait_s", ANSWER_WAIT_S) == ANSWER_WAIT_S


def test_a_clip_and_a_text_have_their_own_durations():
    assert Show("first_time", "", 0.0, pace=1.0).duration_s == CLIP_S
    assert Show("", TEXT, 0.0, pace=2.0).duration_s == pytest.approx(1.05)
    assert Show("", TEXT, 8.0, pace=2.0).duration_s == 4.0
    assert Show("first_time", "Hello", 0.0, pace=1.0).line == "shows: first_time: Hello"
    with pytest.raises(Refused, match="EMPTY"):
        Show(" ", "", 0.0, pace=1.0)


def test_driving_takes_its_distance_at_walking_speed():
    gate, elsewhere = Drive("Gate", pace=1.0), Drive("the moon", pace=3.0)
    assert (gate.distance, gate.duration_s) == (12.0, 12.0)
    assert (elsewhere.distance, elsewhere.duration_s) == (3.0, 1.0)
    gate.begin(100.0)
    assert gate.driven(103.0) == pytest.approx(3.0)
    assert gate.driven(999.0) == 12.0


def test_nobody_drives_nowhere():
    with pytest.raises(Refused, match="UNREACHABLE"):
        Drive("Nowhere", pace=1.0)
    with pytest.raises(Refused, match="EMPTY"):
        Drive("", pace=1.0)


def test_an_act_is_told_in_one_line():
    assert say("Hello.\n  Who are you?").line == "says: Hello. Who are you?"
