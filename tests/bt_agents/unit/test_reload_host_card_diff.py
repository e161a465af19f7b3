# SPDX-License-Identifier: Apache-2.0
"""Differences between two cards of a host, and their texts."""

from __future__ import annotations

from types import SimpleNamespace as Message
from typing import Any

import pytest

from bt_agents.host.reload.host_card_diff import CardDiff, degraded_reason
from bt_agents.host.reload.version_state import FileProblem as Problem

BROKEN = Problem(agent="ann", file="t/a.yaml", line=1, message="t/a.yaml:1:1: error[x]: y")
LIBRARY = Problem(agent="ann", file="t/libraries/m.yaml", line=13, message="not as it should be")
NOT_IN_FORCE = Problem(agent="ann", message="version 2 could not be brought into force")
SCENE = Problem(message="scene.yaml has changed")
TAKEN = Problem(agent="bob", message="already registered")
GONE = "its file a.yaml is gone"


def agent(
    name: str = "ann",
    version: int = 1,
    waiting: bool = False,
    *problems: Problem,
    removal_reason: str = "",
    change: str = "",
) -> Message:
    if removal_reason:
        problems = (Problem(agent=name, message=removal_reason),)
    return Message(
        name=name,
        version=version,
        change=change,
        waiting=waiting,
        degraded=bool(problems),
        problems=problems,
        removal_reason=removal_reason,
    )


def card(*agents: Message, instance: str = "i", problems: tuple[Problem, ...] = ()) -> Message:
    reported = [problem for one in agents for problem in one.problems]
    return Message(
        host="/agents", host_instance=instance, agents=agents, problems=[*reported, *problems]
    )


def changes(*cards: Message) -> list[str]:
    watcher = CardDiff()
    for one in cards[:-1]:
        watcher.update(one)
    return [one.text for one in watcher.update(cards[-1])]


@pytest.mark.parametrize(
    ("before", "now", "words"),
    [
        (agent(), agent(), []),
        (agent(), agent(version=3), ["ann: version 3 in force"]),
        (agent(), agent(version=2, change="x"), ["ann: version 2 in force (x)"]),
        (agent(), agent("ann", 1, True), ["ann: a newer version waits for the end of its run"]),
        (agent("ann", 1, True), agent("ann", 2), ["ann: version 2 in force"]),
        (
            agent(),
            agent("ann", 2, False, BROKEN, LIBRARY),
            [
                "ann: version 2 in force",
                "ann: version 2 stays, as its file is broken: t/a.yaml:1:1: error[x]: y "
                "(and 1 more)",
            ],
        ),
        (agent("ann", 1, False, BROKEN), agent("ann", 1, False, BROKEN), []),
        (agent("ann", 1, False, BROKEN), agent(), ["ann: its file is good again"]),
        (agent("ann", 1, False, BROKEN), agent(version=2), ["ann: version 2 in force"]),
        (agent(), agent("bob"), ["ann does not bid any more", "bob bids now"]),
    ],
)
def test_card_change_is_described_in_one_line(before: Any, now: Any, words: list[str]) -> None:
    assert changes(card(before), card(now)) == words


@pytest.mark.parametrize(
    ("before", "now", "words"),
    [
        (
            agent("ann", 3, True),
            agent("ann", 3, True, BROKEN),
            "ann: the newer version still waits for the end of its run, as its file is broken: "
            "t/a.yaml:1:1: error[x]: y",
        ),
        (
            agent(),
            agent(removal_reason=GONE),
            "ann: its file a.yaml is gone; it leaves at the end of its run",
        ),
        (
            agent(),
            agent("ann", 1, False, NOT_IN_FORCE),
            "ann: version 2 could not be brought into force",
        ),
    ],
)
def test_diff_describes_what_happens_to_agent(before: Any, now: Any, words: str) -> None:
    assert changes(card(before), card(now)) == [words]


@pytest.mark.parametrize(
    ("problems", "words"),
    [
        (
            (
                Problem(file="t/skills/r.yaml", line=9, message="one"),
                Problem(file="t/skills/r.yaml", line=9, message="another"),
            ),
            ["t/skills/r.yaml is good again"],
        ),
        ((SCENE,), ["no longer: scene.yaml has changed"]),
        ((TAKEN,), ["no longer: bob: already registered"]),
    ],
)
def test_fixed_folder_problem_is_reported(problems: tuple[Problem, ...], words: list[str]) -> None:
    assert changes(card(agent(), problems=problems), card(agent())) == words
    assert changes(card(agent(), problems=problems), card(agent(), problems=problems[:1])) == []


@pytest.mark.parametrize(
    ("degraded", "why"),
    [
        (agent(), ""),
        (agent("ann", 1, False, BROKEN), "broken: a.yaml:1"),
        (agent("ann", 1, False, LIBRARY, BROKEN), "broken: m.yaml:13 (and 1 more)"),
        (agent(removal_reason=GONE), GONE),
    ],
)
def test_degraded_reason_is_short(degraded: Any, why: str) -> None:
    assert degraded_reason(degraded) == why


def test_folder_problem_is_reported_once() -> None:
    one = card(agent(), problems=(SCENE,))
    assert changes(card(agent()), one) == ["scene.yaml has changed"]
    assert changes(card(agent()), one, one) == []


def test_first_card_of_instance_reports_only_new_problems() -> None:
    assert changes(card(agent())) == []
    assert changes(card(agent(version=7)), card(agent(), instance="other")) == []
    restarted = card(agent(), instance="other", problems=(SCENE, TAKEN))
    assert changes(card(agent(), problems=(SCENE,)), restarted) == ["bob: already registered"]
    assert changes(card(), card(agent())) == []
