# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents answer`: shows or answers the open question of the simulated robot."""

from __future__ import annotations

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import printable
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.connection import FIND_LIMIT_S, connect
from bt_agents_tools.client.open_questions import asked_by, not_taken, question_text


@click.command()
@click.argument("text", nargs=-1)
def answer(text: tuple[str, ...]) -> None:
    """Answer the simulated robot; without TEXT show its open question and the choices.

    For example: bt-agents answer yes.
    """
    observer = connect()
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
        click.echo("\n".join(map(question_text, questions)) or "the robot asks nothing now")
        return
    words = " ".join(text)
    asked, taken = asked_by(questions, words)
    publish(observer, "answers", typed_message("std_msgs/msg/String", [f"data={taken}"]))
    # Nothing was received since the answer was sent.
    before = len(told)

    def closed() -> bool:
        return any(asked not in one.questions for one in told[before:])

    was_open = asked in told[-1].questions
    if not (was_open and observer.spin_until(closed, FIND_LIMIT_S)):
        raise not_taken(words)
    click.echo(f"answered '{printable(taken)}' to: {asked.text}")
