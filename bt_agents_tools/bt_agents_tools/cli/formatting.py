# SPDX-License-Identifier: Apache-2.0
"""Formatting of messages for people: constants, counts, times, wrapped lines."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.text import Text

from bt_agents_tools.cli.table import TableForm

STATES = ("IDLE", "BIDDING", "AWARDING", "RUNNING", "CANCELLING", "COLLECTING")
OUTCOMES = ("SUCCEEDED", "FAILED", "CANCELLED", "LOST")
KINDS = ("DIRECT", "POSITIVE", "NEGATIVE", "SET")

INDENT = 4
"""Indent of further lines about a running system."""

_NARROWEST = 20
_WIDEST = 10_000


def constant_text(message: Any, value: int, names: tuple[str, ...]) -> str:
    """Return the name of a value among some constants of a message, in lower case."""
    known = (name for name in names if getattr(message, name) == value)
    return next(known, f"unknown ({value})").lower()


def values_text(values: Iterable[Any]) -> str:
    """Return the ``ChangedValue.msg`` of an element of a trace as text: ``answer = 'yes'``."""
    return ", ".join(f"{one.name} = {one.value}" for one in values)


def code_text(code: str) -> str:
    """Return a code as text for people: ``queue full``."""
    return code.lower().replace("_", " ")


def counted(number: int, what: str) -> str:
    """Return a number with its noun: ``1 agent``, ``2 agents``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def node_names(received: Iterable[Sequence[Any]], agent: str) -> dict[str, str]:
    """Return the names of an agent's nodes by path, from the latest ``Trees.msg`` of each host."""
    trees = (tree for messages in received for message in messages[-1:] for tree in message.trees)
    return {node.path: node.name for tree in trees if tree.agent == agent for node in tree.nodes}


_LONGEST_S = 366 * 86400


def moment_text(seconds: float) -> str:
    """Return a moment [s since 1970] as local date and time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


def clock_text(seconds: float) -> str:
    """Return a moment [s since 1970] as local time of day."""
    return time.strftime("%H:%M:%S", time.localtime(seconds))


def since_text(stamp: Any, now: float) -> str:
    """Return the time of day since when something holds, and its duration."""
    seconds = max(0, round(now - stamp.sec - stamp.nanosec * 1e-9))
    if seconds > _LONGEST_S:
        return f"since {stamp.sec} s of simulated time"
    minutes, rest = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    parts = ((hours, "h"), (minutes, "min"), (rest, "s"))
    lasted = " ".join([f"{number} {unit}" for number, unit in parts if number][:2]) or "0 s"
    return f"since {clock_text(stamp.sec)}, for {lasted}"


def progress_bar() -> Progress:
    """Return a progress bar with the remaining time, on standard error."""
    return Progress(console=Console(stderr=True), transient=True)


def fitted_console(form: TableForm = TableForm.FITTED) -> Console:
    """Return a console that fits a terminal; for a pipe or another form, it wraps nothing."""
    console = Console()
    return console if console.is_terminal and form is TableForm.FITTED else Console(width=_WIDEST)


def print_line(console: Console, head: str, text: Text | str, indent: int = 0) -> None:
    """Print a text after a head with markup; on a terminal it is wrapped at words.

    Further lines are indented by a number of characters, which defaults to the length of the head.
    """
    front = Text.from_markup(head)
    indent = indent or front.cell_len
    body = text if isinstance(text, Text) else Text(text)
    lines = body.split(allow_blank=True)
    if console.is_terminal:
        lines = body.wrap(console, max(_NARROWEST, console.width - indent))
    for line in lines or [body]:
        line.rstrip()
        console.print(front + line, highlight=False, soft_wrap=True)
        front = Text(" " * indent)
