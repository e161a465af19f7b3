# SPDX-License-Identifier: Apache-2.0
"""Diagnostic codes, each with the examples that document and test it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from importlib.resources import files

import yaml

from bt_agents_core.diagnostic import Severity


class ExampleKind(Enum):
    """Kind of a code's examples; the value is its text for people."""

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
        """Language of the examples, as Markdown and highlighters name it."""
        return {ExampleKind.XML: "xml", ExampleKind.PACKAGE: "toml"}.get(self, "yaml")


@dataclass(frozen=True, kw_only=True)
class Code:
    """One code.

    Attributes:
        wrong: The smallest file with this problem as its first; empty if none is known. Marks
            replace invisible or long parts: ``⟨tab⟩``, ``⟨U+202E⟩`` for a character, ``⟨byte
            FC⟩``, and ``⟨[] × 1,000⟩`` for repetitions.
        kind: Kind of the examples. Agent and test files show only the relevant parts; in a folder,
            each file comes below a line ``# path``.
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
    """Return the codes by heading.

    The table is read at the first call, because only explanations need it.
    """
    table = files("bt_agents_language").joinpath("reference/codes.yaml")
    groups = yaml.load(table.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
    return {
        heading: tuple(
            Code(
                code=name,
                meaning=entry["meaning"],
                wrong=entry.get("wrong", ""),
                right=entry.get("right", ""),
                kind=ExampleKind[entry.get("file", "agent").upper()],
                severity=Severity(entry.get("severity", "error")),
            )
            for name, entry in group.items()
        )
        for heading, group in groups.items()
    }


@cache
def codes() -> Mapping[str, Code]:
    """Return every code that a problem can have, by its name."""
    return {one.code: one for group in code_groups().values() for one in group}
