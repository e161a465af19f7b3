# SPDX-License-Identifier: Apache-2.0
"""Paths and packages named in the documents, and the files of one cycle."""

from __future__ import annotations

import ast
import re

import pytest

from checkout import PACKAGES, PYTHON_PACKAGES, ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
DOCUMENTS = ("CONTRIBUTING.md", "README.md", "docs/how_to_add.md", "docs/architecture.md")
# The output of benchmarks and pages in "build" is not part of the checkout.
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir()} - {"build"}
NAMED = re.compile(r"`((?:\.\w|\w)[\w.*/-]*)`")
MOST_STEPS = 45
MOST_ASKED = 18


def section(heading: str) -> str:
    """Return the text under a heading, including subsections."""
    level = heading.partition(" ")[0]
    return re.split(rf"^#{{1,{len(level)}}} ", PAGE.partition(f"\n{heading}\n")[2], flags=re.M)[0]


def steps() -> list[tuple[int, str]]:
    """Return the numbered files of one cycle."""
    found = re.findall(r"^(\d+)\. `([^`]+)` ", section("## The way of one cycle"), re.MULTILINE)
    return [(int(number), path) for number, path in found]


def what_to_read() -> list[tuple[str, list[str]]]:
    """Return the file of each step, and the classes, functions and methods to read in it."""
    found = re.findall(
        r"^\d+\. `([^`]+)` (.*?)\n(?=\d+\. |\n)", section("## The way of one cycle"), re.M | re.S
    )
    read = [(path, " ".join(text.split()).partition(" Read ")[2]) for path, text in found]
    return [(path, re.findall(r"`([^`]+)`", names)) for path, names in read]


def definitions(path: str) -> set[str]:
    """Return the names of the classes, methods (``Class.method``) and functions of a file."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    names: set[str] = set()
    for one in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
        if isinstance(one, (ast.ClassDef, *functions)):
            names.add(one.name)
            inside = one.body if isinstance(one, ast.ClassDef) else []
            names |= {f"{one.name}.{part.name}" for part in inside if isinstance(part, functions)}
    return names


def asked() -> list[str]:
    """Return the files that the steps ask."""
    lines = re.findall(r"^- (.*)", section("### Asked on the way"), re.MULTILINE)
    return [path for line in lines for path in re.findall(r"`([^`]+)`", line)]


def test_page_lists_each_file_of_cycle_once() -> None:
    numbers = [number for number, _ in steps()]
    paths = [path for _, path in steps()]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len({*paths, *asked()}) == len(paths) + len(asked())
    assert len(paths) <= MOST_STEPS
    assert len(asked()) <= MOST_ASKED
    said = re.search(r"passes (\d+) files.*?(\d+) more are", PAGE, re.DOTALL)
    assert said is not None
    assert [int(number) for number in said.groups()] == [len(paths), len(asked())]
    assert all((ROOT / path).is_file() for path in (*paths, *asked()))


def test_each_step_names_what_to_read_in_its_file() -> None:
    assert len(what_to_read()) == len(steps())
    for path, names in what_to_read():
        assert names, path
        assert set(names) <= definitions(path), path


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_documented_path_exists(document: str) -> None:
    text = (ROOT / document).read_text(encoding="utf-8")
    paths = {
        path
        for path in NAMED.findall(re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))
        if "/" in path and path.split("/")[0] in FOLDERS
    }
    assert paths
    for path in paths:
        assert any(ROOT.glob(path.rstrip("/"))), f"{document}: {path}"


def test_packages_import_only_packages_from_lower_rows() -> None:
    rows = {
        name: int(row)
        for row, name in re.findall(
            r"^\| (\d) \| `(\w+)` \|", section("## Packages"), re.MULTILINE
        )
    }
    assert rows.keys() == {package.name for package in PYTHON_PACKAGES}
    for package in PYTHON_PACKAGES:
        for needed in package.dependencies & rows.keys():
            assert rows[package.name] < rows[needed], f"{package.name} → {needed}"


@pytest.mark.parametrize("document", ["README.md", "docs/architecture.md"])
def test_document_names_every_package_of_checkout(document: str) -> None:
    text = (ROOT / document).read_text(encoding="utf-8")
    for package in PACKAGES:
        assert re.search(rf"`{package.folder.name}/?`", text), package.name


def test_every_command_in_contributing_guide_exists() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    commands = re.findall(r"^\$ ([^#\n]+)", text, re.MULTILINE)
    assert commands
    for path in re.findall(r"(?:scripts|tests|\.ci)/[\w./-]+", " ".join(commands)):
        assert (ROOT / path).exists(), path


def test_contributing_guide_names_every_test_folder() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    packages = {package.name for package in PYTHON_PACKAGES}
    for folder in (ROOT / "tests").iterdir():
        if folder.is_dir() and folder.name != "__pycache__" and folder.name not in packages:
            assert f"`tests/{folder.name}`" in text, folder.name
