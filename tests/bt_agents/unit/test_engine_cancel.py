# SPDX-License-Identifier: Apache-2.0
"""Cancels at every stage of a run, tick by tick."""

from __future__ import annotations

import math
from itertools import accumulate, chain, repeat

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.run import RunLimits, TreeOutcome
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents.engine.ticker import Ticker
from bt_agents_core.stop_cause import Cancellation
from tree_harness import TreeHarness, started

LONG = ScriptedReply(after_s=100.0)
STUBBORN = ScriptedReply(after_s=100.0, cancel_s=math.inf)
CLEAN_UP = "on_cancel: {say: good-bye}"
SPEAKS = "sequence: [{say: hello}, {show: {text: x}}]"


def cancelled(head: str, *says: ScriptedReply) -> TreeHarness:
    """Return a run that was cancelled while it was speaking."""
    harness = started(SPEAKS, head=head, answers={"say": says or [LONG]})
    harness.changes = harness.run.cancel("enough")
    return harness


def test_cancel_before_first_tick_needs_no_cleanup() -> None:
    harness = TreeHarness(SPEAKS, head=CLEAN_UP)
    harness.run.cancel("enough")
    result = harness.result
    assert (harness.outcome, harness.asked) == ("cancelled", [])
    assert (result.ticks, result.tip, result.message) == (0, "", "enough")


def test_cancel_halts_leaf_now_and_cleans_up_next() -> None:
    harness = cancelled(CLEAN_UP, LONG, ScriptedReply(after_s=1.0))
    assert harness.environment.running() == []
    assert {change.path for change in harness.changes} == {"tree", "tree/0.say"}
    assert harness.said == ["hello"]
    assert harness.tick() == "running"
    assert harness.run.cancel("more than enough") == []
    assert harness.environment.running() == ["say"]
    assert harness.after(1.0) == "cancelled"
    assert (harness.said, harness.message) == (["hello", "good-bye"], "enough")


@pytest.mark.parametrize(("within", "limit_s"), [("", 3.0), ("\non_cancel_within: 5 s", 5.0)])
def test_overlong_cleanup_is_halted(within: str, limit_s: float) -> None:
    harness = cancelled(CLEAN_UP + within)
    assert harness.outcomes(0, limit_s - 0.1, 0.1) == "RRC"
    assert harness.environment.running() == []


@pytest.mark.parametrize(
    ("succeed_on", "says", "outcome"),
    [
        ("one", ScriptedReply(), ("succeeded", "the tree succeeded")),
        (
            "all",
            ScriptedReply(state=GoalState.ABORTED, message="hoarse"),
            ("failed", "say aborted: hoarse"),
        ),
    ],
)
def test_cancel_while_settling_keeps_the_outcome(
    succeed_on: str, says: ScriptedReply, outcome: tuple[str, str]
) -> None:
    harness = started(
        f"parallel: {{succeed_on: {succeed_on}, children: [{{say: x}}, {{show: {{text: y}}}}]}}",
        head=CLEAN_UP,
        answers={"say": [says], "show": [ScriptedReply(after_s=9.0, cancel_s=0.5)]},
    )
    assert (harness.outcome, harness.run.cancel("too late")) == ("running", [])
    harness.after(0.5)
    assert (harness.outcome, harness.message) == outcome
    assert harness.said == ["x"]


def test_host_cancel_can_skip_cleanup() -> None:
    harness = started(SPEAKS, head=CLEAN_UP, answers={"say": [LONG]})
    harness.run.cancel("the host is stopping", clean_up=False)
    assert harness.outcome == "cancelled"
    assert harness.said == ["hello"]


def test_second_cancel_without_cleanup_halts_running_cleanup() -> None:
    harness = cancelled(CLEAN_UP)
    harness.tick()
    assert harness.environment.running() == ["say"]
    harness.run.cancel("the host is stopping", clean_up=False)
    assert harness.environment.running() == []
    assert harness.tick() == "cancelled"
    assert harness.message == "enough"


def test_expired_cleanup_starts_no_further_node() -> None:
    head = "on_cancel: {sequence: [{say: good-bye}, {say: really}]}"
    harness = cancelled(head, LONG, ScriptedReply(after_s=1.0))
    harness.tick()
    assert harness.after(60.0) == "cancelled"
    assert harness.said == ["hello", "good-bye"]


