# SPDX-License-Identifier: Apache-2.0
"""One round: accepted and refused bids, and their order by strategy, rules and rankings."""

from __future__ import annotations

import math
from array import array
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Vector
from bt_agents_language.files.market_reader import MarketRule, market_of, read_market
from bt_agents_language.yaml.source import Source
from market_harness import EXPRESS, GUIDE, SPACE, MarketHarness, scene
from marketplace_node.effects import Alarm
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.auction import Auction
from marketplace_node.round.decision import Bids, ClosedBy, Decision, External, Ranked, RoundKind
from marketplace_node.round.ranking import decide
from ranked_rounds import bids, terms

FINE, EXPRESS_VECTOR = (4.0, 1.5, 3.0), (3.0, 5.0, 3.5)
UNANSWERED = (GUIDE, "NO_ANSWER")
TOKEN = b"token of a start"


HOST = HostEntry(
    host="/agents",
    instance="first",
    run_action="/agents/run",
    heartbeat="/agents/heartbeat",
    agents={GUIDE: 1, EXPRESS: 2},
    token=TOKEN,
)


def auction(*answers: Bids, host: HostEntry = HOST, **changes: Any) -> Auction:
    """Return a round with some answers."""
    opened = Auction(SPACE, terms(**changes), [host])
    for one in answers:
        opened.take(one)
    return opened


def close(opened: Auction) -> Decision:
    return opened.close(ClosedBy.DEADLINE, 0.5)


def answer(**changes: Any) -> Bids:
    values: dict[str, Any] = {
        "epoch": "epoch",
        "round": 4,
        "host": "/agents",
        "instance": "first",
        "agents": (GUIDE, EXPRESS),
        "agent_ids": (1, 2),
        "vectors": (*FINE, *EXPRESS_VECTOR),
        "token": TOKEN,
    }
    return Bids(**(values | changes))


def refusals(decision: Decision) -> list[tuple[str, str]]:
    return [(bid.agent, bid.code) for bid in decision.refused]


def test_the_closest_bid_wins_with_its_margin() -> None:
    opened = auction(answer())
    decision = close(opened)

    assert opened.complete
    assert decision.outcome is AuctionOutcome.AWARDED
    assert decision.winner is not None
    distances = [(bid.agent, bid.distance) for bid in decision.ranking]
    assert (distances, decision.margin) == ([(GUIDE, 1.5), (EXPRESS, 6.5)], 5.0)
    assert not decision.refused


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"epoch": "another"}, "FOREIGN_EPOCH"),
        ({"round": 5}, "FOREIGN_ROUND"),
        ({"host": "/strangers"}, "UNREGISTERED"),
        ({"instance": "second"}, "WRONG_INSTANCE"),
        ({"token": b"token of another"}, "WRONG_TOKEN"),
        ({"token": b""}, "WRONG_TOKEN"),
    ],
)
def test_foreign_messages_are_refused_and_do_not_count(changes: dict[str, Any], code: str) -> None:
    opened = auction(answer(**changes))

    assert not opened.complete
    decision = close(opened)
    assert (refusals(decision), decision.outcome) == ([("", code)], AuctionOutcome.NO_BIDS)
    assert decision.silent_hosts == ("/agents",)


@pytest.mark.parametrize(
    "changes",
    [
        {"vectors": FINE},
        {"agent_ids": (1,)},
        {"declined": ("x",)},
        {"decline_reasons": ("because",)},
        {"unmet": ("scene.person",)},
        {"weights": (1.0, 1.0, 1.0)},
    ],
)
def test_malformed_message_is_refused_but_counts_as_response(changes: dict[str, Any]) -> None:
    opened = auction(answer(**changes))

    assert opened.complete
    assert refusals(close(opened)) == [("", "WRONG_LENGTH")]


@pytest.mark.parametrize("vector", [(), (4.0,), (4.0, 1.5, 3.0, 1.0)])
def test_single_bid_of_wrong_length_names_its_agent(vector: Vector) -> None:
    alone_answer = answer(agents=(GUIDE,), agent_ids=(1,), vectors=vector)

    alone = replace(HOST, agents={GUIDE: 1})
    assert refusals(close(auction(alone_answer, host=alone))) == [(GUIDE, "WRONG_LENGTH")]


