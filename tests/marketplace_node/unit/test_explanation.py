# SPDX-License-Identifier: Apache-2.0
"""Explanations of typical decisions: one line, then sentences, compared exactly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bt_agents_core.scene import Origin, Scene, SceneValue
from bt_agents_language.files.market_reader import market_of
from bt_agents_language.files.scene_reader import read_scene
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import reason_of
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy, Decision, External, RefusedBid, RoundKind
from ranked_rounds import bids, decided, terms

ROOT = Path(__file__).parents[3]
KEPT = ROOT / "tests" / "corpus" / "explanations"
SPACE = read_scene(ROOT / "trees" / "scene.yaml").space
GUIDE, EXPRESS, CHILD = "attentive_guide", "professional_express", "playful_companion"
PROFILES = {GUIDE: (4.0, 1.5, 3.0), EXPRESS: (3.0, 5.0, 3.5), CHILD: (1.0, 2.0, 4.0)}
AS_GIVEN = Scene(
    scene_id="v1",
    label="",
    person=True,
    values=tuple(
        SceneValue(name=name, value=value, origin=Origin.GIVEN)
        for name, value in (("age", 2.0), ("familiarity", 2.0), ("mood", 3.0))
    ),
)


def refused(agent: str, kind: RoundKind, code: str, why: str, unmet: str = "") -> RefusedBid:
    return RefusedBid(agent=agent, host="/agents", kind=kind, code=code, reason=why, unmet=unmet)


def declined(agent: str) -> RefusedBid:
    return refused(agent, RoundKind.DECLINED, "DECLINED", "needs scene.person", "scene.person")


def of(scene: Scene = AS_GIVEN, agents: Any = None, **changes: Any) -> Decision:
    """Return a decision among the agents; the other changes concern its outcome."""
    ended = ("refused", "silent_hosts", "external", "outcome", "closed_by", "stopped")
    how = {name: changes.pop(name) for name in ended if name in changes}
    weights = changes.pop("weights", {})
    accepted = bids(PROFILES if agents is None else agents, **weights)
    return decided(terms(scene, **changes), accepted, space=SPACE, **how)


ESTIMATED = Scene(
    scene_id="v1",
    label="an elderly lady",
    person=True,
    person_id="anna",
    place="the lobby",
    values=(
        SceneValue(
            name="age",
            value=4.0,
            origin=Origin.MEASURED,
            age_s=0.2,
            std=0.3,
            confidence=0.8,
            source="person/age",
        ),
        SceneValue(
            name="familiarity",
            value=1.5,
            origin=Origin.ESTIMATED,
            age_s=9.0,
            std=0.4,
            source="12 earlier visits",
        ),
        SceneValue.missing("mood"),
    ),
)
AGE, FAMILIARITY, MOOD = AS_GIVEN.values
DAILY = replace(AS_GIVEN, values=(AGE, replace(FAMILIARITY, value=5.0), MOOD))
LEO = ("leo", RoundKind.REFUSED, "OUT_OF_RANGE", "bid of leo: age is 9, expected 1 to 5")
FILM = "anna pins attentive_guide: a film crew is here"
BARRED = tuple(refused(one, RoundKind.REFUSED, "NOT_PINNED", FILM) for one in (EXPRESS, CHILD))


def ran(**runs: int) -> dict[str, Any]:
    """Return the terms of a round after these runs."""
    return {"runs": runs, "last_run": runs, "rounds_run": sum(runs.values())}


DECISIONS = {
    "estimated": of(ESTIMATED),
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
