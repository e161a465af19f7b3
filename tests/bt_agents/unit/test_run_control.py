# SPDX-License-Identifier: Apache-2.0
"""Control of runs: valid requests, and their effect."""

from __future__ import annotations

import pytest

from bt_agents.host.run_control import MOST_BREAKPOINTS, RunControl, pause_text
from bt_agents_core.errors import Refused
from bt_agents_core.run_key import RunKey

RUN = RunKey(epoch="e1", round=3, agent="guide")
NODES = ("tree", "tree/0.ask", "tree/1.say")


@pytest.fixture
def control() -> RunControl:
    control = RunControl(lambda: None)
    control.begin(RUN)
    return control


def code(control: RunControl, epoch: str = "", number: int = 0) -> str:
    try:
        control.check(epoch, number)
    except Refused as refused:
        return refused.code
    return ""


def test_only_the_current_run_is_addressed(control: RunControl) -> None:
    assert code(control) == code(control, "e1", 3) == ""
    assert code(control, "e1", 2) == code(control, "e0", 3) == "OTHER_ROUND"
    control.end()
    assert code(control) == "NOT_RUNNING"


def test_ended_tree_cannot_be_paused(control: RunControl) -> None:
    control.end_ticking()
    assert code(control) == "ENDING"


def test_pause_names_its_author_until_resume(control: RunControl) -> None:
    control.pause("anna")
    assert (control.paused, control.author) == (True, "anna")
    with pytest.raises(Refused, match="paused by anna already"):
        control.pause("ben")
    control.resume("ben")
    assert (control.paused, control.author) == (False, "ben")
    with pytest.raises(Refused, match="not paused"):
        control.resume("ben")


def test_pause_ends_with_its_run_or_tree(control: RunControl) -> None:
    for end in (control.end_ticking, control.end):
        control.begin(RUN)
        control.pause("anna")
        end()
        assert not control.paused


def test_tick_holding_a_node_pauses_run_once(control: RunControl) -> None:
    assert control.on_tick(["tree/0.ask"])
    assert (control.paused, control.paused_at) == (True, "tree/0.ask")
    assert not control.on_tick(["tree/1.say"])
    assert (control.paused, control.paused_at) == (True, "tree/1.say")
    assert not control.on_tick([])
    assert (control.paused, control.paused_at) == (True, "")


def test_tick_without_held_node_notifies_no_one() -> None:
    told: list[str] = []
    control = RunControl(lambda: told.append("changed"))
    control.begin(RUN)
    told.clear()
    assert not control.on_tick([])
    assert told == []


def test_breakpoints_outlive_run_and_are_per_agent(control: RunControl) -> None:
    control.set_breakpoints("guide", ["tree/0.ask", "tree/0.ask"], NODES, "anna")
    control.set_breakpoints("other", ["tree"], NODES, "anna")
    control.end()
    assert control.breakpoints == {"guide": ("tree/0.ask",), "other": ("tree",)}
    control.set_breakpoints("guide", [], NODES, "anna")
    assert control.breakpoints == {"other": ("tree",)}


def test_breakpoint_on_unknown_node_suggests_nearest(control: RunControl) -> None:
    with pytest.raises(Refused, match=r"no node 'tree/0\.aks'; did you mean 'tree/0\.ask'"):
        control.set_breakpoints("guide", ["tree/0.aks"], NODES, "anna")
    assert control.breakpoints == {}


def test_number_of_breakpoints_is_bounded(control: RunControl) -> None:
    nodes = [f"tree/{number}.say" for number in range(MOST_BREAKPOINTS)]
    control.set_breakpoints("guide", nodes, nodes, "anna")
    with pytest.raises(Refused, match=r"^TOO_MANY: "):
        control.set_breakpoints("other", ["tree"], NODES, "anna")
    assert "other" not in control.breakpoints


def test_pause_text_names_node_of_breakpoint() -> None:
    assert pause_text("tree/0.ask", "anna") == "paused before tree/0.ask"
    assert pause_text("", "") == "paused"
