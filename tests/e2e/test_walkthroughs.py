# SPDX-License-Identifier: Apache-2.0
"""Step-by-step pages: the tests write their files and run their commands."""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from command_server import CommandServer
from programs import ROOT, Program, Start

pytestmark = pytest.mark.e2e

PAGES: dict[str, dict[str, str]] = {
    "tutorial": {"trigger": "asks: Where do you want to go", "sense": "quiet_guide starts"},
    "library_robot": {
        "trigger": "asks: What have you lost",
        "answer umbrella": "lost_and_found succeeded",
        "answer gloves": "lost_and_found succeeded",
    },
    "market": {"trigger": "run +[a-z_]+ starts", "cancel": "run +[a-z_]+ cancelled"},
}
"""Page → command → output of the running system that an author would wait for."""

ON_SHIPPED_TREES = {"market"}
"""Pages that start with the agents of the checkout; only the part before the rules."""

WHEN_STOPPED = "replay"
"""Command before which the page stops the system."""


def steps(page: str) -> Iterator[tuple[str, str]]:
    """Yield the files and the commands of a page, each with the text below its head."""
    text = (ROOT / "docs" / f"{page}.md").read_text()
    if page in ON_SHIPPED_TREES:
        text = text.partition("\n## Who wins")[0]
    for kind, block in re.findall(r"```(yaml|console)\n(.*?)```", text, re.DOTALL):
        heads = r"^# " if kind == "yaml" else r"^\$ bt-agents "
        for part in re.split(heads, block, flags=re.MULTILINE)[1:]:
            head, _, below = part.partition("\n")
            yield (head if kind == "console" else f"# {head}"), below


def fits(printed: str, written: str) -> bool:
    """Return whether an output matches a text, in which … stands for anything on one line."""
    expression = ".*?".join(map(re.escape, written.split("…")))
    return re.fullmatch(expression, printed) is not None


def wait_for_effect(up: Program, head: str, awaited: Mapping[str, str]) -> None:
    """Wait until the effect of a command has come."""
    for command, pattern in awaited.items():
        if head == command or head.startswith(f"{command} "):
            up.until(pattern)


def at_noon() -> str:
    """Return a time zone where it is noon now; some agents work only by day."""
    return f"NOON{time.gmtime().tm_hour - 12:+d}"


@pytest.mark.parametrize("page", PAGES)
def test_walkthrough_commands_print_documented_output(
    page: str, start: Start, commands: CommandServer, environment: dict[str, str], tmp_path: Path
) -> None:
    environment["TZ"] = at_noon()
    folder = ROOT if page in ON_SHIPPED_TREES else tmp_path / "place"
    folder.mkdir(exist_ok=True)
    up = None
    different = []
    for head, below in steps(page):
        if head.startswith("# "):
            path = folder / head.removeprefix("# ")
            path.parent.mkdir(exist_ok=True)
            path.write_text(below)
            continue
        words = shlex.split(head)
        if words[-1] == "&":
            up = start(*words[:-1], folder=folder)
            up.until("ready")
            continue
        if words[0] == WHEN_STOPPED and up is not None:
            assert up.stop()[0] == 0
        ended = commands.run(*words, folder=folder, environment=environment, together=True)
        if not fits(ended.out, below):
            different.append(f"$ bt-agents {head}\n{ended.out}")
        if up is not None and up.process.poll() is None:
            wait_for_effect(up, head, PAGES[page])
    assert up is not None
    assert up.process.poll() is not None or up.stop()[0] == 0
    assert not different, "\n".join([f"docs/{page}.md has something else:", *different])
