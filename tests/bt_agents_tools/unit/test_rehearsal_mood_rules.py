# SPDX-License-Identifier: Apache-2.0
"""Mood rules in rehearsals: evaluated by the same code as on the robot."""

from __future__ import annotations

import pytest

from bt_agents_tools.rehearsal.events import EventKind
from rehearsal_harness import events_of, rehearsed


def feedback(rule: str, *happenings: str) -> list[tuple[float, str]]:
    """Return when and why a rule fires in a run of 60 s."""
    during = "during: [" + ", ".join(f"{{{one}}}" for one in happenings) + "]\n"
    head = f"feedback: [{{give: positive, {rule}}}]\n"
    return events_of(rehearsed("wait: 60 s", during, head=head), EventKind.FEEDBACK)


BETTER = "when: mood.change >= 0.5, for: 2 s"


def test_rule_fires_again_after_its_cooldown():
    fired = feedback(f"{BETTER}, cooldown: 20 s", "after: 1 s, mood: 4")
    assert [at for at, _ in fired] == pytest.approx([3.0, 25.0, 47.0], abs=0.01)


def test_undecidable_rule_is_reported():
    head = "feedback: [{give: positive, when: 1 / (live.mood - 4) > 0}]\n"
    result = rehearsed("wait: 9 s", "during: [{after: 2 s, mood: 4}]\n", head=head)
    assert events_of(result, EventKind.LOGS) == [
        (2.0, "error: the mood rule cannot be decided: 1 / (live.mood - 4) > 0 ('/' by zero)")
    ]


def test_baseline_completes_without_events():
    fired = feedback("when: live.mood == 3 and mood.change == 0, baseline: 10 s")
    assert [at for at, _ in fired] == pytest.approx([10.0], abs=0.3)