@pytest.mark.parametrize(
    ("vector", "weights", "code"),
    [
        ((math.nan, 1.5, 3.0), (), "NOT_FINITE"),
        ((4.0, -math.inf, 3.0), (), "NOT_FINITE"),
        ((4.0, 1.5, 5.5), (), "OUT_OF_RANGE"),
        (("x", 1.5, 3.0), (), "NOT_A_NUMBER"),
        (FINE, (1.0, math.nan, 1.0), "OUT_OF_RANGE"),
        (FINE, (1.0, 1.0, -1.0), "OUT_OF_RANGE"),
        (FINE, (1.0, 1.0, 1001.0), "OUT_OF_RANGE"),
    ],
)
def test_bad_vector_or_weight_refuses_only_its_agent(
    vector: tuple[Any, ...], weights: Vector, code: str
) -> None:
    all_weights = (*weights, 1.0, 1.0, 1.0) if weights else ()
    decision = close(auction(answer(vectors=(*vector, *EXPRESS_VECTOR), weights=all_weights)))

    assert refusals(decision) == [(GUIDE, code)]
    assert [(bid.agent, bid.vector) for bid in decision.ranking] == [(EXPRESS, EXPRESS_VECTOR)]
    assert math.isnan(decision.margin)


@pytest.mark.parametrize("kind", [tuple, list, lambda v: array("d", v), np.array])
def test_vectors_and_weights_accept_any_sequence_type(kind: Any) -> None:
    vectors, weights = (*FINE, *EXPRESS_VECTOR), (1.0, 2.0, 1.0, 1.0, 1.0, 1.0)
    ranking = close(auction(answer(vectors=kind(vectors), weights=kind(weights)))).ranking

    assert [bid.vector for bid in ranking] == [FINE, EXPRESS_VECTOR]
    assert [bid.weights for bid in ranking] == [weights[:3], ()]


NO = {"decline_reasons": ("no",)}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"agents": ("stranger", EXPRESS)}, [("stranger", "UNKNOWN_AGENT"), UNANSWERED]),
        ({"agent_ids": (7, 2)}, [(GUIDE, "WRONG_ID")]),
        ({"agents": (EXPRESS,) * 2, "agent_ids": (2, 2)}, [(EXPRESS, "DUPLICATE"), UNANSWERED]),
        ({"declined": (EXPRESS,), **NO}, [(EXPRESS, "DUPLICATE")]),
        ({"declined": ("stranger",), **NO}, [("stranger", "UNKNOWN_AGENT")]),
    ],
)
def test_misnamed_agents_are_refused(
    changes: dict[str, Any], expected: list[tuple[str, str]]
) -> None:
    assert refusals(close(auction(answer(**changes)))) == expected


def test_first_response_of_host_counts() -> None:
    decision = close(auction(answer(), answer(vectors=(5.0, 1.0, 3.0) * 2)))

    assert (refusals(decision), decision.ranking[0].distance) == ([("", "DUPLICATE")], 1.5)


def test_declining_counts_as_response() -> None:
    reasons = {"declined": (GUIDE, EXPRESS), "decline_reasons": ("needs scene.person", "")}
    opened = auction(answer(agents=(), agent_ids=(), vectors=(), **reasons))
    decision = close(opened)

    assert opened.complete
    assert decision.outcome is AuctionOutcome.NO_BIDS
    assert {bid.kind for bid in decision.refused} == {RoundKind.DECLINED}
    assert [bid.reason for bid in decision.refused] == ["needs scene.person", "gives no reason"]


def test_excluded_agent_may_be_omitted_but_not_bid() -> None:
    only_express = answer(agents=(EXPRESS,), agent_ids=(2,), vectors=EXPRESS_VECTOR)
    opened, silent = (
        auction(one, excluded={GUIDE: "stopped: mood"}) for one in (answer(), only_express)
    )

    assert (refusals(close(opened)), refusals(close(silent))) == ([(GUIDE, "EXCLUDED")], [])


