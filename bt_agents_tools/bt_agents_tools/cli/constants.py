# SPDX-License-Identifier: Apache-2.0
"""Words for numbers: those in messages, by the names that the messages give them, and counts."""

from __future__ import annotations

from typing import Any

STATES = ("IDLE", "BIDDING", "AWARDING", "RUNNING", "CANCELLING", "COLLECTING")
OUTCOMES = ("SUCCEEDED", "FAILED", "CANCELLED", "LOST")
KINDS = ("DIRECT", "POSITIVE", "NEGATIVE", "SET")


def word(message: Any, value: int, names: tuple[str, ...]) -> str:
    """Return the name of a value among some constants of a message, as a word for people."""
    known = (name for name in names if getattr(message, name) == value)
    return next(known, f"unknown ({value})").lower()


def code_words(code: str) -> str:
    """Return a code as words for people: ``queue full``."""
    return code.lower().replace("_", " ")


def counted(number: int, what: str) -> str:
    """Return how many there are of something: ``1 agent``, ``2 agents``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
