# SPDX-License-Identifier: Apache-2.0
"""Long lines: wrapped at words on a terminal, each on one line in a file or a pipe."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

_NARROWEST = 20


def print_line(console: Console, head: str, words: Text | str, indent: int = 0) -> None:
    """Print words behind a head; further lines of them are indented.

    Args:
        console: Where to print.
        head: What stands in front of the first line, with rich's markup.
        words: The words; those of a ``str`` are taken as they are.
        indent: Of the further lines, in characters; 0 takes the length of the head.
    """
    front = Text.from_markup(head)
    indent = indent or front.cell_len
    text = words if isinstance(words, Text) else Text(words)
    lines = [text]
    if console.is_terminal:
        lines = list(text.wrap(console, max(_NARROWEST, console.width - indent)))
    for line in lines or [text]:
        line.rstrip()
        console.print(front + line, highlight=False, soft_wrap=True)
        front = Text(" " * indent)
