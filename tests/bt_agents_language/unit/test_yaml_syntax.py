# SPDX-License-Identifier: Apache-2.0
"""Syntax errors: their place, a hint, and checks of the rest of the file."""

from __future__ import annotations

import textwrap

import pytest

from agent_texts import HEAD, refusal
from bt_agents_core.errors import ReadError
from bt_agents_language.yaml.source import Edit, PatchedSource, Source, without_section
from bt_agents_language.yaml.yaml_reader import MAX_SYNTAX_ERRORS
from file_texts import read_agent_text
from tree_harness import SYMBOLS


def report(text: str) -> ReadError:
    return refusal(read_agent_text, text, "a.yaml", SYMBOLS)


def found(text: str) -> list[str]:
    return [f"{d.code} {d.position.line}:{d.position.column}" for d in report(text).diagnostics]


def tree(text: str) -> str:
    """Return an agent file; the first line of the tree is the fifth."""
    return HEAD + "tree:\n" + textwrap.indent(text, "  ")


QUOTE = "quote a text with ': ' in it: \"…: …\""


@pytest.mark.parametrize(
    ("marked", "message", "hint"),
    [
        ("«sequence\n  - say: A.", "a ':' is missing after 'sequence'", "write 'sequence:'"),
        ("say: A.\nwhen«:b", "a space is missing after 'when:'", "write 'when: b'"),
        ("say «= A.\ntimeout: 5 s", "'=' follows 'say', expected ':'", "write 'say: A.'"),
        (
            "say«：Hello.\ntimeout: 5 s",  # noqa: RUF001
            "'：' looks like a colon, but is another character",  # noqa: RUF001
            "write 'say: …'",
        ),
        ("say: Hello«: you.", "this line has a second ':'", QUOTE),
        (
            "sequence:\n  «-\u00a0say: A.",
            "a no-break space (U+00A0) follows '-'",
            "delete what is in front of the first word, and type '- '",
        ),
        (
            "sequence:\n  - say: A.\n  «-say: B.",
            "a space is missing after '-'",
            "write '- say: B.'",
        ),
        (
            "sequence:\n  - say: A.\n  «say: B.",
            "this line is in a list of '-' items, but does not start with '- '",
            "put '- ' in front of it, or indent it if it belongs to the item above",
        ),
        (
            "sequence:\n  - say: A.\n  «• log\n  - say: B.",
            "'•' cannot start an item of a list",
            "write '- ', a minus sign and a space",
        ),
        ("say: «@home", "a text cannot start with '@'", 'quote it: "…"'),
        ("say: «? what", "a text cannot start with '?'", 'quote it: "…"'),
        (
            "say: «- what",
            "a '-' item starts in the middle of a line",
            "start it on a line of its own, or quote a text that starts with '- '",
        ),
        (
            'say: «"A.\ntimeout: 5 s',
            "this quotation mark is not closed",
            "add one at the end of the text",
        ),
        (
            'sequence:\n  - say: «"A.\n  - say: "B."',
            "this quotation mark is closed only in line 7",
            "close it before",
        ),
        (
            "say: «{text: A.\ntimeout: 5 s",
            "this '{' is not closed",
            "close it with '}' at the end of the value",
        ),
        (
            "say: {\n  text: A.\n  «rate: 1.0\n}",
            "a ',' is expected before 'rate'",
            "put a ',' between two values, and quote a text with ': ' in it",
        ),
        (
            "say: «{text: Gate #4}",
            "this '{' is not closed",
            "a '#' after a space starts a comment: put quotes around the text",
        ),
        (
            "say: {text: «${a}}",
            "${…} stands without quotes inside { … } or [ … ]",
            'quote it there: "${name}"',
        ),
        (
            "«\tsay: A.",
            "a tab indents this line",
            "use spaces (most editors can turn tabs into spaces)",
        ),
        (
            "say: A.\n«there friend\ntimeout: 5 s",
            "this line is neither 'key: value' nor a '-' item",
            "write 'there: friend', or indent the line if it belongs to the text above",
        ),
        ("say: A.\n«// B\ntimeout: 5 s", "'//' starts no comment here", "write '# B'"),
        ("«/* first */\nsay: A.", "'/*' starts no comment here", "write '# first'"),
        ("say: 'A.' «// note", "'//' starts no comment here", "write '# note'"),
        ("say: A. «// a: b", "'//' starts no comment here", "write '# a: b'"),
        ("sequence: «// B\n- say: A.", "'//' starts no comment here", "write '# B'"),
        ("say: 'A // B'\nname: y«: z", "this line has a second ':'", QUOTE),
    ],
)
def test_syntax_error_is_reported_at_its_mark(marked, message, hint):
    before, after = marked.split("«")
    (first, *_) = report(tree(before + after)).diagnostics
    # Four lines precede the tree, and two spaces each of its lines.
    lines = before.split("\n")
    place = (4 + len(lines), len(lines[-1]) + 3)
    assert (first.position.line, first.position.column) == place
    assert (first.message, first.hint) == (message, hint)


