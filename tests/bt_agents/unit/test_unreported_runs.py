# SPDX-License-Identifier: Apache-2.0
"""Unreported runs: they wait for the next market, which learns of each once."""

from __future__ import annotations

import pytest

from bt_agents.host.market_registration import UnreportedRuns
from bt_agents_interfaces.msg import Run
from bt_agents_ros.limits import MOST_UNREPORTED


@pytest.fixture
def runs() -> UnreportedRuns:
    return UnreportedRuns()


def ended(number: int, epoch: str = "e1", event: int = Run.ENDED, agent: str = "guide") -> Run:
    return Run(epoch=epoch, round=number, agent=agent, event=event, outcome=Run.CANCELLED)


def rounds(runs: list[Run]) -> list[int]:
    return [run.round for run in runs]


def test_run_is_reported_to_other_markets_until_acknowledged(runs: UnreportedRuns) -> None:
    runs.store(ended(1))
    assert runs.of_others("e1") == []
    assert rounds(runs.of_others("e2")) == [1]
    runs.acknowledge(runs.of_others("e2"))
    runs.store(ended(1))
    assert runs.of_others("e3") == []


@pytest.mark.parametrize(
    ("news", "left"),
    [(ended(1), [2]), (ended(1, event=Run.REFUSED), [2]), (ended(1, epoch="e0"), [1, 2])],
)
def test_run_closed_by_its_market_is_forgotten(
    runs: UnreportedRuns, news: Run, left: list[int]
) -> None:
    runs.store(ended(1))
    runs.store(ended(2))
    runs.on_run_event(news)
    assert rounds(runs.of_others("e2")) == left


@pytest.mark.parametrize(
    ("news", "kept"),
    [
        (ended(1), []),
        (ended(1, event=Run.REFUSED, agent="talker"), [1]),
        (ended(1, event=Run.STARTED), [1]),
        (ended(1, event=Run.CANCELLING), [1]),
    ],
)
def test_run_closed_before_its_end_is_not_kept(
    runs: UnreportedRuns, news: Run, kept: list[int]
) -> None:
    runs.on_run_event(news)
    runs.store(ended(1))
    assert rounds(runs.of_others("e2")) == kept


@pytest.mark.parametrize("news_first", [True, False])
@pytest.mark.parametrize(
    ("cause", "told"),
    [
        (Run.BY_MARKET, (Run.MOOD_RULE, "she frowns")),
        (Run.MARKET_LOST, (Run.NOT_SAID, "")),
        (Run.BY_HOST, (Run.NOT_SAID, "")),
    ],
)
def test_run_names_who_made_its_market_stop_it(
    runs: UnreportedRuns, cause: int, told: tuple[int, str], news_first: bool
) -> None:
    run = ended(1)
    run.stop_cause = cause
    news = ended(1, event=Run.CANCELLING)
    news.stopped_by, news.stop_reason = Run.MOOD_RULE, "she\nfrowns"
    other = ended(2, event=Run.CANCELLING)
    other.stopped_by = Run.OPERATOR
    steps = [(runs.on_run_event, news), (runs.on_run_event, other), (runs.store, run)]
    for step, told_run in steps if news_first else reversed(steps):
        step(told_run)
    (kept,) = runs.of_others("e2")
    assert (kept.stopped_by, kept.stop_reason) == told


def test_only_the_latest_runs_are_kept(runs: UnreportedRuns) -> None:
    for number in range(MOST_UNREPORTED + 3):
        runs.store(ended(number))
    assert rounds(runs.of_others("e2")) == list(range(3, MOST_UNREPORTED + 3))
