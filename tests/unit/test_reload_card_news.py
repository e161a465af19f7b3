# SPDX-License-Identifier: Apache-2.0
"""What a watcher of cards is told."""

from __future__ import annotations

from types import SimpleNamespace as Message
from typing import Any

import pytest

from bt_agents.reload.card_news import CardNews


def agent(name: str = "ann", version: int = 1, waiting: bool = False, *problems: str) -> Message:
    return Message(
        name=name, version=version, waiting=waiting, degraded=bool(problems), problems=problems
    )


def card(*agents: Message, instance: str = "i", problems: tuple[str, ...] = ()) -> Message:
    told = [line for one in agents for line in one.problems]
    return Message(
        host="/agents", host_instance=instance, agents=agents, problems=[*told, *problems]
    )


def news(*cards: Message) -> list[str]:
    watcher = CardNews()
    for one in cards[:-1]:
        watcher.take(one)
    return [one.words for one in watcher.take(cards[-1])]


@pytest.mark.parametrize(
    ("before", "now", "words"),
    [
        (agent(), agent(), []),
        (agent(), agent(version=3), ["ann: version 3 in force"]),
        (
            agent(),
            agent("ann", 1, True),
            ["ann: a newer version waits for the end of its run"],
        ),
        (agent("ann", 1, True), agent("ann", 2), ["ann: version 2 in force"]),
        (
            agent(),
            agent("ann", 2, False, "a.yaml:1:1: error[x]: y", "more"),
            [
                "ann: version 2 in force",
                "ann: version 2 stays, as its file is broken: a.yaml:1:1: error[x]: y "
                "(and 1 more)",
            ],
        ),
        (agent("ann", 1, False, "x"), agent("ann", 1, False, "x"), []),
        (agent("ann", 1, False, "x"), agent(), ["ann: its file is good again"]),
        (agent("ann", 1, False, "x"), agent(version=2), ["ann: version 2 in force"]),
        (agent(), agent("bob"), ["ann does not bid any more", "bob bids now"]),
    ],
)
def test_a_change_on_a_card_is_one_line(before: Any, now: Any, words: list[str]) -> None:
    assert news(card(before), card(now)) == words


def test_a_problem_of_the_folder_is_told_once() -> None:
    one = card(agent(), problems=("scene.yaml has changed",))
    assert news(card(agent()), one) == ["scene.yaml has changed"]
    assert news(card(agent()), one, one) == []


def test_the_first_card_of_a_start_of_a_host_is_no_news() -> None:
    assert news(card(agent())) == []
    assert news(card(agent(version=7)), card(agent(), instance="other")) == []
    assert news(card(), card(agent())) == []


def test_only_a_new_version_is_to_be_asked_about() -> None:
    watcher = CardNews()
    watcher.take(card(agent()))
    assert [one.agent for one in watcher.take(card(agent(version=2)))] == ["ann"]
    assert [one.agent for one in watcher.take(card(agent("ann", 2, True)))] == [""]
