# SPDX-License-Identifier: Apache-2.0
"""The tutorial, from its empty folder to its end: its files are written and its commands run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from command_server import CommandServer
from programs import ROOT, Program

pytestmark = pytest.mark.e2e

BEFORE_THE_NEXT = {"trigger": r"asks: Where do you want to go\?", "sense": r"quiet_guide starts"}
"""Command → what the running system prints before an author would go on."""


def steps() -> Iterator[tuple[str, str]]:
    """Yield the files and the commands of the tutorial, each with what stands below its head."""
    text = (ROOT / "docs" / "tutorial.md").read_text()
    for kind, block in re.findall(r"```(yaml|console)\n(.*?)```", text, re.DOTALL):
        heads = r"^# " if kind == "yaml" else r"^\$ bt-agents "
        for part in re.split(heads, block, flags=re.MULTILINE)[1:]:
            head, _, below = part.partition("\n")
            yield (head if kind == "console" else f"# {head}"), below


def fits(printed: str, written: str) -> bool:
    """Return whether an output is what is written, where … stands for anything on one line."""
    expression = ".*?".join(map(re.escape, written.split("…")))
    return re.fullmatch(expression, printed) is not None


def test_every_command_of_the_tutorial_prints_what_stands_there(
    start: Callable[..., Program],
    commands: CommandServer,
    environment: dict[str, str],
    tmp_path: Path,
) -> None:
    folder = tmp_path / "hospital"
    folder.mkdir()
    up = None
    different = []
    for head, below in steps():
        if head.startswith("# "):
            (folder / head.removeprefix("# ")).write_text(below)
            continue
        words = shlex.split(head)
        if words[-1] == "&":
            up = start(*words[:-1], folder=folder)
            up.until("ready")
            continue
        ended = commands.run(*words, folder=folder, environment=environment, together=True)
        if not fits(ended.out, below):
            different.append(f"$ bt-agents {head}\n{ended.out}")
        if up is not None and words[0] in BEFORE_THE_NEXT:
            up.until(BEFORE_THE_NEXT[words[0]])
    assert up is not None
    assert up.stop()[0] == 0
    assert not different, "\n".join(["docs/tutorial.md has something else:", *different])
