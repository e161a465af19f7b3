# SPDX-License-Identifier: Apache-2.0
"""Health of the parts of a node: a level, a sentence and named values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

MOST_VALUES = 50
"""Maximum number of values to report per part; further ones are only counted."""


class Health(IntEnum):
    """Level of a part, with the numbers of ``diagnostic_msgs/DiagnosticStatus``.

    Attributes:
        OK: Everything works as intended.
        WARN: Everything works, but needs attention.
        ERROR: Something does not work until it is fixed.
        STALE: A part that was there no longer sends anything.
    """

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, kw_only=True)
class PartHealth:
    """Health of one part of a node.

    Attributes:
        part: Name of the part, such as ``hosts`` of a market.
        message: The level in words.
        values: Name → text; none that changes constantly, such as an age.
    """

    part: str
    level: Health
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def first_values(values: Mapping[str, str]) -> Mapping[str, str]:
    """Return at most :data:`MOST_VALUES` values and the number of omitted ones."""
    if len(values) <= MOST_VALUES:
        return values
    kept = dict(list(values.items())[: MOST_VALUES - 1])
    return {**kept, "left out": str(len(values) - len(kept))}
