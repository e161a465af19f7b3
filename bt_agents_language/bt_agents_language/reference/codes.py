# SPDX-License-Identifier: Apache-2.0
"""Diagnostic codes, each with the examples that document and test it, and their page."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from importlib.resources import files

import yaml

from bt_agents_core.diagnostic import Severity

_TABLE = "reference/codes.yaml"

_TOP = """\
# Errors and warnings

Made by `scripts/generate` from the table that the tests use; `bt-agents explain CODE` shows the
same in the terminal.

`bt-agents check` prints each problem as `file:line:column: error[code]: what was found and what is
expected`, with the line it is about and a hint. A file with an error is not used; an agent whose
file had no errors before keeps running as it was. A warning is about something that works, but
rarely as it was meant. Errors make the exit code 1, warnings do so with `--strict`.

With `--format json` it prints one object: `version` (1), `agents` (names of those without errors),
`files` (how many were checked), `unchecked` (files that need a scene or skills that are broken),
`errors`, `warnings` and `problems`, a list of `code`, `severity` (`error` or `warning`), `file`,
`line`, `column`, `end_line`, `end_column`, `message` and `hint` (may be empty). Lines and columns
count from 1, the end is the character behind the last one. With `--format github` each problem is
an annotation of a workflow.

Each example is the smallest file with the problem, and the same file without it. Examples of agent
and test files leave out what does not matter. `⟨…⟩` stands for what cannot be shown.
"""


class ExampleKind(Enum):
    """What the examples of a code are; the value says it to people."""

    AGENT = "part of an agent file"
    SKILLS = "a skills file"
    SCENE = "a scene file"
    SCRIPT = "a script"
    TEST = "part of a test file"
    FOLDER = "files of a trees folder"
    XML = "a file of Groot2"
    PACKAGE = "the pyproject.toml of a Python package"

    @property
    def language(self) -> str:
        """What the examples are written in, as Markdown and highlighters name it."""
        return {ExampleKind.XML: "xml", ExampleKind.PACKAGE: "toml"}.get(self, "yaml")


@dataclass(frozen=True, kw_only=True)
class Code:
    """One code.

    Attributes:
        code: Its name in reports.
        meaning: One sentence.
        wrong: The smallest file with this problem as its first; see :func:`example_bytes`.
        right: The same file without it.
        kind: What the examples are. Of an agent or test file they show only what matters; of a
            folder each file comes below a line ``# path``.
        severity: A file with a warning can be used, one with an error cannot.
    """

    code: str
    meaning: str
    wrong: str
    right: str
    kind: ExampleKind = ExampleKind.AGENT
    severity: Severity = Severity.ERROR


@cache
def code_groups() -> Mapping[str, tuple[Code, ...]]:
    """Return the codes by the heading that they stand under.

    The table is read at the first call, as only explanations need it.
    """
    text = files("bt_agents_language").joinpath(_TABLE).read_text(encoding="utf-8")
    groups = yaml.load(text, Loader=yaml.CSafeLoader)
    return {
        heading: tuple(_code(name, entry) for name, entry in codes.items())
        for heading, codes in groups.items()
    }


@cache
def codes() -> Mapping[str, Code]:
    """Return every code that a problem can have, by its name."""
    return {one.code: one for group in code_groups().values() for one in group}


def _code(name: str, entry: Mapping[str, str]) -> Code:
    return Code(
        code=name,
        meaning=entry["meaning"],
        wrong=entry["wrong"],
        right=entry["right"],
        kind=ExampleKind[entry.get("file", "agent").upper()],
        severity=Severity(entry.get("severity", "error")),
    )


_MARK = re.compile(r"⟨(?:(?P<tab>tab)|U\+(?P<point>[0-9A-F]{4})|byte (?P<byte>[0-9A-F]{2})"
                   r"|(?P<unit>.+?) × (?P<times>[0-9,]+))⟩")  # fmt: skip


def example_bytes(example: str) -> bytes:
    """Return an example as it would stand in a file.

    Examples stand for what cannot be seen or is too long by marks: ``⟨tab⟩``, ``⟨U+202E⟩`` for a
    character, ``⟨byte FC⟩``, and ``⟨[] × 1,000⟩`` for so many times the same.
    """
    data = b""
    at = 0
    for mark in _MARK.finditer(example):
        data += example[at : mark.start()].encode() + _marked(mark)
        at = mark.end()
    return data + example[at:].encode()


def _marked(mark: re.Match[str]) -> bytes:
    if mark["tab"]:
        return b"\t"
    if mark["point"]:
        return chr(int(mark["point"], 16)).encode()
    if mark["byte"]:
        return bytes([int(mark["byte"], 16)])
    return mark["unit"].encode() * int(mark["times"].replace(",", ""))


def codes_page() -> str:
    """Return the Markdown page of all codes."""
    parts = [_TOP]
    for heading, group in code_groups().items():
        parts.append(f"## {heading}")
        parts += [_section(code) for code in group]
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


def _section(code: Code) -> str:
    language = code.kind.language
    return "\n\n".join(
        [
            f"### {code.code}",
            f"{code.meaning} Shown as {code.kind.value}:",
            f"~~~{language}\n{code.wrong}~~~",
            "Right:",
            f"~~~{language}\n{code.right}~~~",
        ]
    )
