# SPDX-License-Identifier: Apache-2.0
"""The glossary: alphabetical order, one line per term, and an existing module for each."""

from __future__ import annotations

import pytest

from programs import ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.split("\n## Glossary\n")[1].splitlines()
    if line.startswith("| ") and not line.startswith("| term ")
]


def test_terms_are_unique_and_alphabetical():
    terms = [term for term, _, _ in ROWS]
    assert terms == sorted(set(terms))
    assert len(terms) > 60


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_term_has_one_sentence_and_a_home(row: list[str]):
    _, meaning, where = row
    assert meaning
    assert not meaning.endswith(".")
    package, *path = where.strip("`").split(".")
    home = ROOT.joinpath(package, package, *path)
    assert home.with_suffix(".py").is_file() or (home / "__init__.py").is_file()
