# SPDX-License-Identifier: Apache-2.0
"""A corpus of files, most of them bad: exactly the expected problems, with code and place."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import hostile_inputs
from bt_agents_core.diagnostic import Diagnostic, Severity
from bt_agents_core.errors import ReadError
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.reference.codes import ExampleKind, codes
from file_readers import ALONE, READERS, Reader, check_memory, read_library, read_quickly
from tree_harness import SYMBOLS

KEPT = Path(__file__).parents[2] / "corpus"
WIDEST = 200
FLOOD = 20
"""With more errors than this, an expectation has the first one and '…'."""

ELSEWHERE = {
    # Around a file, not in it.
    "duplicate-agent", "duplicate-preset", "no-agents", "no-texts",
    # Known only with ROS.
    "unknown-ros-type", "unknown-ros-field",
    # A fault of the reader itself.
    "reader-fault",
}  # fmt: skip
LINE = re.compile(r"(?P<file>.+?):(?P<place>\d+:\d+): error\[(?P<code>[a-z0-9-]+)\]: .+")


def read_importer(path: Path) -> None:
    """Read a library, or an agent that imports some."""
    if path.parent.name == "agents":
        read_agent(path, replace(SYMBOLS, libraries=FolderLibraries(path.parents[1], ALONE)))
    else:
        read_library(path)


READER_OF: dict[str, Reader] = {
    "agents": lambda path: read_agent(path, ALONE),
    "imports": read_importer,
    "skills": READERS["skills"],
    "scenes": READERS["scene"],
    "markets": READERS["market"],
    "scripts": READERS["script"],
    "presets": READERS["preset"],
    "experiments": READERS["experiment"],
}
"""Folder of the corpus → reader of its files."""


def expectations() -> dict[str, str]:
    """Return the expected problems by file: 'code line:column' of each, in the order of the file.

    For a file without errors, these are the warnings of its reader.
    """
    files = sorted((KEPT / "expected").glob("*.txt"))
    lines = [line for file in files for line in file.read_text(encoding="utf-8").splitlines()]
    pairs = [line.split(":", 1) for line in lines if line and not line.startswith("#")]
    expected = {file: errors.strip() for file, errors in pairs}
    assert len(expected) == len(pairs), "a file is listed twice"
    return expected


EXPECTED = expectations()


@pytest.fixture(scope="module")
def corpus(tmp_path_factory) -> Path:
    """The corpus with the generated files, which are too large to store or not regular files."""
    copy = tmp_path_factory.mktemp("corpus") / "corpus"
    shutil.copytree(KEPT, copy)
    hostile_inputs.build(copy)
    return copy


def told(warning: Diagnostic) -> str:
    return f"{warning.code} {warning.position.line}:{warning.position.column}"


def outcome(corpus: Path, file: str) -> tuple[str, ReadError | None]:
    """Return the problems of a file in the form of an expectation."""
    read = read_quickly(READER_OF[file.partition("/")[0]], corpus / file)
    if not isinstance(read, ReadError):
        return ", ".join(map(told, getattr(read, "warnings", ()))), None
    matches = [LINE.fullmatch(line) for line in read.lines[:FLOOD]]
    assert all(m is not None and m["file"] == str(corpus / file) for m in matches), read.lines
    found = [f"{m['code']} {m['place']}" for m in matches if m is not None]
    if len(read.lines) > FLOOD:
        found[1:] = ["…"]
    return ", ".join(found), read


@pytest.mark.parametrize("file", EXPECTED)
def test_every_error_is_found_at_its_position(file, corpus):
    found, error = outcome(corpus, file)
    assert found == EXPECTED[file]
    if error is not None:
        report = error.report.replace(str(corpus), "trees")
        assert max(len(line) for line in report.splitlines()) <= WIDEST


@pytest.mark.parametrize("file", [file for file in EXPECTED if file in hostile_inputs.BUILT])
def test_yaml_bombs_use_little_memory(file, corpus):
    check_memory(READER_OF[file.partition("/")[0]], corpus / file)


def test_every_code_is_provoked_by_file_or_test():
    provoked = set(re.findall(r"([a-z0-9-]+) \d+:\d+", " ".join(EXPECTED.values())))
    errors = {
        code
        for code, entry in codes().items()
        if entry.severity is Severity.ERROR
        and entry.kind not in (ExampleKind.TEST, ExampleKind.XML)
    }
    warnings = {code for code, entry in codes().items() if entry.severity is Severity.WARNING}
    assert (provoked - warnings) | ELSEWHERE == errors
    assert not provoked & ELSEWHERE


def test_every_file_of_the_corpus_has_an_expectation():
    kept = {str(path.relative_to(KEPT)) for path in KEPT.rglob("*.yaml")}
    built = {name for name in hostile_inputs.BUILT if not name.startswith(hostile_inputs.UNLISTED)}
    assert kept | built | set(hostile_inputs.NO_FILES) == set(EXPECTED)
    assert len(EXPECTED) >= 450
