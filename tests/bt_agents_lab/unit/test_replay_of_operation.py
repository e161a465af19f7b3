# SPDX-License-Identifier: Apache-2.0
"""Ten minutes of a system that is operated at random, and restarted, replay equal."""

from __future__ import annotations

import os
from typing import Any

import pytest

from bt_agents_lab.recorder.daily_recorder import newest_files
from bt_agents_lab.replay import decisions, replay_learning
from bt_agents_lab.replay.counterfactual_replay import Changes, replay_with
from bt_agents_lab.replay.decisions import replay_decisions
from bt_agents_lab.replay.findings import FindingCounts, ReplayVerdict
from bt_agents_lab.replay.recording_index import read
from bt_agents_lab.replay.replay_learning import replay_feedback
from operated_system import OperatedSystem

LASTS_S = 600.0
SEEDS = range(1, 1 + int(os.environ.get("BT_AGENTS_OPERATORS", "2")))
"""One seed an operator; a longer search sets the environment variable to more of them."""


@pytest.fixture(scope="module", params=SEEDS)
def system(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    operated = OperatedSystem(tmp_path_factory.mktemp("operated"), request.param)
    operated.run_for(LASTS_S)
    return operated


def test_random_operation_replays_equal(system: OperatedSystem) -> None:
    recording = read(newest_files(system.journal_folder))
    found = FindingCounts(
        [*replay_decisions(recording.rounds), *replay_feedback(recording.feedbacks)]
    )
    assert [f"{one.where}: {one.text}" for one in found.unequal] == []
    assert recording.whole
    for kind in (decisions.KIND, replay_learning.KIND):
        assert found.counts[kind, ReplayVerdict.EQUAL] > 50

    outlook = replay_with(recording, Changes())
    assert [one for one in outlook.rounds if one.problem or one.was != one.now] == []
    assert outlook.withheld == 0
    assert system.profiles.items() <= outlook.profiles.items()


def test_operator_uses_every_operation(system: OperatedSystem) -> None:
    parts = ("host", "market", "feedback", "scene layer", "journal")
    learning = ("UNDO", "RESET", "IMPORT", "FORGET", "mood rule stops")
    files = ("edit skills", "edit broken", "edit library", "edit profile")
    market = ("PIN", "VETO", "AWARD", "configure", "tune", "preset", "cancel")
    expected = {*(f"restart of {part}" for part in parts), *learning, *files, *market}
    assert expected - set(system.done) == set()
