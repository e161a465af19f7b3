# SPDX-License-Identifier: Apache-2.0
"""A scripted play: one visit after another, none skipped, repeated or endless."""

from __future__ import annotations

import pytest

from bt_agents_language.model.specs import SceneChange, Script, Visit
from scene_layer.script import (
    AGAIN_WITHIN_S,
    TAKEN_WITHIN_S,
    MarketView,
    ScriptPerformance,
    answer,
)


def visit(label: str, **more: object) -> Visit:
    return Visit(label=label, person=True, values={"mood": 3.0}, **more)


def market(
    finished: str = "", *, idle: bool = True, agents: int = 1, epoch: str = "e"
) -> MarketView:
    return MarketView(epoch=epoch, idle=idle, agents=agents, finished_scene_id=finished)


def play(*visits: Visit, **more: object) -> ScriptPerformance:
    return ScriptPerformance(Script(title="", visits=visits), **more)


def begin(performance: ScriptPerformance, scene_id: str, now: float = 0.0) -> Visit | None:
    found = performance.next(now)
    if found is not None:
        performance.announced(scene_id)
    return found


def finish(performance: ScriptPerformance, scene_id: str, now: float, epoch: str = "e") -> None:
    """Let the market finish a scene that ends the visit."""
    performance.market(market(scene_id, epoch=epoch), now)
    assert performance.over()


def change(after_s: float) -> SceneChange:
    return SceneChange(after_s=after_s, values={"mood": 2.0})


def begun(*visits: Visit, **more: object) -> ScriptPerformance:
    """Return a performance whose first visit has begun with the scene s1."""
    performance = play(*visits, **more)
    performance.market(market(), 0.0)
    begin(performance, "s1")
    return performance


def test_each_visit_begins_after_market_finishes_previous_one():
    a, b = visit("a"), visit("b")
    performance = play(a, b)
    performance.market(market(), 0.0)
    assert begin(performance, "s1") is a
    performance.market(market(idle=False), 0.1)
    assert not performance.over()
    assert not performance.not_taken(1000.0), "a busy market has no time limit"
    finish(performance, "s1", 1000.2)
    assert begin(performance, "s2", 1000.2) is b
    assert not performance.over(), "the scene that is finished is the one before"
    finish(performance, "s2", 1000.3)
    assert performance.done
    assert performance.next(1000.4) is None


def test_script_without_visits_is_done_at_once():
    performance = play()
    performance.market(market(), 0.0)
    assert performance.done
    assert performance.next(0.0) is None


def test_first_visit_waits_for_idle_market_with_agents():
    performance = play(visit("a"), wait_for_agents=3)
    assert performance.next(0.0) is None
    performance.market(market(agents=2), 0.0)
    assert performance.next(0.0) is None
    performance.market(market(agents=3, idle=False), 0.0)
    assert performance.next(0.0) is None
    performance.market(market(agents=3), 0.0)
    assert performance.next(0.0) is not None


def test_visit_ends_when_market_moved_to_another_scene():
    performance = begun(visit("a"), visit("b"))
    performance.market(market("s1", idle=False), 1.0)
    assert performance.over()
    assert performance.next(1.0) is None
    performance.market(market("foreign"), 2.0)
    assert performance.next(2.0) is not None


def test_visit_resumed_by_restarted_market_is_not_resent():
    a = visit("a", changes=(change(1.0),))
    performance = begun(a)
    performance.started("s1", 0.0)
    performance.market(market(epoch="new"), 1.0)
    assert not performance.over()
    assert performance.next(1.0) is None
    assert performance.due(2.0) == [], "the person begins anew with the run"
    performance.market(market(idle=False, epoch="new"), 3.0)
    performance.started("s1+again", 3.0)
    assert performance.due(4.0) == list(a.changes)
    finish(performance, "s1+again", 5.0, epoch="new")
    assert performance.done


def test_visit_unknown_to_restarted_market_is_sent_again():
    a = visit("a")
    performance = begun(a)
    performance.market(market(epoch="new"), 1.0)
    assert not performance.not_taken(1.0 + AGAIN_WITHIN_S)
    assert performance.not_taken(1.1 + AGAIN_WITHIN_S)
    assert begin(performance, "s2", 12.0) is a
    finish(performance, "s2", 13.0, epoch="new")
    assert performance.done


def test_scene_ignored_by_idle_market_is_sent_again():
    performance = play(visit("a"))
    performance.market(market(), 0.0)
    begin(performance, "s1", 10.0)
    assert not performance.not_taken(10.0 + TAKEN_WITHIN_S)
    assert performance.not_taken(10.1 + TAKEN_WITHIN_S)
    assert not performance.not_taken(99.0)
    assert begin(performance, "s2", 16.0) is not None


@pytest.mark.parametrize("pace", [1.0, 5.0])
def test_changes_come_once_timed_from_run_start(pace: float):
    late, early = change(3.0 * pace), change(pace)
    performance = begun(visit("a", changes=(late, early)), pace=pace)
    assert performance.due(100.0) == []
    performance.started("foreign", 100.0)
    assert performance.due(200.0) == []
    assert performance.unmade == (late, early)
    performance.started("s1", 200.0)
    assert performance.due(200.9) == []
    assert performance.due(201.0) == [early]
    assert performance.unmade == (late,)
    performance.started("s1", 202.6)
    assert performance.due(203.0) == [late], "a second run of the scene starts no new clock"
    assert performance.due(300.0) == []


def test_run_start_received_before_its_scene_counts():
    performance = play(visit("a", changes=(change(3.0),)), visit("b", changes=(change(3.0),)))
    performance.market(market(), 0.0)
    performance.next(0.0)
    performance.started("s1", 1.0)
    performance.announced("s1")
    assert performance.due(3.9) == []
    assert performance.due(4.0) == [change(3.0)]
    finish(performance, "s1", 5.0)
    begin(performance, "s2", 6.0)
    assert performance.due(20.0) == [], "the start of the visit before is none of this one"


def test_changes_of_finished_visit_are_dropped():
    performance = begun(visit("a", changes=(change(1.0),)), visit("b"))
    performance.started("s1", 0.0)
    finish(performance, "s1", 0.5)
    assert performance.unmade == (change(1.0),)
    assert performance.due(5.0) == []
    begin(performance, "s2", 6.0)
    assert performance.due(9.0) == []


def test_first_matching_word_of_question_decides_answer():
    who = visit("a", answers={"Luggage": "yes", "go": "later"})
    assert answer(who, "May I carry your luggage? Shall we go?") == "yes"
    assert answer(who, "Shall we GO?") == "later"
    assert answer(who, "What time is it?") == ""
