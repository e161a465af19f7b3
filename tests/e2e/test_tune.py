# SPDX-License-Identifier: Apache-2.0
"""Tuning from the command line: change, undo, keep in files, restart."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from programs import Ask, Start

pytestmark = pytest.mark.e2e


def test_author_tunes_running_system_and_keeps_result(
    start_up: Start, ask: Ask, trees: Path
) -> None:
    file = trees / "agents" / "attentive_guide.yaml"
    before = file.read_text()
    up = start_up(str(trees))
    table = ask("tune", "attentive_guide")
    assert re.search(r"  patience +8 s +2 s to 30 s +how long to wait for an answer", table)
    assert "large_print" in ask("tune")

    changed = ask("tune", "attentive_guide", "patience=12", "voice_rate=1.05", "--author", "anna")
    assert changed == (
        f"trees folder of the system: {trees}\n"
        "attentive_guide.patience: 8 s → 12 s, attentive_guide.voice_rate: 0.9 → 1.05 "
        "(revision 1)\n"
    )
    assert re.search(r"  patience +12 s +file: 8 s", ask("tune", "attentive_guide"))
    assert "(revision 2)" in ask("tune", "tick_rate=30")
    tuned = ask("tune", "attentive_guide", "profile.age=4.5", "--reason", "old", "--author", "eva")
    assert re.search(
        r"^attentive_guide: age 4 → 4\.5 \(revision \d of the profile\)$", tuned, re.M
    )
    up.until(r"set for attentive_guide by tuning: tuned by eva: old")
    up.until(r"attentive_guide \[4, 1\.5, 3\] → \[4\.5, 1\.5, 3\]")
    assert "age 4.5" in ask("status")
    assert re.search(r"  profile\.age +4\.5 +file: 4", ask("tune", "attentive_guide"))
    assert "OUT_OF_RANGE" in ask("tune", "attentive_guide", "profile.age=9", code=1)
    assert "did you mean 'age'" in ask("tune", "attentive_guide", "profile.agee=3", code=1)

    assert "OUT_OF_RANGE: attentive_guide.patience is 99 s" in ask(
        "tune", "attentive_guide", "patience=99", code=1
    )
    assert "did you mean 'attentive_guide.patience'" in ask(
        "tune", "attentive_guide", "patiense=9", code=1
    )
    assert "no agent 'nobody'" in ask("tune", "nobody", "patience=9", code=1)
    assert "name=value" in ask("tune", "attentive_guide", "patience", code=2)

    assert "keeps 4 values" in ask("preset", "save", "care home", "attentive_guide")
    again = ("preset", "save", "care home", "attentive_guide")
    assert "preset 'care home' has 4 values already; replace it?" in ask(*again, code=1)
    assert "keeps 4 values" in ask(*again, "--replace")
    assert "care home" in ask("preset")
    preset = (trees / "presets" / "care_home.yaml").read_text()
    assert "  attentive_guide:\n" in preset
    assert "    patience: 12 s\n" in preset
    assert re.search(r"attentive_guide\.patience +12 s", ask("preset", "show", "care home"))
    assert "no preset 'night'" in ask("preset", "apply", "night", code=1)
    undone = ask("tune", "--undo")
    assert "undo of a profile: attentive_guide: age 4.5 → 4" in undone
    assert "undo of revision 1" in ask("tune", "--undo", "attentive_guide")
    assert "12 s → 8 s  (anna" not in ask("tune", "--history")
    assert "patience: 8 s → 12 s" in ask("preset", "apply", "care home")

    diff = ask("keep", "--dry-run")
    assert diff.count("\n+  ") == 2
    assert file.read_text() == before
    kept = ask("keep")
    assert "attentive_guide.patience: 8 s → 12 s" in kept
    assert file.read_text() == before.replace("default: 0.9,", "default: 1.05,").replace(
        "default: 8 s,", "default: 12 s,"
    )
    up.until("attentive_guide: version 2")
    assert "nothing to keep" in ask("keep")
    assert "nothing has changed" in ask("reload")
    assert up.stop()[0] == 0

    start_up(str(trees))
    assert re.search(r"  patience +12 s +2 s to 30 s", ask("tune", "attentive_guide"))
    assert re.search(r"^tick_rate +30 +file: 20", ask("tune"), re.MULTILINE)
    assert "care home" in ask("preset")
    assert "12 s → 8 s" in ask("tune", "--undo", "attentive_guide")
    assert "is forgotten" in ask("preset", "forget", "care home")


def test_file_differing_from_loaded_version_is_not_written(
    start_up: Start, ask: Ask, trees: Path
) -> None:
    file = trees / "agents" / "attentive_guide.yaml"
    up = start_up(str(trees))
    ask("tune", "attentive_guide", "patience=12")
    broken = file.read_text().replace("sequence:", "sequenze:")
    file.write_text(broken)
    up.until("attentive_guide: version 1 stays, as its file is broken: ")
    assert "version 1; broken: attentive_guide.yaml:" in ask("status")
    assert "error[" in ask("keep", code=1)
    assert file.read_text() == broken
