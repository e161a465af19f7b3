# SPDX-License-Identifier: Apache-2.0
"""Counterfactuals of rounds that are easy to compute by hand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import pytest

from bt_agents_core.scene import Vector
from bt_agents_language.files.market_reader import read_market
from bt_agents_language.yaml.source import Source
from market_harness import SPACE, MarketHarness, scene
from marketplace_node.effects import PublishAuction, SendGoal
from marketplace_node.round import ranking
from marketplace_node.round.decision import Counterfactual, External, Ranked
from marketplace_node.round.ranking import RoundModel, decide
from marketplace_node.strategies import Score
from ranked_rounds import bids, decided, terms
from ranking import case

NAN = math.nan


def change(values: Vector, *vectors: Vector, **changes: object) -> Counterfactual:
    external = changes.pop("external", None)
    of = terms(scene("s", *values), **changes)
    found = decided(of, bids(dict(zip("abcd", vectors, strict=False))), external=external)
    assert found.ranked.change is not None
    return found.ranked.change


TWO = ((4.0, 1.0, 3.0), (2.0, 2.0, 3.0))
BETWEEN = ((5.0, 3.0, 3.0), (1.0, 3.0, 3.0), (2.0, 3.0, 4.5))


@pytest.mark.parametrize(
    ("vectors", "last_run", "age"),
    [(TWO, {"a": 1}, 2.5), (TWO, {"b": 1}, 2.45), (BETWEEN, {}, 2.95)],
    ids=["a tie wins", "a tie loses", "it also beats the bid in between"],
)
def test_parameter_requiring_smallest_change_is_named(
    vectors: tuple[Vector, ...], last_run: dict[str, int], age: float
) -> None:
    found = change(vectors[0], *vectors, last_run=last_run)

    assert (found.names, found.values) == (("age",), (age,))


@pytest.mark.parametrize(
    ("values", "changes", "words"),
    [
        ((NAN, NAN, NAN), {}, "no value of the scene is known"),
        ((3.0, 3.0, 3.0), {}, ""),
        ((3.0, 3.0, 3.0), {"strategy": "epsilon_greedy", "options": {"epsilon": 1.0}}, ""),
        ((3.0, 3.0, 3.0), {"strategy": "external", "external": External(ranking=("a",))},
         "only the external program can rank another scene"),
    ],
)  # fmt: skip
def test_missing_change_states_reason(
    values: Vector, changes: dict[str, object], words: str
) -> None:
    found = change(values, (2.0, 2.0, 2.0), (2.0, 2.0, 2.0), **changes)

    assert (found.names, found.obstacle) == ((), words)


@pytest.mark.parametrize("error", [IndexError("5"), FloatingPointError(), AssertionError()])
def test_failed_search_is_only_an_obstacle(error: Exception) -> None:
    def fail() -> Counterfactual:
        raise error

    found = Ranked(find_change=fail).change
    assert found is not None
    assert found.obstacle == f"the search for it failed ({type(error).__name__})"


def test_a_rule_is_decided_anew_for_each_value() -> None:
    text = "format: 1\nrules:\n  - when: scene.age <= 2\n    agents: [b]\n"
    rules = read_market(Source("market.yaml", text), SPACE)
    found = change(
        (4.0, 1.0, 3.0), (4.0, 1.0, 3.0), (4.0, 5.0, 5.0), strategy="rules", rules=rules
    )

    assert (found.names, found.values) == (("age",), (2.0,))


@pytest.mark.parametrize(("agents", "width"), [(110, 32), (1000, 3), (5000, 3)])
def test_the_search_compares_so_much_and_no_more(
    agents: int, width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = case(agents, width)
    ranked = decide(of.space, of.terms, of.bids)
    compared: list[int] = []

    def counted(model: RoundModel, scores: Sequence[Score], tries: Sequence[Any]) -> Iterable[int]:
        compared.append(len(tries) * len(model.given.bids) * len(model.given.scene))
        return found_winners(model, scores, tries)

    found_winners = ranking._winners
    monkeypatch.setattr(ranking, "_winners", counted)
    found = ranked.change
    assert found is not None

    assert sum(compared) <= ranking.MOST_NUMBERS + width * agents * width
    assert not (found.names and found.obstacle)
    assert bool(compared) == (found.obstacle != "there are too many bids to search for it")
    assert bool(compared) == (agents == 1000)


def test_search_runs_only_on_request(market: MarketHarness) -> None:
    market.award()
    kinds = [type(effect) for effect in market.effects]

    assert kinds.index(SendGoal) < kinds.index(PublishAuction), "words delay no winner"
    assert "change" not in vars(market.auction.decision.ranked)
    assert "would have won" in market.auction.explanation
    assert "change" in vars(market.auction.decision.ranked)


def test_a_single_bid_has_no_runner_up() -> None:
    assert decided(terms(), bids({"a": (4.0, 1.0, 3.0)})).ranked.change is None
