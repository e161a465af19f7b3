# SPDX-License-Identifier: Apache-2.0
"""Replay: equal results are equal, altered ones differ, missing ones are named."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from bt_agents_core.feedback import FeedbackKind
from bt_agents_interfaces.msg import AgentFiles, Auction, CallForBids, Feedback, HostCard, Run
from bt_agents_lab.cli.replay import replay
from bt_agents_lab.replay import decisions, replay_learning
from bt_agents_lab.replay.decisions import replay_decisions
from bt_agents_lab.replay.findings import FindingCounts, ReplayVerdict
from bt_agents_lab.replay.replay_learning import ProfileHistory, replay_feedback, rule_of
from bt_agents_language.files.learning_reader import MAX_WINDOW
from journal_fixture import JournaledSystem, index_of, morning
from tree_harness import SPACE, scene


def again(path: Path) -> FindingCounts:
    recording = index_of(path)
    assert recording.problems == []
    return FindingCounts(
        [*replay_decisions(recording.rounds), *replay_feedback(recording.feedbacks)]
    )


def first(journaled: JournaledSystem, kind: type) -> int:
    """Return the number of the first message of a kind."""
    return next(n for n, one in enumerate(journaled.published) if isinstance(one.message, kind))


def altered(
    journaled: JournaledSystem, folder: Path, kind: type, change: Callable[[Any], object]
) -> Path:
    """Write a journal with a change of the first message of a kind."""
    number = first(journaled, kind)
    changed = copy.deepcopy(journaled.published[number].message)
    change(changed)
    return journaled.write(folder / "a.mcap", lambda n, m: changed if n == number else m)


@pytest.mark.parametrize(
    ("strategy", "options"),
    [("manhattan", {}), ("softmax", {"temperature": 2.0}), ("bounded_ucb", {"c": 0.4})],
)
def test_whole_morning_replays_equal(
    tmp_path: Path, strategy: str, options: dict[str, float]
) -> None:
    made = morning(tmp_path / "trees", strategy=strategy, options=options)
    found = again(made.write(tmp_path / "a.mcap"))
    assert found.unequal == []
    for kind in (decisions.KIND, replay_learning.KIND):
        assert found.counts[kind, ReplayVerdict.EQUAL] == 4


def _nudge(message: Any, field: str) -> None:
    value = getattr(message, field)
    setattr(message, field, value + 1e-15 * max(1.0, abs(value)))


def _nudge_first(values: Any) -> None:
    values[0] += 4e-16 * max(1.0, abs(values[0]))


AUCTIONS: dict[str, Callable[[Any], object]] = {
    "winner": lambda m: setattr(m, "winner", "bert" if m.winner == "anna" else "anna"),
    "margin": lambda m: _nudge(m, "margin"),
    "order": lambda m: m.ranking.reverse(),
    "score": lambda m: _nudge(m.ranking[0], "score"),
    "distance": lambda m: _nudge(m.ranking[0], "distance"),
    "bonus": lambda m: _nudge(m.ranking[0], "bonus"),
    "bid": lambda m: _nudge_first(m.ranking[0].vector),
    "contribution": lambda m: _nudge_first(m.ranking[0].contributions),
    "scene": lambda m: setattr(m.scene.values[0], "value", 3.9),
    "strategy": lambda m: setattr(m, "strategy", "euclidean"),
    "change of the scene": lambda m: m.change_values.__setitem__(0, 1.0),
    "shadow": lambda m: setattr(m, "shadow_winner", "anna"),
    "outcome": lambda m: setattr(m, "outcome", Auction.NO_BIDS),
    "winner's id": lambda m: setattr(m, "winner_id", 77),
    "winner's host": lambda m: setattr(m, "host", "/other"),
    "sum": lambda m: setattr(m.ranking[0], "calculation", "0 = |1−1|"),
    "reason": lambda m: setattr(m, "reason", "as I like it"),
    "explanation": lambda m: setattr(m, "explanation", m.explanation + "\nSo it was."),
}


LESSONS: dict[str, Callable[[Any], object]] = {
    "after": lambda m: _nudge_first(m.after),
    "before": lambda m: _nudge_first(m.before),
    "target": lambda m: m.target.__setitem__(0, 4.5),
    "rate": lambda m: _nudge(m, "learning_rate"),
    "weight": lambda m: setattr(m, "weight", 0.5),
    "kind": lambda m: setattr(m, "kind", int(FeedbackKind.NEGATIVE)),
}


@pytest.mark.parametrize(
    ("message", "change", "kind", "where"),
    [
        *((Auction, one, decisions.KIND, "round 1 ") for one in AUCTIONS.values()),
        *((Feedback, one, replay_learning.KIND, "revision 1 of bert") for one in LESSONS.values()),
    ],
    ids=[*AUCTIONS, *LESSONS],
)
def test_alteration_is_detected(
    journaled: JournaledSystem,
    tmp_path: Path,
    message: type,
    change: Callable[[Any], object],
    kind: str,
    where: str,
) -> None:
    found = again(altered(journaled, tmp_path, message, change))
    [finding] = [one for one in found.unequal if one.kind == kind]
    assert finding.verdict is ReplayVerdict.DIFFERENT
    assert finding.where.startswith(where)
    assert found.counts[kind, ReplayVerdict.EQUAL] == 3


@pytest.mark.parametrize(
    ("kind", "decided"),
    [(AgentFiles, ReplayVerdict.NOT_RECORDED), (HostCard, ReplayVerdict.EQUAL)],
)
def test_missing_texts_or_cards_are_no_difference(
    journaled: JournaledSystem, tmp_path: Path, kind: type, decided: ReplayVerdict
) -> None:
    path = tmp_path / "a.mcap"
    found = again(journaled.write(path, lambda _, one: None if isinstance(one, kind) else one))
    assert found.counts == {
        (decisions.KIND, decided): 4,
        (replay_learning.KIND, ReplayVerdict.NOT_RECORDED): 4,
    }


def test_score_without_earlier_runs_is_not_different(tmp_path: Path) -> None:
    made = morning(tmp_path / "trees", strategy="ucb", options={"c": 3.0})
    gone = first(made, Auction)
    found = again(made.write(tmp_path / "a.mcap", lambda n, m: None if n == gone else m))
    assert found.different == 0
    told = [one for one in found.unequal if one.kind == decisions.KIND]
    assert told
    assert all("does not begin with this market" in one.text for one in told)
    _, second, *_ = [n for n, one in enumerate(made.published) if isinstance(one.message, Run)]
    found = again(made.write(tmp_path / "b.mcap", lambda n, m: None if n == second else m))
    assert found.counts[decisions.KIND, ReplayVerdict.EQUAL] == 2
    assert found.counts[decisions.KIND, ReplayVerdict.NOT_RECORDED] == 2
    assert found.different == 0


def test_run_stopped_at_its_start_counts(tmp_path: Path) -> None:
    made = morning(tmp_path / "trees", strategy="ucb", options={"c": 3.0})
    run = made.published[first(made, Run)].message
    run.event, run.outcome, run.stop_cause = Run.ENDED, Run.CANCELLED, Run.BY_MARKET
    found = again(made.write(tmp_path / "a.mcap"))
    assert [one for one in found.unequal if one.kind == decisions.KIND] == []


def test_explanation_of_excluded_agents_is_not_compared(tmp_path: Path) -> None:
    made = morning(tmp_path / "trees")
    made.published[first(made, CallForBids)].message.excluded = ["carl"]
    auction = made.published[first(made, Auction)].message
    auction.explanation += "\ncarl may not bid again: it was stopped."
    assert again(made.write(tmp_path / "a.mcap")).unequal == []


def test_shadow_based_on_earlier_runs_is_not_different(tmp_path: Path) -> None:
    made = JournaledSystem(tmp_path / "trees", shadow="ucb")
    for number in range(4):
        made.round(scene(f"s{number}", age=1.0))
    assert again(made.write(tmp_path / "a.mcap")).unequal == []
    gone = first(made, Auction)
    found = again(made.write(tmp_path / "b.mcap", lambda n, m: None if n == gone else m))
    assert found.counts == {(decisions.KIND, ReplayVerdict.NOT_RECORDED): 3}

    def worse(number: int, message: Any) -> Any:
        if number == gone:
            return None
        if isinstance(message, Auction):
            message = copy.deepcopy(message)
            message.winner = "bert"
        return message

    found = again(made.write(tmp_path / "c.mcap", worse))
    assert found.different == 3


def test_command_shows_first_differences(journaled: JournaledSystem, tmp_path: Path) -> None:
    path = altered(journaled, tmp_path, Auction, lambda m: setattr(m, "margin", 9.0))
    result = CliRunner().invoke(replay, [str(path)])
    assert result.exit_code == 1
    where = "different decision, round 1 (age 4, familiarity 2, mood 3), bert"
    assert f"{where}: the margin was 9.0" in result.output
    assert "not equal" in result.output


def test_non_journal_file_is_rejected_with_reason(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    for content in (b"", b"no journal", b"\x89MCAP0\r\n" + bytes(200)):
        path.write_bytes(content)
        result = CliRunner().invoke(replay, [str(path)])
        assert result.exit_code == 1
        assert "nothing can be read of the journal" in str(result.exception)
    missing = CliRunner().invoke(replay, [str(tmp_path / "b.mcap")])
    assert re.search(r"no journal .*b\.mcap: No such file", str(missing.exception))


def test_history_keeps_only_what_medians_need(tmp_path: Path) -> None:
    journaled = JournaledSystem(tmp_path / "trees")
    anna = journaled.round(scene("s1", age=1.0))
    for _ in range(MAX_WINDOW + 2):
        journaled.give_feedback(anna, FeedbackKind.DIRECT, (3.0, 2.0, 3.0))
    history, sizes = ProfileHistory(), []
    for one in index_of(journaled.write(tmp_path / "a.mcap")).feedbacks:
        before = history.before(one.feedback, one.card.profile)
        rule = rule_of(one.card, one.parameters)
        sizes.append(len(history.add(one.feedback, before, SPACE, rule).recent))
    assert sizes[0] == 1
    assert sizes[-3:] == [MAX_WINDOW] * 3
