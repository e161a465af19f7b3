# SPDX-License-Identifier: Apache-2.0
"""Differences between two cards of a host, and their texts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace as Message
from typing import Any

import pytest

from bt_agents.host.reload.host_card_diff import CardDiff, degraded_reason
from bt_agents.host.reload.version_state import FileProblem as Problem

BROKEN = Problem(agent="ann", file="t/a.yaml", line=1, message="t/a.yaml:1:1: error[x]: y")
LIBRARY = Problem(agent="ann", file="t/libraries/m.yaml", line=13, message="not as it should be")
NOT_IN_FORCE = Problem(agent="ann", message="version 2 could not be brought into force")
SKILLS = Problem(file="t/skills/r.yaml", line=9, message="one")
SCENE = Problem(message="scene.yaml has changed")
TAKEN = Problem(agent="bob", message="already registered")
GONE = "its file a.yaml is gone"


def agent(
    version: int = 1,
    *problems: Problem,
    name: str = "ann",
    waiting: bool = False,
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


STAYS = "as its file is broken: t/a.yaml:1:1: error[x]: y"
WAITS = "waits for the end of its run"


@pytest.mark.parametrize(
    ("before", "now", "words"),
    [
        (agent(), agent(), []),
        (agent(), agent(3), ["ann: version 3 in force"]),
        (agent(), agent(2, change="x"), ["ann: version 2 in force (x)"]),
        (agent(), agent(waiting=True), [f"ann: a newer version {WAITS}"]),
        (agent(waiting=True), agent(2), ["ann: version 2 in force"]),
        (
            agent(),
            agent(2, BROKEN, LIBRARY),
            ["ann: version 2 in force", f"ann: version 2 stays, {STAYS} (and 1 more)"],
        ),
        (agent(1, BROKEN), agent(1, BROKEN), []),
        (agent(1, BROKEN), agent(), ["ann: its file is good again"]),
        (agent(1, BROKEN), agent(2), ["ann: version 2 in force"]),
        (agent(), agent(name="bob"), ["ann does not bid any more", "bob bids now"]),
        (
            agent(3, waiting=True),
            agent(3, BROKEN, waiting=True),
            [f"ann: the newer version still {WAITS}, {STAYS}"],
        ),
        (
            agent(),
            agent(removal_reason=GONE),
            ["ann: its file a.yaml is gone; it leaves at the end of its run"],
        ),
        (agent(), agent(1, NOT_IN_FORCE), ["ann: version 2 could not be brought into force"]),
    ],
)
def test_card_change_is_described_in_one_line(before: Any, now: Any, words: list[str]) -> None:
    assert changes(card(before), card(now)) == words


@pytest.mark.parametrize(
    ("problems", "words"),
    [
        ((SKILLS, replace(SKILLS, message="another")), "t/skills/r.yaml: its problems are gone"),
        ((SCENE,), "no longer: scene.yaml has changed"),
        ((TAKEN,), "no longer: bob: already registered"),
    ],
)
def test_fixed_folder_problem_is_reported(problems: tuple[Problem, ...], words: str) -> None:
    assert changes(card(agent(), problems=problems), card(agent())) == [words]
    assert changes(card(agent(), problems=problems), card(agent(), problems=problems[:1])) == []


@pytest.mark.parametrize(
    ("degraded", "why"),
    [
        (agent(), ""),
        (agent(1, BROKEN), "broken: a.yaml:1"),
        (agent(1, LIBRARY, BROKEN), "broken: m.yaml:13 (and 1 more)"),
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
    assert changes(card(agent(7)), card(agent(), instance="other")) == []
    restarted = card(agent(), instance="other", problems=(SCENE, TAKEN))
    assert changes(card(agent(), problems=(SCENE,)), restarted) == ["bob: already registered"]
    assert changes(card(), card(agent())) == []