@pytest.mark.parametrize("first", ["format:1", "format", "format = 1"])
def test_first_line_error_is_reported_on_first_line(first):
    text = HEAD.replace("format: 1", first) + "tree: {say: Hello.}\n"
    (error, *_) = report(text).diagnostics
    assert (error.code, error.position.line) == ("syntax", 1)


@pytest.mark.parametrize(
    "line",
    [
        "title:A guide",
        "title: A guide: patient",
        "title: @guide",
        "title = A guide",
        "tags: [a, b",
        r'title: "A \guide"',
        "tags: [a, b}",
    ],
)
def test_unambiguous_syntax_error_hides_no_other_errors(line):
    text = HEAD + line + "\ntree:\n  sequence:\n    - sya: Hello.\n    - wait: 3 parsecs\n"
    assert [one.split()[0] for one in found(text)] == ["syntax", "unknown-node", "bad-duration"]
    assert found(text)[1:] == ["unknown-node 7:7", "bad-duration 8:13"]


def test_errors_in_repaired_line_keep_their_positions():
    text = tree("sequence:\n  - sya:Hello ${who}.\n    timeout: 5 s")
    assert found(text) == ["unknown-node 6:7", "syntax 6:10", "unknown-name 6:19"]


def test_several_syntax_errors_are_found_in_one_pass():
    text = tree("sequence\n  - say:A.\n    timeout: 5 s\n  -wait: 2 s\n  - say: B: C")
    assert found(text) == ["syntax 5:3", "syntax 6:10", "syntax 8:5", "syntax 9:13"]


def test_other_keys_are_checked_after_ambiguous_error():
    text = HEAD + "tree:\n  say: A.\n timeout: 5 s\ntitle: A: B\ntags: {a: b]\n"
    assert found(text) == ["syntax 6:2", "syntax 7:9", "syntax 8:12"]


def test_number_of_syntax_errors_is_bounded():
    for line in ("a: b: c\n", "}\n", "- a\nb\n"):
        slips = [one for one in found(line * 500) if one.startswith("syntax")]
        assert 1 <= len(slips) <= MAX_SYNTAX_ERRORS


def test_repaired_text_keeps_positions_of_file():
    source = Source("a.yaml", "ab:c\nd: e\n")
    mended = PatchedSource(source, Edit(start=3, stop=3, text=" "))
    assert mended.text == "ab: c\nd: e\n"
    assert [mended.position(i).column for i in range(6)] == [1, 2, 3, 4, 4, 5]
    assert str(mended.position(6)) == "a.yaml:2:1"
    assert mended.line(1) == "ab:c"
    again = PatchedSource(mended, Edit(start=6, stop=7, text=""))
    assert again.text == "ab: c\n: e\n"
    assert str(again.position(6)) == "a.yaml:2:2"


@pytest.mark.parametrize(
    ("index", "rest"), [(0, "b: 2\n"), (4, "b: 2\n"), (12, "a:\n  - 1\n# c\n")]
)
def test_section_is_top_level_key_with_its_block(index, rest):
    mended = without_section(Source("a.yaml", "a:\n  - 1\n# c\nb: 2\n"), index + (index == 12) * 2)
    assert mended.text == rest


def test_removal_of_only_section_leaves_nothing():
    assert without_section(Source("a.yaml", "a: 1\n"), 2) is None


@pytest.mark.parametrize("after", ["", " = x", ":x\nb: 1: 2", "\uff1a x", " - x: y: z"])
def test_very_long_word_is_shortened_in_messages(after):
    text = "format: 1\n" + "a" * 400 + after + "\ntree: {say: x}\n"
    assert max(map(len, report(text).report.splitlines())) <= 200
