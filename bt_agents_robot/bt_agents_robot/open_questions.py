# SPDX-License-Identifier: Apache-2.0
"""Questions of the simulated robot that wait for an answer, as others read them; without ROS."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass

from bt_agents_core.errors import Refused


@dataclass(frozen=True, kw_only=True)
class OpenQuestion:
    """Question with the answers that count; without choices any text does."""

    text: str
    choices: tuple[str, ...] = ()


def to_json(questions: Iterable[OpenQuestion]) -> str:
    """Return questions as a list in JSON."""
    return json.dumps([asdict(question) for question in questions], ensure_ascii=False)


def from_json(text: str) -> tuple[OpenQuestion, ...]:
    """Return the questions of :func:`to_json`.

    Raises:
        Refused: ``UNREADABLE``.
    """
    try:
        return tuple(
            OpenQuestion(text=str(one["text"]), choices=tuple(map(str, one["choices"])))
            for one in json.loads(text)
        )
    except (ValueError, TypeError, KeyError, RecursionError):
        raise Refused(
            "UNREADABLE",
            f"the robot tells its open questions as {text[:60]!r}, expected a list in JSON of "
            "mappings with 'text' and 'choices'; is another program on robot/open_questions?",
        ) from None
