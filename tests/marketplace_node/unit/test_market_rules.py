# SPDX-License-Identifier: Apache-2.0
"""Rules of ``market.yaml`` and rankings from outside: who comes before nearer bids."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bt_agents_language.files.market_reader import MarketRule, market_of, read_market
from bt_agents_language.yaml.source import Source
from market_harness import SPACE, scene
from marketplace_node.round.decision import External, Ranked
from marketplace_node.round.ranking import decide
from ranked_rounds import bids, terms

PROFILES = {"ann": (3.0, 3.0, 3.0), "bob": (4.0, 3.0, 3.0), "cat": (5.0, 5.0, 5.0)}


def rules(*lines: str) -> tuple[MarketRule, ...]:
    text = "format: 1\nrules:\n" + "".join(f"  - {line}\n" for line in lines)
    return read_market(Source("market.yaml", text), SPACE)


def ranked(*lines: str, values: tuple[float, ...] = (3.0, 3.0, 3.0)) -> Ranked:
    of = terms(scene("s", *values), strategy="rules", rules=rules(*lines))
    return decide(SPACE, of, bids(PROFILES))


def names(found: Ranked) -> list[str]:
    return [bid.agent for bid in found.bids]


def test_the_first_rule_that_holds_says_who_wins_and_the_rest_go_by_distance() -> None:
    found = ranked(
        "{when: scene.age > 4, agents: [bob]}",
        "{when: scene.age <= 4, agents: [cat]}",
        "{when: scene.age <= 4, agents: [bob]}",
    )

    assert names(found) == ["cat", "ann", "bob"]
    assert found.precedence == "rule 2: scene.age <= 4"
    assert found.bids[0].score == -1.0
    assert found.bids[0].distance == 6.0
    assert found.bids[0].bonus == 0.0, "a place is no exploration"


def test_agents_of_a_rule_come_in_its_order_and_those_that_do_not_bid_are_passed_over() -> None:
    found = ranked("{when: scene.person, agents: [zoe, cat, bob]}")

    assert names(found) == ["cat", "bob", "ann"]
    assert found.placed == 2


@pytest.mark.parametrize(
    "line",
    [
        "{when: scene.age > 4, agents: [cat]}",
        "{when: scene.age < 9, agents: [zoe]}",
        "{when: scene.mood < 9, agents: [cat]}",
        "{when: 1 / (scene.age - 3) > 0, agents: [cat]}",
    ],
)
def test_without_a_rule_that_holds_the_nearest_wins(line: str) -> None:
    found = ranked(line, values=(3.0, 3.0, math.nan))

    assert names(found) == ["ann", "bob", "cat"]
    assert (found.precedence, found.placed) == ("", 0)


def test_a_folder_without_a_market_file_has_no_rules(tmp_path: Path) -> None:
    assert market_of(tmp_path, SPACE) == ()


def external(answer: External | None) -> Ranked:
    return decide(
        SPACE,
        terms(scene("s", 3.0, 3.0, 3.0), strategy="external"),
        bids(PROFILES),
        external=answer,
    )


def test_a_ranking_from_outside_comes_before_what_it_does_not_name() -> None:
    found = external(External(ranking=("cat",), message="in a hurry"))

    assert names(found) == ["cat", "ann", "bob"]
    assert (found.by, found.precedence, found.fallback) == ("external", "in a hurry", "")


@pytest.mark.parametrize("answer", [None, External(failure="it is late"), External()])
def test_without_an_answer_from_outside_the_nearest_wins(answer: External | None) -> None:
    found = external(answer)

    assert names(found) == ["ann", "bob", "cat"]
    assert found.fallback == (answer.failure if answer else "")
    assert found.by == ("manhattan" if found.fallback else "external")
