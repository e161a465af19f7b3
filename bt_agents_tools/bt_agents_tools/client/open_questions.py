# SPDX-License-Identifier: Apache-2.0
"""Open questions of the robot: matching an answer to a question and its choices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import counted_answer


def asked_by(questions: Sequence[Any], words: str) -> tuple[Any, str]:
    """Return the first question that takes an answer, and the counted answer.

    Raises:
        Refused: ``NO_QUESTION`` or ``NOT_A_CHOICE``.
    """
    if not questions:
        raise Refused(
            RefusalCode.NO_QUESTION,
            f"'{words}' answers nothing, the robot asks nothing now; 'bt-agents answer' shows a "
            "question as long as it is open",
        )
    for question in questions:
        if taken := counted_answer(words, question.choices):
            return question, taken
    found = "; ".join(map(question_text, questions))
    raise Refused(RefusalCode.NOT_A_CHOICE, f"'{words}' is not an answer; {found}")


def question_text(question: Any) -> str:
    """Return a question with its valid answers."""
    choices = ", ".join(question.choices) or "anything"
    return f"the robot is asking: {question.text} (answers: {choices})"


def not_taken(words: str) -> Refused:
    """Return the refusal of an answer that no node has taken."""
    return Refused(
        RefusalCode.NOT_TAKEN, f"the robot has not taken '{words}'; it asks no more, or is busy"
    )
