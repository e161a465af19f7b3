# SPDX-License-Identifier: Apache-2.0
"""Choices of a question, and the answers that count."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_core.text import folded


def counted_answer(text: str, choices: Sequence[str]) -> str:
    """Return an answer as it counts: spelt like its choice, or as given where there are none.

    Capitals, blanks around, and how an accent is stored do not matter. What is none of the choices
    counts as no answer, which is empty.
    """
    answer = text.strip()
    if not choices:
        return answer
    same = (choice for choice in choices if folded(choice.strip()) == folded(answer))
    return next(same, "") if answer else ""
