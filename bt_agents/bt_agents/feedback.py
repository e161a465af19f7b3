# SPDX-License-Identifier: Apache-2.0
"""The kinds of feedback, as rules, trees and people give it, and a source of it."""

from __future__ import annotations

from enum import IntEnum

TUNING = "tuning"
"""Source of feedback that sets what somebody has tuned."""


class Kind(IntEnum):
    """What feedback asks for; the numbers are those of ``Feedback.msg``."""

    DIRECT = 0
    POSITIVE = 1
    NEGATIVE = 2
    SET = 3
