# SPDX-License-Identifier: Apache-2.0
"""What-if replays: equal without a change, and as computed by hand with a change."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import FeedbackKind, Update
from bt_agents_interfaces.msg import (
    AgentFiles,
    Auction,
    CallForBids,
    MarketStatus,
    Profiles,
    RefusedBid,
    Run,
)
from bt_agents_lab.cli.journal import journal
from bt_agents_lab.cli.what_if import what_if as command
from bt_agents_lab.replay.counterfactual_replay import Changes, CounterfactualResult, replay_with
from bt_agents_lab.replay.recording_index import NO_TEXTS, RecordingIndex
from bt_agents_language.files.folder_reader import read_trees
from checkout import ROOT
from journal_fixture import EPOCH, NAN, JournaledSystem, index_of, morning, write_folder
from marketplace_node.strategies import STRATEGIES, catalogue
from tree_harness import SPACE, scene


@pytest.fixture
def system(tmp_path: Path) -> JournaledSystem:
    """Return a system before its first round."""
    return JournaledSystem(tmp_path / "trees")


def result(journaled: JournaledSystem, path: Path, changes: Changes) -> CounterfactualResult:
    file = path / "a.mcap"
    file.unlink(missing_ok=True)
    return replay_with(index_of(journaled.write(file)), changes)


def winners(found: CounterfactualResult) -> list[str]:
    return [case.now for case in found.rounds]


@pytest.mark.parametrize("strategy", ["manhattan", "softmax", "ucb", "bounded_ucb", "thompson"])
def test_unchanged_replay_gives_the_same_results(tmp_path: Path, strategy: str) -> None:
    journaled = morning(tmp_path / "trees", strategy=strategy)
    found = result(journaled, tmp_path, Changes())
    assert found.other_winners == 0
    assert [case.margin_now for case in found.rounds] == [c.margin_was for c in found.rounds]
    assert found.profiles == journaled.profiles
    assert (found.given, found.withheld) == (4, 0)


@pytest.mark.parametrize("strategy", ["manhattan", "ucb", "bounded_ucb"])
def test_unchanged_replay_of_partial_journal_gives_same_results(
    tmp_path: Path, strategy: str
) -> None:
    journaled = JournaledSystem(tmp_path / "trees", strategy=strategy)
    journaled.profiles = dict.fromkeys(journaled.profiles, (2.0, 2.0, 3.0))
    for number in range(6):
        journaled.round(scene(f"s{number}", age=2.0 + number % 3))
    firsts = [
        n for n, one in enumerate(journaled.published) if isinstance(one.message, (Auction, Run))
    ]
    for missing in (firsts[:2], firsts[:6], firsts[4:6]):
        file = tmp_path / f"{len(missing)}-{missing[0]}.mcap"
        journaled.write(file, lambda n, m, gone=missing: None if n in gone else m)
        found = replay_with(index_of(file), Changes())
        assert [case.now for case in found.rounds] == [case.was for case in found.rounds]
        assert {case.now for case in found.rounds} == {"anna", "bert"}
        assert [c.margin_now for c in found.rounds] == [c.margin_was for c in found.rounds]


def test_other_learning_rate_changes_later_winner(system: JournaledSystem, tmp_path: Path) -> None:
    system.round(scene("s0", age=4.0))
    system.give_feedback("bert", FeedbackKind.DIRECT, (1.0, 2.1, 3.3))
    assert system.round(scene("s1", age=2.6)) == "bert"
    assert winners(result(system, tmp_path, Changes())) == ["bert", "bert"]
    assert winners(result(system, tmp_path, Changes(rate=0.0))) == ["bert", "anna"]


def test_feedback_about_another_agents_run_is_withheld(
    system: JournaledSystem, tmp_path: Path
) -> None:
    assert system.round(scene("s0", age=3.0, familiarity=1.6, mood=3.1)) == "bert"
    system.give_feedback("bert", FeedbackKind.DIRECT, (5.0, NAN, NAN))
    agents = read_trees(write_folder(tmp_path / "other", anna=(3.0, 1.6, 3.1), bert=(5, 5, 5)))
    found = result(system, tmp_path, Changes(agents=agents.agents))
    assert winners(found) == ["anna"]
    assert (found.given, found.withheld) == (0, 1)
    assert found.never == ("bert",)
    assert found.profiles["bert"] == (5.0, 5.0, 5.0)


def test_agents_of_another_folder_bid_by_their_files(tmp_path: Path) -> None:
    journaled = morning(tmp_path / "trees")
    folder = write_folder(tmp_path / "other", carla=(4.0, 2.0, 3.0), bert=(1.0, 2.0, 3.0))
    file = folder / "agents" / "bert.yaml"
    file.write_text(file.read_text() + "requires: scene.age < 2\n")
    found = result(journaled, tmp_path, Changes(agents=read_trees(folder).agents))
    assert winners(found) == ["carla", "bert", "carla", "carla"]
    assert found.bidders == {"carla", "bert"}


def _before(system: JournaledSystem, **fields: Any) -> None:
    system.publish("/bt_agents/market", MarketStatus(epoch=EPOCH, **fields))
    system.published.insert(0, system.published.pop())


def _first(system: JournaledSystem, kind: type) -> Any:
    return next(one.message for one in system.published if isinstance(one.message, kind))


LEFT_OUT: dict[str, Callable[[JournaledSystem], None]] = {
    "pinned": lambda system: _before(system, pinned="bert"),
    "vetoed": lambda system: _before(system, vetoed=["anna", "carla"]),
    "excluded": lambda system: _first(system, CallForBids).excluded.extend(["anna", "carla"]),
    "not awarded": lambda system: _first(system, Auction).refused.append(
        RefusedBid(agent="anna", kind=RefusedBid.REFUSED, code="NOT_AWARDED")
    ),
}


@pytest.mark.parametrize("why", LEFT_OUT)
def test_agents_excluded_from_round_stay_excluded(
    system: JournaledSystem, tmp_path: Path, why: str
) -> None:
    assert system.round(scene("s0", age=4.5, familiarity=2.1, mood=3.3)) == "bert"
    LEFT_OUT[why](system)
    nearer = (4.5, 2.1, 3.3)
    folder = write_folder(tmp_path / "other", anna=nearer, carla=nearer, bert=(4.0, 2.0, 3.0))
    agents = read_trees(folder).agents
    assert winners(result(system, tmp_path, Changes(agents=agents))) == ["bert"]


def test_substitute_that_ran_is_taught(system: JournaledSystem, tmp_path: Path) -> None:
    assert system.round(scene("s0", age=4.5)) == "bert"
    _first(system, Run).agent = "anna"
    system.give_feedback("anna", FeedbackKind.DIRECT, (5.0, NAN, NAN))
    found = result(system, tmp_path, Changes())
    assert (found.given, found.withheld) == (1, 0)
    assert found.profiles["anna"] == system.profiles["anna"]


def test_author_edits_in_between_count(system: JournaledSystem, tmp_path: Path) -> None:
    system.round(scene("s0", age=4.5))
    system.give_feedback("bert", FeedbackKind.DIRECT, (1.0, NAN, NAN))
    system.profiles["bert"] = (2.0, 2.0, 2.0)
    edited = Profiles(agents=["bert"], layers=[""], revisions=[2], vectors=[2.0, 2.0, 2.0])
    edited.parameters = list(SPACE.names)
    system.publish("/bt_agents/profiles", edited)
    found = result(system, tmp_path, Changes(rate=0.5))
    assert found.profiles["bert"] == (2.0, 2.0, 2.0)


def test_undo_reverts_hypothetical_learning(system: JournaledSystem, tmp_path: Path) -> None:
    system.round(scene("s0", age=4.5))
    system.give_feedback("bert", FeedbackKind.DIRECT, (3.5, NAN, NAN))
    kept = system.profiles["bert"]
    system.give_feedback("bert", FeedbackKind.DIRECT, (1.0, NAN, NAN))
    system.give_feedback("bert", FeedbackKind.SET, kept)
    undo = system.published[-1].message
    undo.learning_rate, undo.rates, undo.feedback_id = 0.0, [], ""
    assert result(system, tmp_path, Changes()).profiles["bert"] == kept
    assert result(system, tmp_path, Changes(rate=0.5)).profiles["bert"] == (4.0, 2.1, 3.3)


def test_a_robust_update_withstands_one_wrong_feedback(
    system: JournaledSystem, tmp_path: Path
) -> None:
    system.round(scene("s", age=4.0))
    for age in (4.5, 4.5, 4.5, 1.0):
        system.give_feedback("bert", FeedbackKind.DIRECT, (age, NAN, NAN))
    assert result(system, tmp_path, Changes()).profiles["bert"][0] < 4.0
    assert result(system, tmp_path, Changes(update=Update.MEDIAN)).profiles["bert"][0] == 4.5


def test_failing_strategy_is_a_problem_not_manhattan(
    system: JournaledSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = replace(STRATEGIES["manhattan"], name="broken", score=lambda *_: [])
    monkeypatch.setitem(catalogue._ALL, "broken", broken)
    system.round(scene("s0", age=4.0))
    [case] = result(system, tmp_path, Changes(strategy="broken")).rounds
    assert (case.now, case.problem) == ("", "strategy broken: it returns 0 scores for 2 bids")


def test_random_strategy_gives_reproducible_results(tmp_path: Path) -> None:
    journaled = morning(tmp_path / "trees")
    changes = Changes(strategy="softmax", options={"temperature": 5.0})
    first, second = (result(journaled, tmp_path, changes) for _ in range(2))
    assert winners(first) == winners(second)
    assert len(set(winners(first))) == 2


@pytest.mark.parametrize(
    ("strategy", "options", "text"),
    [
        ("softmaxx", {}, "no strategy 'softmaxx'; did you mean"),
        ("softmax", {"temprature": 1.0}, "no option 'temprature'; did you mean"),
        ("softmax", {"temperature": -1.0}, "option 'temperature' is -1, expected"),
        ("", {"temperature": 1.0}, "name it with --strategy"),
        ("external", {}, "unknown"),
    ],
)
def test_invalid_changes_are_rejected_with_reason(
    strategy: str, options: Mapping[str, float], text: str
) -> None:
    with pytest.raises(BtAgentsError, match=text):
        replay_with(RecordingIndex(), Changes(strategy=strategy, options=options))


def test_command_prints_changed_winners_and_its_assumptions(tmp_path: Path) -> None:
    path = morning(tmp_path / "trees").write(tmp_path / "a.mcap")
    folder = write_folder(tmp_path / "other", anna=(1.0, 1.0, 3.0))
    result = CliRunner().invoke(command, [str(path), "--agents", str(folder)])
    assert result.exit_code == 0, result.output
    assert "3 of 4 rounds would have had another winner" in result.output
    assert "The chosen agent runs" in result.output
    told = CliRunner().invoke(command, [str(path), "--agents", str(folder), "--json"])
    data = json.loads(told.output)
    assert data["chosen"] == {"anna": 4}
    assert [one["now"] for one in data["rounds"]] == ["anna"] * 4


def test_agents_with_other_parameters_are_refused(tmp_path: Path) -> None:
    path = morning(tmp_path / "trees").write(tmp_path / "a.mcap")
    result = CliRunner().invoke(command, [str(path), "--agents", str(ROOT / "experiments" / "3")])
    assert "have age, familiarity, mood in the recording, and age, profession, emotion" in str(
        result.exception
    )


def test_only_agents_with_given_tags_bid(tmp_path: Path) -> None:
    path = morning(tmp_path / "trees").write(tmp_path / "a.mcap")
    folder = write_folder(tmp_path / "other", anna=(1.0, 1.0, 3.0), bert=(4.5, 2.1, 3.3))
    file = folder / "agents" / "bert.yaml"
    file.write_text(file.read_text() + "tags: [night]\n")
    (folder / "agents" / "carl.yaml").write_text("agent: [")
    ask = [str(path), "--agents", str(folder)]
    told = CliRunner().invoke(command, [*ask, "--tags", "night"])
    assert told.exit_code == 0, told.output
    assert "bert 4" in told.output
    assert "carl.yaml" in told.output
    assert "--tags leaves it out" not in told.output
    told = CliRunner().invoke(command, ask)
    assert "anna 1" in told.output
    assert "--tags leaves it out" in told.output
    told = CliRunner().invoke(command, [str(path), "--tags", "night"])
    assert "name their folder with --agents" in str(told.exception)


def test_unlabelled_scene_is_shown_by_its_values(system: JournaledSystem, tmp_path: Path) -> None:
    system.round(replace(scene("0b5f", age=4.5, familiarity=1.0, mood=3.0), label=""))
    system.round(replace(scene("0b60", age=4.5), label="", person=False))
    found = result(system, tmp_path, Changes())
    labels = [case.label for case in found.rounds]
    assert labels == ["age 4.5, familiarity 1, mood 3", "nobody, age 4.5"]
    shown = CliRunner().invoke(journal, [str(tmp_path / "a.mcap")])
    assert "age 4.5, familiarity 1, mood 3: bert wins" in shown.output


@pytest.mark.parametrize("text", ["temperature=", "=1", "temperature=nan"])
def test_non_numeric_option_is_rejected(tmp_path: Path, text: str) -> None:
    result = CliRunner().invoke(command, ["--strategy", "softmax", text])
    assert result.exit_code == 2
    assert "not of the form name=number" in result.output


def test_csv_has_the_problem_apart_from_the_winner(
    system: JournaledSystem, tmp_path: Path
) -> None:
    system.round(scene("s1", age=4.0))
    path = system.write(tmp_path / "a.mcap", lambda n, m: None if isinstance(m, AgentFiles) else m)
    [row] = csv.DictReader(CliRunner().invoke(command, [str(path), "--csv"]).output.splitlines())
    assert (row["epoch"], row["was"], row["now"]) == (EPOCH, "bert", "")
    assert row["problem"] == NO_TEXTS
