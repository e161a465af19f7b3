# SPDX-License-Identifier: Apache-2.0
"""Precedence by ``market.yaml`` and external rankings over nearer bids."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bt_agents_language.files.market_reader import MarketRule, market_of, read_market
from bt_agents_language.yaml.source import Source
from market_harness import EXPRESS, SPACE, MarketHarness, scene
from marketplace_node.effects import Alarm
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


def test_first_matching_rule_ranks_before_distance() -> None:
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


def test_rule_orders_its_agents_and_skips_non_bidders() -> None:
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
def test_nearest_wins_without_matching_rule(line: str) -> None:
    found = ranked(line, values=(3.0, 3.0, math.nan))

    assert names(found) == ["ann", "bob", "cat"]
    assert (found.precedence, found.placed) == ("", 0)


def test_folder_without_market_file_has_no_rules(tmp_path: Path) -> None:
    assert market_of(tmp_path, SPACE) == ()


def external(answer: External | None) -> Ranked:
    return decide(
        SPACE,
        terms(scene("s", 3.0, 3.0, 3.0), strategy="external"),
        bids(PROFILES),
        external=answer,
    )


def test_external_ranking_precedes_unnamed_agents() -> None:
    found = external(External(ranking=("cat",), message="in a hurry"))

    assert names(found) == ["cat", "ann", "bob"]
    assert (found.by, found.precedence, found.fallback) == ("external", "in a hurry", "")


@pytest.mark.parametrize("answer", [None, External(failure="it is late"), External()])
def test_nearest_wins_without_external_answer(answer: External | None) -> None:
    found = external(answer)

    assert names(found) == ["ann", "bob", "cat"]
    assert found.fallback == (answer.failure if answer else "")
    assert found.by == ("manhattan" if found.fallback else "external")


TORN = "{when: 1 / (scene.age - 3) > 0, agents: [cat]}"
UNDECIDED = "market.yaml:4:12: rule 2 cannot be decided: 1 / (scene.age - 3) > 0 ('/' by zero)"


@pytest.mark.parametrize("shadow", [False, True])
def test_undecidable_rule_is_reported_with_position(shadow: bool) -> None:
    lines = ("{when: scene.age > 4, agents: [bob]}", TORN, "{when: scene.person, agents: [bob]}")
    strategies = {"strategy": "euclidean", "shadow": "rules"} if shadow else {"strategy": "rules"}
    of = terms(scene("s", 3.0, 3.0, 3.0), rules=rules(*lines), **strategies)
    found = decide(SPACE, of, bids(PROFILES))

    [problem] = found.undecided
    assert (problem.file, problem.line, problem.message) == ("market.yaml", 4, UNDECIDED)


def test_rules_after_first_match_are_not_evaluated() -> None:
    assert ranked("{when: scene.person, agents: [bob]}", TORN).undecided == ()


def test_status_lists_undecidable_rules_of_last_evaluation() -> None:
    line = f"{{when: 1 / (scene.age - 3) > 0, agents: [{EXPRESS}]}}"
    market = MarketHarness(rules(line), strategy="rules")
    market.register()
    market.scene("s1", 3.0, 3.0, 3.0)
    market.bid()
    assert [one.message for one in market.status.undecided] == [
        UNDECIDED.replace("4:12", "3:12").replace("rule 2", "rule 1")
    ]
    assert [one.message for one in market.all(Alarm)] == [market.status.undecided[0].message]
    market.perform()
    assert market.status.undecided, "nothing has been looked at since"
    market.scene("s2", 3.0, 3.0, 3.0)
    market.bid()
    assert len(market.all(Alarm)) == 1, "it is logged once"
    market.perform()
    market.scene("s3", 4.0, 3.0, 3.0)
    market.bid()
    assert market.status.undecided == ()
