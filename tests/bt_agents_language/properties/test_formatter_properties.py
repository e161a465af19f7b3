# SPDX-License-Identifier: Apache-2.0
"""Laws of the formatter: it changes how a file looks, never what it says or what people noted."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.tools.formatting.comments import find_comments
from bt_agents_language.tools.formatting.formatter import format_source, same_meaning
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_language.yaml.yaml_reader import Node, read_yaml
from file_texts import read_agent_text

ROOT = Path(__file__).parents[3]
TREES = ROOT / "trees"
POSITION = re.compile(r"Position\([^()]*\)")
FILES = sorted(
    path
    for folder in ("trees", "experiments", "tests/corpus", "bt_agents_bringup/params")
    for path in (ROOT / folder).rglob("*.yaml")
    if path.is_file()
)
DOCS = sorted((ROOT / "docs").glob("*.md"))
EXAMPLES = {
    f"{path.name}:{number}": match[1]
    for path in DOCS
    for number, match in enumerate(
        re.finditer(r"^```yaml\n(.*?)^```", path.read_text(encoding="utf-8"), re.M | re.S)
    )
}


def read(text: str) -> Node | None:
    """Return the document of a text, None when it is refused."""
    problems = Diagnostics(None)
    try:
        root = read_yaml(Source("a.yaml", text), problems)
    except ReadError:
        return None
    return None if problems else root


def comments(text: str) -> list[str]:
    root = read(text)
    assert root is not None
    return [comment.text for comment in find_comments(Source("a.yaml", text), root)]


def check_laws(text: str) -> None:
    text = re.sub("\r\n?", "\n", text)
    root = read(text)
    assert root is not None
    formatted = format_source(Source("a.yaml", text))
    again = read(formatted)
    assert again is not None
    assert same_meaning(root, again)
    assert comments(formatted) == comments(text)
    assert format_source(Source("a.yaml", formatted)) == formatted
    assert formatted.endswith("\n")
    assert "\r" not in formatted


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_file_of_the_project_keeps_the_laws_or_is_refused(path):
    try:
        text = read_source(path).text
    except ReadError:
        return
    if read(text) is None:
        with pytest.raises(ReadError):
            format_source(Source("a.yaml", text))
    else:
        check_laws(text)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_of_the_docs_keeps_the_laws(name):
    if read(EXAMPLES[name]) is not None:
        check_laws(EXAMPLES[name])


@pytest.mark.parametrize("agent", read_trees(TREES).agents, ids=lambda agent: agent.name)
def test_a_formatted_agent_is_the_same_agent(agent):
    text = format_source(read_source(Path(agent.file)))
    again = read_agent_text(text, agent.file, read_trees(TREES).symbols)
    assert POSITION.sub("", repr(again)) == POSITION.sub("", repr(agent))


WORDS = [
    "say", "name", "when", "timeout", "on_failure", "sequence", "tree", "with", "children",
    "retry", "\"on\"", "'two words'", "\"a b\"",
]  # fmt: skip
PLAIN = [
    "1", "5 s", "yes", "true", "~", "", "Hello there.", "Where to?", "${x}", "a, b", "x#y", "-1",
    "scene.age >= 4", "it's", 'a "b" c', "...", "a:b", "é 👋", "010", "\\",
]  # fmt: skip
QUOTED = [
    '"yes"', "'no'", '"first_time"', "'first time'", '"${x}"', '"a\\nb"', "'it''s'", "'a\"b\\'",
    '"Shall we go?"', '""', "' x '", '"1"', "'5 s'", '"# no comment"', '"a: b"', '"\\u00e9"',
]  # fmt: skip
COMMENTS = ["# one", "#two", "#", "# a: b - [", "# 'quote", "#  wide  "]


@st.composite
def blanks(draw: st.DrawFn, indent: int) -> list[str]:
    """Comments and blank lines between two lines."""
    lines = []
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
        depth = draw(st.sampled_from([indent, indent, max(indent - 1, 0), indent + 3, 0]))
        kind = draw(st.sampled_from(["blank", "spaces", "comment"]))
        comment = " " * depth + draw(st.sampled_from(COMMENTS))
        lines.append({"blank": "", "spaces": " " * depth, "comment": comment}[kind])
    return lines


@st.composite
def end_of_line(draw: st.DrawFn) -> str:
    return draw(st.sampled_from(["", "", "", "  ", " # eol", "      #wide", " \t# tab"]))


@st.composite
def flows(draw: st.DrawFn, depth: int = 2) -> str:
    """A value in braces or brackets, perhaps over several lines with comments."""
    gap = st.sampled_from(["", " ", " ", "  ", "\n      ", " # in\n        ", "\n\n      "])
    if depth == 0 or draw(st.booleans()):
        return draw(st.sampled_from([*QUOTED, "1", "a b", "5 s", "yes", "text\n      more", "é"]))
    items = []
    for number in range(draw(st.integers(0, 3))):
        value = draw(flows(depth - 1))
        items.append((number, value))
    if draw(st.booleans()):
        body = ",".join(f"{draw(gap)}k{n}: {draw(gap)}{value}{draw(gap)}" for n, value in items)
        return "{" + body + draw(gap) + "}"
    pair = draw(st.sampled_from(["", "", "pair: "]))
    body = ",".join(f"{draw(gap)}{pair}{value}{draw(gap)}" for _, value in items)
    return "[" + body + draw(gap) + "]"


@st.composite
def blocks(draw: st.DrawFn, indent: int, depth: int) -> list[str]:
    """Lines of a list or mapping, the first without its indentation."""
    step = draw(st.integers(1, 4))
    lines: list[str] = []
    is_list = draw(st.booleans())
    keys = draw(st.lists(st.sampled_from(WORDS), min_size=1, max_size=4, unique=True))
    for key in keys:
        if lines:
            lines += draw(blanks(indent))
        head = "-" if is_list else f"{key}:"
        space = "" if not lines else " " * indent
        kind = draw(st.sampled_from(["plain", "quoted", "flow", "block", "text", "long", "below"]))
        eol = draw(end_of_line())
        deep = indent + step
        if kind == "block" and depth:
            if is_list and draw(st.booleans()):
                inner = draw(blocks(indent + 2, depth - 1))
                lines += [f"{space}- {inner[0]}", *inner[1:]]
                continue
            same = not is_list and draw(st.booleans())
            inner = draw(blocks(deep, depth - 1))
            if same and inner[0].startswith("- "):
                inner = draw(blocks(deep, 0))
            lines.append(f"{space}{head}{eol}")
            lines += draw(blanks(deep))
            lines += [" " * deep + inner[0], *inner[1:]]
        elif kind == "text":
            sign = draw(st.sampled_from(["|", ">", "|-", ">+", "|+", f"|{step}", f">{step}-"]))
            comment = draw(st.sampled_from(["", " # sign"]))
            lines.append(f"{space}{head} {sign}{comment}")
            bodies = ["text", "", " deeper", "# no comment", "ends with spaces  ", "\ttab", "   "]
            body = draw(st.lists(st.sampled_from(bodies), max_size=4))
            lines += [" " * deep + line if line else "" for line in ("first", *body)]
        elif kind == "long":
            quote = draw(st.sampled_from(["", "'", '"']))
            lines.append(f"{space}{head} {quote}one two")
            lines += draw(st.lists(st.sampled_from(["", " " * deep + "three"]), max_size=3))
            lines.append(f"{' ' * deep}four{quote}{eol}")
        elif kind == "below":
            lines.append(f"{space}{head}{eol}")
            lines += draw(blanks(deep))
            lines.append(" " * deep + draw(st.sampled_from([*QUOTED, "word", "x" * 95])) + eol)
        else:
            words = st.sampled_from(PLAIN if kind == "plain" else QUOTED)
            value = draw(flows() if kind == "flow" else words)
            lines.append(f"{space}{head} {value}{eol}")
    return lines


@st.composite
def documents(draw: st.DrawFn) -> str:
    in_tree = draw(st.booleans())
    first, *others = draw(blocks(1 if in_tree else 0, 3))
    body = ["tree:", f" {first}", *others] if in_tree else [first, *others]
    lines = [*draw(blanks(0)), *body, *draw(blanks(0))]
    end = draw(st.sampled_from(["\n", "", "\r\n", "\n...\n# over\n"]))
    return ("---\n" if end.startswith("\n.") else "") + "\n".join(lines) + end


@settings(deadline=None, max_examples=300)
@given(documents())
def test_a_formatted_document_says_the_same_with_all_its_comments_and_stays(text):
    assume(read(text) is not None)
    check_laws(text)


SEEDS = [path.read_text(encoding="utf-8") for path in FILES if "corpus" not in path.parts]
PIECES = [
    "\n", "\n\n", " # c", "\n# own\n", "\n      # deep\n", "{", "}", "[", "]", ", ", ": ", "- ",
    "? ", '"', "'", "|\n", "'x'", '"y"', "name: z\n", "timeout: 5 s\n", "  ", "?", "\\", "\t",
]  # fmt: skip


@settings(deadline=None, max_examples=200)
@given(st.sampled_from(SEEDS), st.lists(st.tuples(st.integers(0), st.sampled_from(PIECES))))
def test_a_file_with_slips_keeps_the_laws_or_is_refused(text, slips):
    for at, piece in slips[:4]:
        at %= len(text)
        text = text[:at] + piece + text[at:]
    if read(text) is not None:
        check_laws(text)
        return
    with pytest.raises(BtAgentsError):
        format_source(Source("a.yaml", text))
