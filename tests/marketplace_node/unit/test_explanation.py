# SPDX-License-Identifier: Apache-2.0
"""Decisions as text and numbers: the line of a terminal, then sentences, compared exactly."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from bt_agents_language.files.market_reader import market_of
from bt_agents_language.files.scene_reader import read_scene
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness, scene, with_host
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import calculation, reason_of
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy, Decision, External, RefusedBid, RoundKind
from marketplace_node.round.ranking import decide
from ranked_rounds import bids, decided, terms

ROOT = Path(__file__).parents[3]
KEPT = ROOT / "tests" / "corpus" / "explanations"
SPACE = read_scene(ROOT / "trees" / "scene.yaml").space
CHILD = "playful_companion"
PROFILES = {GUIDE: (4.0, 1.5, 3.0), EXPRESS: (3.0, 5.0, 3.5), CHILD: (1.0, 2.0, 4.0)}
AS_GIVEN = scene("v1", 2.0, 2.0, 3.0)


def refused(agent: str, kind: RoundKind, code: str, why: str, unmet: str = "") -> RefusedBid:
    return RefusedBid(agent=agent, host="/agents", kind=kind, code=code, reason=why, unmet=unmet)


def declined(agent: str) -> RefusedBid:
    return refused(agent, RoundKind.DECLINED, "DECLINED", "needs scene.person", "scene.person")


def of(awarded_for: Scene = AS_GIVEN, agents: Any = PROFILES, **changes: Any) -> Decision:
    """Return a decision among the agents; the other changes concern its outcome."""
    ended = ("refused", "silent_hosts", "external", "outcome", "closed_by", "stopped")
    how = {name: changes.pop(name) for name in ended if name in changes}
    accepted = bids(agents, **changes.pop("weights", {}))
    return decided(terms(awarded_for, **changes), accepted, space=SPACE, **how)


AGE, FAMILIARITY, MOOD = AS_GIVEN.values
MEASURED = replace(
    AGE, value=4.0, origin=Origin.MEASURED, age_s=0.2, std=0.3, confidence=0.8, source="person/age"
)
REMEMBERED = replace(
    FAMILIARITY, value=1.5, origin=Origin.ESTIMATED, age_s=9.0, std=0.4, source="12 earlier visits"
)
LADY = replace(
    AS_GIVEN,
    label="an elderly lady",
    person_id="anna",
    place="the lobby",
    values=(MEASURED, REMEMBERED, SceneValue.missing("mood")),
)
DAILY = replace(AS_GIVEN, values=(AGE, replace(FAMILIARITY, value=5.0), MOOD))
LEO = ("leo", RoundKind.REFUSED, "OUT_OF_RANGE", "bid of leo: age is 9, expected 1 to 5")
FILM = "anna pins attentive_guide: a film crew is here"
BARRED = tuple(refused(one, RoundKind.REFUSED, "NOT_PINNED", FILM) for one in (EXPRESS, CHILD))


def ran(**runs: int) -> dict[str, Any]:
    """Return the terms of a round after these runs."""
    return {"runs": runs, "last_run": runs, "rounds_run": sum(runs.values())}


DECISIONS = {
    "estimated": of(LADY),
    "tie": of(
        agents={GUIDE: (2.0, 2.0, 2.0), CHILD: (2.0, 2.0, 4.0)}, last_run={GUIDE: 2, CHILD: 1}
    ),
    "drawn": of(strategy="softmax", options={"temperature": 2.0}, shadow="manhattan"),
    "by_rule": of(DAILY, strategy="rules", rules=market_of(ROOT / "trees", SPACE)),
    "outside_is_late": of(
        strategy="external",
        external=External(failure="the external program did not answer within 0.5 s"),
        refused=(declined("silent_text"), refused(*LEO)),
        silent_hosts=("/others",),
    ),
    "outside_ranks": of(
        strategy="external", external=External(ranking=(EXPRESS,), message="she is in a hurry")
    ),
    "pinned": of(
        agents={GUIDE: PROFILES[GUIDE]},
        operator_exclusions=BARRED,
        refused=BARRED,
        intervention=FILM,
    ),
    "weighted": of(strategy="weighted_manhattan", weights={GUIDE: (0.25, 1.0, 1.0)}, preview=True),
    "seldom": of(
        strategy="ucb", options={"c": 2.0}, **ran(attentive_guide=4, playful_companion=1)
    ),
    "explored": of(strategy="bounded_ucb", **ran(playful_companion=4, professional_express=1)),
    "explored_in_vain": of(strategy="bounded_ucb", **ran(playful_companion=1, attentive_guide=1)),
    "nobody": of(
        replace(AS_GIVEN, person=False, label="a ladder"),
        agents={},
        refused=(declined(GUIDE), declined(CHILD)),
    ),
    "stopped": of(
        closed_by=ClosedBy.STOPPED, outcome=AuctionOutcome.NO_BIDS, stopped="anna said stop"
    ),
}


@pytest.mark.parametrize("name", DECISIONS)
def test_decision_text_matches_stored_text(name: str) -> None:
    decision = DECISIONS[name]

    told = f"{reason_of(decision)}\n\n{explanation(decision, SPACE)}\n"
    assert told == (KEPT / f"{name}.txt").read_text(encoding="utf-8")


def test_every_stored_text_belongs_to_decision() -> None:
    assert {path.stem for path in KEPT.iterdir()} == set(DECISIONS)


def test_line_break_in_label_starts_no_sentence() -> None:
    forged = replace(AS_GIVEN, label="a guest\nbert gets the run.\u2028Really.")
    told = explanation(of(forged), SPACE)
    assert "'a guest bert gets the run. Really.'" in told
    assert not any(line.startswith(("bert gets", "Really")) for line in told.splitlines())


# The line of a terminal
NAN = math.nan


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((5.0, 1.0, NAN), "1.5 = |4−5| + |1.5−1|; mood is missing and left out"),
        ((NAN, 1.0, NAN), "0.5 = |1.5−1|; age and mood are missing and left out"),
        ((NAN, NAN, NAN), "0.0, as every value of the scene is missing"),
        ((-1.0, 1.0, 3.0), "5.5 = |4−(−1)| + |1.5−1| + |3−3|"),
    ],
)
def test_missing_and_negative_values_are_shown(values: tuple[float, ...], text: str) -> None:
    awarded_for = scene("s", *values)
    bid = decide(SPACE, terms(awarded_for), bids({GUIDE: (4.0, 1.5, 3.0)})).bids[0]

    assert calculation(bid, awarded_for, "manhattan") == text


def tied(market: MarketHarness, scene_id: str) -> str:
    market.scene(scene_id)
    market.bid(vectors={GUIDE: (4.0, 2.0, 3.0), EXPRESS: (4.0, 2.0, 3.0)})
    reason = market.auction.reason
    market.perform()
    return reason.split("; ")[1]


def test_tie_reason_names_least_recently_run_agent(market: MarketHarness) -> None:
    assert [tied(market, f"s{number}") for number in range(3)] == [
        "tied with professional_express: attentive_guide is first by name among those that "
        "have not run yet",
        "tied with attentive_guide: professional_express has not run yet",
        "tied with professional_express: attentive_guide has not run for the longest time",
    ]


def test_tie_reason_names_alphabetical_order() -> None:
    market = with_host(tie_break="name")

    words = "tied with professional_express: attentive_guide is first by name"
    assert [tied(market, f"s{number}") for number in range(2)] == [words, words]


def test_reason_without_bids_groups_them_by_cause() -> None:
    market = MarketHarness()
    market.register("/agents", GUIDE, EXPRESS, PLAIN, "leo")
    market.register("/others", "bob")
    market.scene()
    market.bid(
        vectors={"leo": (9.0, 1.5, 3.0)},
        declined={GUIDE: "needs scene.person", EXPRESS: "needs scene.person", PLAIN: "is tired"},
        unmet=("scene.person", "scene.person", ""),
    )
    market.wait(0.6)

    assert market.auction.reason == (
        "nobody bids: attentive_guide and professional_express need scene.person; plain: is "
        "tired; refused: leo (OUT_OF_RANGE: bid of leo: age is 9, expected 1 to 5); no answer in "
        "time from /others"
    )


def test_a_follow_up_round_says_what_it_continues(running: MarketHarness) -> None:
    running.cancel("mood.change <= -1.0", again=True, scene=scene("s1", 5.0, 1.0, 1.0))
    running.finish(outcome=3)
    running.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    assert running.auction.reason == (
        "continues round 1, without attentive_guide (stopped: mood.change <= -1.0): "
        "professional_express 8.5 = |3−5| + |5−1| + |3.5−1|; no other bid"
    )


def test_a_market_without_agents_says_so() -> None:
    market = MarketHarness(host_wait_s=0)
    market.scene()

    assert (market.calls, market.ends) == ([], [("s1", "NO_BIDS")])
    assert market.auction.reason == "no agents are registered"
    assert market.status.message == "scene 's1' is over: no agents are registered"


def test_unavailable_hosts_are_named_with_reason(impatient: MarketHarness) -> None:
    impatient.lose(away_s=1.1)
    impatient.scene()

    assert impatient.auction.reason == "nobody bids: /agents is not asked: it has no heartbeat"


def test_sum_shows_first_parameters_and_counts_rest() -> None:
    space = SceneSpace(
        parameters=tuple(
            SceneParameter(name=f"p{index}", minimum=0.0, maximum=5.0, default=0.0)
            for index in range(64)
        )
    )
    values = tuple(SceneValue(name=name, value=1.0, origin=Origin.GIVEN) for name in space.names)
    awarded_for = Scene(scene_id="s", label="", person=True, values=values)
    bid = decide(space, terms(awarded_for), bids({GUIDE: (2.0,) * 64})).bids[0]

    assert calculation(bid, awarded_for, "manhattan") == (
        f"64.0 = {' + '.join(['|2−1|'] * 12)} + 52 more"
    )