@pytest.mark.parametrize("wait_s", [0.0, 1.0])
def test_shortened_settling_ends_the_wait_for_goals(wait_s: float) -> None:
    harness = started(SPEAKS, answers={"say": [STUBBORN]}, limits=RunLimits(settle_s=2.0))
    if not wait_s:
        harness.run.shorten_settling(0.7)
    harness.run.cancel("the host is stopping")
    assert harness.after(wait_s) == "running"
    harness.run.shorten_settling(0.7)
    assert harness.outcomes(0.6, 0.1) == "RC"
    assert harness.result.orphans == ("tree/0.say",)
    harness.run.shorten_settling(0.7)
    assert harness.outcome == "cancelled"


def test_give_up_ends_run_whose_nodes_cannot_halt(monkeypatch: pytest.MonkeyPatch) -> None:
    harness = started(SPEAKS, answers={"say": [LONG]})

    def stuck(_ticker: object) -> None:
        raise RuntimeError("cogwheel")

    monkeypatch.setattr(Ticker, "halt", stuck)
    result = harness.run.give_up("RuntimeError: cogwheel")
    assert result.outcome is TreeOutcome.FAILED
    assert result.orphans == ("tree/0.say",)


def slowed(*steps: float) -> TreeHarness:
    """Return a run after one tick, in which each reading of the clock advances it by a step."""
    harness = TreeHarness(SPEAKS, answers={"show": [LONG]})
    now = accumulate(chain(steps, repeat(0.0)))
    harness.run._steady = lambda: next(now)
    harness.run.period_s = 0.1
    harness.tick()
    return harness


@pytest.mark.parametrize(
    ("steps", "slowest", "times"),
    [
        # Read before the tick, at each leaf's answer, and at the end.
        ((0.0, 0.01, 0.2, 0.01), "tree/1.show", (0.2, 0.22)),
        ((0.0, 0.01, 0.02, 0.3), "tree", (0.3, 0.33)),
    ],
)
def test_tick_overrun_names_the_slowest_node(
    steps: tuple[float, ...], slowest: str, times: tuple[float, float]
) -> None:
    harness = slowed(*steps)
    overrun = harness.run.overrun
    assert overrun is not None
    assert overrun.slowest == slowest
    assert (overrun.slowest_s, overrun.took_s) == pytest.approx(times)
    harness.tick()
    assert harness.run.overrun is None
    harness.run.cancel("enough")
    assert harness.result.overruns == 1


TELLS_WHY = (
    "on_cancel: {choose: {children: [{name: rule, when: cancel.by == 'mood rule', say: 'Sorry.'}, "
    "{name: told, when: known(cancel.reason), say: '${cancel.reason}'}], "
    "otherwise: {say: 'I stop here.'}}}"
)
RULE = Cancellation(by="mood rule", reason="mood.change <= -1 held 2 s")
OPERATOR = Cancellation(by="operator", reason="the shift is over")


@pytest.mark.parametrize(("cancellation", "text"), [(RULE, "Sorry."), (OPERATOR, OPERATOR.reason)])
def test_cleanup_reads_who_cancelled_and_why(cancellation: Cancellation, text: str) -> None:
    harness = started(SPEAKS, head=TELLS_WHY, answers={"say": [LONG]})
    harness.run.cancel("enough", cancellation=cancellation)
    harness.tick()
    assert harness.said == ["hello", text]


def test_cleanup_waits_for_the_cancel_cause_it_reads() -> None:
    harness = cancelled(TELLS_WHY)
    assert harness.environment.running() == []
    assert (harness.after(0.05), harness.said) == ("running", ["hello"])
    for cancellation in (RULE, OPERATOR):
        harness.run.cancel("enough", cancellation=cancellation)
        harness.tick()
        assert harness.said == ["hello", "Sorry."]


def test_cancel_cause_is_missing_after_its_deadline() -> None:
    harness = cancelled(TELLS_WHY)
    assert harness.run.deadline == pytest.approx(RunLimits().explain_s)
    harness.after(RunLimits().explain_s)
    assert harness.said == ["hello", "I stop here."]


def test_run_awaiting_cancel_cause_can_skip_cleanup() -> None:
    harness = cancelled(TELLS_WHY)
    harness.run.cancel("the host is stopping", clean_up=False)
    assert harness.tick() == "cancelled"
    assert harness.said == ["hello"]
