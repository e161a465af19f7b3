# SPDX-License-Identifier: Apache-2.0
"""Laws of rehearsals: test files cause at most a diagnostic, and runs are repeatable."""

from __future__ import annotations

import math
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents_core.errors import ReadError
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.testing.scenarios import Scenario, ScriptedEvent
from bt_agents_language.reference.codes import codes
from bt_agents_tools.rehearsal.rehearsal import rehearse
from bt_agents_tools.rehearsal.suite import failure, run_case
from file_texts import read_test_text
from tree_harness import SPACE, SYMBOLS, TREES

AGENTS = read_trees(TREES).agents
GUIDE = next(agent for agent in AGENTS if agent.name == "attentive_guide")
TEXT = Path(TREES / "agents" / "attentive_guide.test.yaml").read_text()
PIECES = st.sampled_from(
    ["", "{", "}", "[", "]", "- ", ": ", "\n", "  ", "'", "${x}", "null", "1e999", "-3", "5 s",
     "**", "tree/0", "yes", "&a", "*a", "!!x", "contains", "gives", "after", "at", "mood", "{}"]
)  # fmt: skip
CHANGES = st.lists(
    st.tuples(st.integers(0, len(TEXT) - 1), st.integers(0, 12), PIECES), min_size=1, max_size=4
)
MOODS = st.lists(st.tuples(st.floats(0.0, 60.0), st.floats(1.0, 5.0)), max_size=4)


@settings(max_examples=200, derandomize=True, deadline=None)
@given(CHANGES)
def test_mutated_test_file_runs_or_reports_named_code(changes: list[tuple[int, int, str]]) -> None:
    text = TEXT
    for start, length, piece in changes:
        text = text[:start] + piece + text[start + length :]
    try:
        test = read_test_text(text, "a.test.yaml", AGENTS, SYMBOLS)
    except ReadError as error:
        found = [code for code in codes() if f"[{code}]" in error.lines[0]]
        assert len(found) == 1
        return
    for case in test.cases:
        assert failure(run_case(test.agent, SPACE, case))


@settings(max_examples=50, derandomize=True, deadline=None)
@given(MOODS, st.integers(0, 3))
def test_rehearsal_is_deterministic_and_time_is_monotonic(
    moods: list[tuple[float, float]], seed: int
) -> None:
    during = tuple(ScriptedEvent(after_s=at, values={"mood": mood}) for at, mood in moods)
    scenario = Scenario(scene={"age": 4, "mood": 3}, seed=seed, during=during)
    first = rehearse(GUIDE, SPACE, scenario)
    assert first.events == rehearse(GUIDE, SPACE, scenario).events
    times = [event.at_s for event in first.events]
    assert times == sorted(times)
    assert math.isfinite(first.duration_s)
    assert first.outcome is not None
