# SPDX-License-Identifier: Apache-2.0
"""Formatting of messages for people: constants, counts, names of scenes, wrapped lines."""

from __future__ import annotations

import math
import re
from typing import Any

from rich.console import Console
from rich.text import Text

from bt_agents_core.scene import AGAIN

STATES = ("IDLE", "BIDDING", "AWARDING", "RUNNING", "CANCELLING", "COLLECTING")
OUTCOMES = ("SUCCEEDED", "FAILED", "CANCELLED", "LOST")
KINDS = ("DIRECT", "POSITIVE", "NEGATIVE", "SET")

_NARROWEST = 20


def constant_text(message: Any, value: int, names: tuple[str, ...]) -> str:
    """Return the name of a value among some constants of a message, in small letters."""
    known = (name for name in names if getattr(message, name) == value)
    return next(known, f"unknown ({value})").lower()


def code_text(code: str) -> str:
    """Return a code as text for people: ``queue full``."""
    return code.lower().replace("_", " ")


def counted(number: int, what: str) -> str:
    """Return a number with its noun: ``1 agent``, ``2 agents``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


class SceneLabels:
    """Names of scenes for people: the label, else the values, instead of the id."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    def add(self, scene: Any) -> None:
        """Store the name of a scene, as ``Scene.msg`` has it."""
        known = (v for v in scene.values if not math.isnan(v.value))
        values = ", ".join(f"{v.name} {v.value:g}" for v in known)
        self._names[_original_id(scene.scene_id)] = scene.label or values or "nothing known"

    def name_of(self, scene_id: str) -> str:
        """Return the name of a scene; its id when it was not added."""
        return self._names.get(_original_id(scene_id), scene_id)

    def with_names(self, text: str) -> str:
        """Return a text for people with names in place of quoted ids."""
        return re.sub(r"'([^']*)'", lambda match: f"'{self.name_of(match[1])}'", text)


def _original_id(scene_id: str) -> str:
    """Return the id that a scene had before a market was restarted and asked again for it."""
    return scene_id.removesuffix(AGAIN)


def print_line(console: Console, head: str, text: Text | str, indent: int = 0) -> None:
    """Print a text behind a head with markup: wrapped at words on a terminal, else as one line.

    Further lines are indented by so many characters, without a number by the length of the head.
    """
    front = Text.from_markup(head)
    indent = indent or front.cell_len
    body = text if isinstance(text, Text) else Text(text)
    lines = [body]
    if console.is_terminal:
        lines = list(body.wrap(console, max(_NARROWEST, console.width - indent)))
    for line in lines or [body]:
        line.rstrip()
        console.print(front + line, highlight=False, soft_wrap=True)
        front = Text(" " * indent)
