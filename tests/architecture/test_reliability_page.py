# SPDX-License-Identifier: Apache-2.0
"""The page about reliability: its tests exist, and its soak table lists every promise."""

from __future__ import annotations

import re
from pathlib import Path

from soak_promises import PROMISES

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reliability.md").read_text()


def test_every_file_named_on_page_exists() -> None:
    named = set(re.findall(r"`(tests/[\w/]+\.py)", PAGE))
    assert len(named) > 5
    assert [path for path in sorted(named) if not (ROOT / path).is_file()] == []


def test_soak_table_has_a_row_for_each_promise() -> None:
    counts = dict(re.findall(r"^(\S.*?) {2,}(\d+) +\d+$", PAGE, re.MULTILINE))
    assert set(PROMISES) <= counts.keys()
