# SPDX-License-Identifier: Apache-2.0
"""Choices of a question, and the answers that match them."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_core.text import folded


def counted_answer(text: str, choices: Sequence[str]) -> str:
    """Return an answer spelled like its choice, or as given if there are no choices.

    Case, surrounding blanks and the encoding of accents do not matter. An answer that matches no
    choice counts as no answer: the empty text.
    """
    answer = text.strip()
    if not choices:
        return answer
    same = (choice for choice in choices if folded(choice.strip()) == folded(answer))
    return next(same, "") if answer else ""