@pytest.mark.parametrize(
    ("changes", "winner"),
    [
        ({}, GUIDE),
        ({"last_run": {GUIDE: 1}}, EXPRESS),
        ({"last_run": {GUIDE: 1, EXPRESS: 2}}, GUIDE),
        ({"last_run": {GUIDE: 1}, "tie_break": "name"}, GUIDE),
    ],
)
def test_ties_go_to_least_recently_run_then_name(changes: dict[str, Any], winner: str) -> None:
    alike = answer(agents=(EXPRESS, GUIDE), agent_ids=(2, 1), vectors=(4.0, 2.0, 3.0) * 2)

    assert close(auction(alike, **changes)).ranking[0].agent == winner


# The order of the accepted bids
PROFILES = {"ann": (3.0, 3.0, 3.0), "bob": (4.0, 3.0, 3.0), "cat": (5.0, 5.0, 5.0)}


def rules(*lines: str) -> tuple[MarketRule, ...]:
    text = "format: 1\nrules:\n" + "".join(f"  - {line}\n" for line in lines)
    return read_market(Source("market.yaml", text), SPACE)


def ranked(*lines: str, values: Vector = (3.0, 3.0, 3.0)) -> Ranked:
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

    assert (names(found), found.precedence) == (["cat", "ann", "bob"], "rule 2: scene.age <= 4")
    first = found.bids[0]
    assert (first.score, first.distance) == (-1.0, 6.0)
    assert first.bonus == 0.0, "a place is no exploration"


def test_rule_orders_its_agents_and_skips_non_bidders() -> None:
    found = ranked("{when: scene.person, agents: [zoe, cat, bob]}")

    assert (names(found), found.placed) == (["cat", "bob", "ann"], 2)


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

    assert (names(found), found.precedence, found.placed) == (["ann", "bob", "cat"], "", 0)


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

    [problem] = decide(SPACE, of, bids(PROFILES)).undecided
    assert (problem.file, problem.line, problem.message) == ("market.yaml", 4, UNDECIDED)


def test_rules_after_first_match_are_not_evaluated() -> None:
    assert ranked("{when: scene.person, agents: [bob]}", TORN).undecided == ()


def test_status_lists_undecidable_rules_of_last_evaluation() -> None:
    line = f"{{when: 1 / (scene.age - 3) > 0, agents: [{EXPRESS}]}}"
    market = MarketHarness(rules(line), strategy="rules")
    market.register()
    told = UNDECIDED.replace("4:12", "3:12").replace("rule 2", "rule 1")
    for scene_id in ("s1", "s2"):
        market.scene(scene_id, 3.0, 3.0, 3.0)
        market.bid()
        assert [one.message for one in market.all(Alarm)] == [told], "it is logged once"
        market.perform()
        assert [one.message for one in market.status.problems] == [told]
    market.scene("s3", 4.0, 3.0, 3.0)
    market.bid()
    assert market.status.problems == ()


# Strategies and weights


def test_scene_weights_apply_to_agents_without_weights() -> None:
    weights = {"age": 0.0, "familiarity": 2.0, "mood": 1.0}
    parameters = tuple(replace(one, weight=weights[one.name]) for one in SPACE.parameters)
    space = replace(SPACE, parameters=parameters)
    vectors = {GUIDE: (5.0, 2.0, 3.0), EXPRESS: (1.0, 1.5, 4.0)}
    accepted = bids(vectors, **{EXPRESS: (1.0, 1.0, 1.0)})
    wanted = scene("s1", 5.0, 1.0, 3.0)
    ranked = decide(space, terms(wanted, strategy="weighted_manhattan"), accepted)
    assert [(one.agent, one.distance) for one in ranked.bids] == [(GUIDE, 2.0), (EXPRESS, 5.5)]


def test_empty_bids_give_empty_ranking() -> None:
    assert decide(SPACE, terms(strategy="thompson", shadow="ucb"), bids({})).bids == ()


@pytest.mark.parametrize("changes", [{"strategy": "theirs"}, {"shadow": "theirs"}])
def test_uninstalled_strategy_is_refused_by_name(changes: dict[str, str]) -> None:
    with pytest.raises(Refused, match="no strategy 'theirs' is installed"):
        decide(SPACE, terms(**changes), bids({GUIDE: (4.0, 1.5, 3.0)}))
