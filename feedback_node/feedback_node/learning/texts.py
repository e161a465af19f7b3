# SPDX-License-Identifier: Apache-2.0
"""Validation of the texts that come with feedback."""

from __future__ import annotations

from bt_agents_core.errors import Refused
from feedback_node.ledger.rows import is_hidden

LONGEST_TEXT = 1000


def check_texts(**texts: str) -> None:
    """Check the texts of a feedback by their field.

    Raises:
        Refused: ``TOO_LONG``, ``BAD_TEXT`` or ``RESERVED_ID``.
    """
    for field, text in texts.items():
        if len(text) > LONGEST_TEXT:
            raise Refused(
                "TOO_LONG",
                f"feedback: {field} has {len(text)} characters, expected {LONGEST_TEXT} at most",
            )
        if not text.isprintable():
            raise Refused(
                "BAD_TEXT",
                f"feedback: {field} is {text[:80]!a}, expected no control characters",
            )
    if is_hidden(texts.get("feedback_id", "")):
        raise Refused(
            "RESERVED_ID",
            "feedback: ids that begin with 'sha256:' stand for forgotten ones; take a UUID",
        )
