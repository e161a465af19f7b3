# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents answer`: the open question of the simulated robot, and an answer to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from bt_agents_core.choices import counted_answer
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.text import printable
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.connection import FIND_LIMIT_S, connect


@click.command()
@click.argument("text", nargs=-1)
def answer(text: tuple[str, ...]) -> None:
    """Answer the simulated robot; without TEXT show its open question and the choices.

    For example: bt-agents answer yes.
    """
    with connect() as observer:
        with loading():
            from bt_agents_tools.client.publication import publish, typed_message
        told = observer.received("robot/open_questions")
        if not observer.spin_until(lambda: bool(told), FIND_LIMIT_S):
            raise BtAgentsError(
                "there is no simulated robot to answer, 'bt-agents up' starts one; "
                "another robot hears answers by its own means"
            )
        questions = told[-1].questions
        if not text:
            click.echo("\n".join(map(_shown, questions)) or "the robot asks nothing now")
            return
        words = " ".join(text)
        asked, taken = _asked(questions, words)
        publish(observer, "answers", typed_message("std_msgs/msg/String", [f"data={taken}"]))
        # Nothing has been received since the answer was sent.
        before = len(told)

        def closed() -> bool:
            return any(asked not in one.questions for one in told[before:])

        was_open = asked in told[-1].questions
        if not (was_open and observer.spin_until(closed, FIND_LIMIT_S)):
            raise BtAgentsError(f"the robot has not taken '{words}'; it asks no more, or is busy")
        click.echo(f"answered '{printable(taken)}' to: {asked.text}")


def _asked(questions: Sequence[Any], words: str) -> tuple[Any, str]:
    """Return the first question that takes an answer, and how it does."""
    if not questions:
        raise Refused(
            "NO_QUESTION",
            f"'{words}' answers nothing, the robot asks nothing now; 'bt-agents answer' shows a "
            "question as long as it is open",
        )
    for question in questions:
        if taken := counted_answer(words, question.choices):
            return question, taken
    raise Refused("NOT_A_CHOICE", f"'{words}' is no answer; {'; '.join(map(_shown, questions))}")


def _shown(question: Any) -> str:
    choices = ", ".join(question.choices) or "anything"
    return f"asked is: {question.text} (answers: {choices})"
