# SPDX-License-Identifier: Apache-2.0
"""Who bids for a scene, and why the others do not."""

from __future__ import annotations

from dataclasses import replace

from bt_agents.roster import Roster
from stage import SPACE, agent, scene


def declined(roster: Roster, **values: float) -> dict[str, str]:
    names = list(roster.members)
    roster.enrol(names, range(1, len(names) + 1), [""] * len(names))
    answer = roster.answer(scene(**values))
    assert {m.spec.name for m in answer.bids} == set(names) - set(answer.declined)
    return dict(answer.declined)


def test_an_agent_bids_when_what_it_requires_is_true():
    spec = agent("say: x", "requires: scene.age >= 3")
    assert declined(Roster(SPACE, [spec]), age=3) == {}
    assert declined(Roster(SPACE, [spec]), age=2) == {"a": "needs scene.age >= 3"}
    assert declined(Roster(SPACE, [spec])) == {
        "a": "needs scene.age >= 3, but scene.age is missing"
    }


def test_an_agent_that_uses_a_skill_which_nobody_offers_does_not_bid_and_says_why():
    reason = "skill 'dance': no robot is bound to it"
    spec = replace(agent("say: x"), unoffered=(reason,))
    assert declined(Roster(SPACE, [spec]), age=3) == {"a": reason}
