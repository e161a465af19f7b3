# SPDX-License-Identifier: Apache-2.0
"""The page about reliability names tests that are there, and a soak's table with each promise."""

from __future__ import annotations

import re
from pathlib import Path

from soak_promises import PROMISES

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reliability.md").read_text()


def test_every_file_that_the_page_names_is_there() -> None:
    named = set(re.findall(r"`(tests/[\w/]+\.py)", PAGE))
    assert len(named) > 5
    assert [path for path in sorted(named) if not (ROOT / path).is_file()] == []


def test_the_table_of_the_longest_soak_has_a_line_for_each_promise() -> None:
    counts = dict(re.findall(r"^(\S.*?) {2,}(\d+) +\d+$", PAGE, re.MULTILINE))
    assert set(PROMISES) <= counts.keys()
