# SPDX-License-Identifier: Apache-2.0
"""Agents that are edited, broken, repaired and rolled back while the system runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from programs import Ask, Start

pytestmark = pytest.mark.e2e


def test_an_author_edits_agents_of_a_running_system(
    start_up: Start, ask: Ask, trees: Path
) -> None:
    file = trees / "agents" / "attentive_guide.yaml"
    first = file.read_text()
    up = start_up(str(trees))
    file.write_text(first.replace("default: 8 s", "default: 12 s"))
    up.until(re.escape("attentive_guide: version 2 in force (patience: 8 s → 12 s)"))
    file.write_text(first.replace("- light: green", "- light: green\n    - wait: 1 s"))
    up.until(r"attentive_guide: version 3 in force \(tree changed: 1 node added; patience: 12 s")
    file.write_text(first.replace("sequence:", "sequenze:", 1))
    up.until("attentive_guide: version 3 stays, as its file is broken: ")
    said = ask("status")
    assert "version 3; broken: attentive_guide.yaml:" in said
    assert "error[" in said
    file.write_text(first)
    up.until("attentive_guide: version 4 in force")
    assert "nothing has changed" in ask("reload")
    (trees / "agents" / "silent_text.yaml").unlink()
    up.until("silent_text does not bid any more")
    assert "silent_text" not in ask("status")
