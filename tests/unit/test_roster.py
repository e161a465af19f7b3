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


def test_agents_come_and_go_and_one_that_leaves_bids_no_more_and_says_why():
    roster = Roster(SPACE, [agent("say: x")])
    second = roster.add(replace(agent("say: x"), name="b"))
    assert declined(roster, age=3) == {}
    second.leaving = "its file is gone"
    assert declined(roster, age=3) == {"b": "its file is gone"}
    roster.remove("b")
    assert set(roster.members) == {"a"}
    roster.enrol(["b"], [7], [""])
    assert declined(roster, age=3) == {}


def test_when_nobody_here_can_run_all_decline_with_that_reason():
    roster = Roster(SPACE, [agent("say: x", "requires: scene.age >= 3")])
    roster.enrol(["a"], [1], [""])
    answer = roster.answer(scene(age=2), obstacle="nothing publishes /clock")
    assert (answer.bids, answer.declined) == ((), {"a": "nothing publishes /clock"})
