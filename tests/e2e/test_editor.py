# SPDX-License-Identifier: Apache-2.0
"""The committed schemas in an editor's language server."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES
from checkout import ROOT
from language_server import LanguageServer, installed_server
from tree_harness import SPACE, SYMBOLS

pytestmark = pytest.mark.e2e

FILE = ROOT / "trees" / "agents" / "written_in_a_test.yaml"
TOP = "# yaml-language-server: $schema=../../schema/agent.schema.json\nformat: 1\nagent: a\n"
HEAD = f"{TOP}profile: {{age: 3, familiarity: 3, mood: 3}}\ntree:\n"
WORDS = {*NODE_TYPES, *DECORATORS, *SYMBOLS.skills}


@pytest.fixture(scope="module")
def server() -> Iterator[LanguageServer]:
    """The server that VS Code and other editors start for YAML files."""
    running = LanguageServer(installed_server())
    yield running
    running.close()


def shipped() -> list[Path]:
    folders = ("agents", "skills", "libraries", "scenes", "scripts")
    found = [path for folder in folders for path in (ROOT / "trees" / folder).glob("*.yaml")]
    return [ROOT / "trees" / "scene.yaml", *sorted(found)]


@pytest.mark.parametrize(
    ("before", "words"),
    [
        ("  ▮", WORDS),
        ("  sequence:\n    - ▮", WORDS),
        ("  sequence:\n    - s▮", WORDS),
        ("  sequence:\n    - say: Hello.\n      ▮", {*DECORATORS, "name"}),
        ("  say: x\n  retry: ▮", {"forever"}),
        ("  parallel:\n    succeed_on: ▮", {"all", "one"}),
        ("  log:\n    level: ▮", {"info", "warning", "error"}),
        ("  ask:\n    ▮", {"text", "choices", "wait"}),
    ],
)
def test_completion_offers_what_may_stand_there(server, before, words):
    assert server.completions(FILE, HEAD + before).keys() >= words


def test_completed_node_includes_required_fields(server):
    offered = server.completions(FILE, f"{HEAD}  ▮")
    inserted = {label: item["insertText"] for label, item in offered.items()}
    assert inserted["sequence"] == "sequence:\n  - "
    assert inserted["say"] == "say: "
    assert inserted["publish"] == "publish:\n  topic: $1\n  type: $2\n  message: $3"
    assert inserted["on_failure"] == "on_failure:\n  "


def test_completion_below_profile_offers_scene_parameters(server):
    offered = server.completions(FILE, f"{TOP}profile:\n  ▮")
    assert offered.keys() >= set(SPACE.names)
    assert offered["age"]["insertText"] == "age: ${1:3}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            f"{HEAD}  say: x\n  ▮retry: 3",
            [DECORATORS["retry"].description, "attempts", "pause: 2 s"],
        ),
        (f"{HEAD}  ▮sequence:\n    - say: x", [NODE_TYPES["sequence"].description, "memory"]),
        (f"{HEAD}  ▮ask: Where to?", ["the question", "10 s", "gives `answer`"]),
        (f"{HEAD}  ask: {{text: x, ▮wait: 3 s}}", ["how long to wait for the answer"]),
        (f"{TOP}profile: {{▮age: 3}}", ["1 to 5", "a child"]),
    ],
)
def test_hover_shows_meaning_of_word(server, text, words):
    shown = server.hover(FILE, text)
    for word in words:
        assert word in shown


@pytest.mark.parametrize(
    ("tree", "problems"),
    [
        ("sya: Hello.", ["6: Property sya is not allowed."]),
        (
            "say: Hello.\n  ask: Really?",
            ["5: two nodes in one item: indent the block, or start a new '-' item"],
        ),
        ("retry: 3", ["5: a decorator alone: there is no node beside it"]),
        ("wait: 5 sx", ["6: expected a time such as 8 s or ${…}"]),
        ("say: x\n  timeout: soon", ["7: expected a time such as 8 s or ${…}"]),
        (
            "give_feedback: good",
            ['6: Value is not accepted. Valid values: "positive", "negative", "direct".'],
        ),
    ],
)
def test_mistake_is_reported_once_at_its_position(server, tree, problems):
    assert server.problems(FILE, f"{HEAD}  {tree}\n") == problems


@pytest.mark.parametrize("path", shipped(), ids=lambda path: str(path.relative_to(ROOT)))
def test_shipped_files_have_no_problems(server, path):
    text = path.read_text(encoding="utf-8")
    first = text.splitlines()[0]
    assert first.startswith("# yaml-language-server: $schema=")
    # The server would not report a missing schema.
    assert (path.parent / first.partition("=")[2]).resolve().parent == ROOT / "schema"
    assert (path.parent / first.partition("=")[2]).is_file()
    assert server.problems(path, text) == []
