# SPDX-License-Identifier: Apache-2.0
"""Sentences are only for people: the system works the same with other ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from active_nodes import active_market
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Auction, Run
from bt_agents_interfaces.srv import Analyze, CancelRun, GiveFeedback, OperateMarket
from whole_system import System, write_agents

TEXTS = {
    "calculation",
    "change",
    "decline_reasons",
    "description",
    "explanation",
    "intervention",
    "message",
    "reason",
    "reasons",
    "title",
    "unmet",
}
"""Fields with texts for people."""

MARK = "※"


def replaced(text: str) -> str:
    """Return other words; an empty text stays empty."""
    return text if not text or text.startswith(MARK) else f"{MARK} {len(text)} others {MARK}"


def types_of_messages() -> Iterator[type]:
    """Yield every class of our messages, services and actions."""
    for kind in ("msg", "srv", "action"):
        module = import_module(f"bt_agents_interfaces.{kind}")
        for found in vars(module).values():
            parts = (getattr(found, name, None) for name in ("Request", "Response", "Result"))
            yield from (
                part for part in chain([found], parts) if hasattr(part, "_fields_and_field_types")
            )


def with_other_words(field: property) -> property:
    def store(message: Any, value: Any) -> None:
        assert field.fset is not None
        if isinstance(value, str):
            field.fset(message, replaced(value))
        elif value and all(isinstance(one, str) for one in value):
            field.fset(message, [replaced(one) for one in value])
        else:
            field.fset(message, value)

    return property(field.fget, store)


@pytest.fixture(params=["as they are", "replaced"])
def words(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Replace all texts of messages and refusals, or none."""
    if request.param == "replaced":
        for kind in types_of_messages():
            for name in TEXTS & kind._fields_and_field_types.keys():
                monkeypatch.setattr(kind, name, with_other_words(getattr(kind, name)))
        refuse = Refused.__init__
        monkeypatch.setattr(
            Refused,
            "__init__",
            lambda self, code, reason, *more: refuse(self, code, replaced(reason), *more),
        )
    return str(request.param)


def started(system: System, count: int) -> Callable[[], bool]:
    return lambda: sum(run.event == Run.STARTED for run in system.runs) == count


def test_complete_cycle_does_not_depend_on_wording(ros: Any, tmp_path: Path, words: str) -> None:
    trees = write_agents(tmp_path, wait="30 s", young=1.5, middle=3.0, old=4.5)
    system = System(ros, trees)
    system.analyze(person=Analyze.Request.ABSENT, age=5)
    ros.until(lambda: len(system.ends) == 1)
    scene_id = system.analyze(age=5, familiarity=3, mood=4).scene.scene_id
    ros.until(started(system, 1))
    assert system.analyze(announce=False, mood=2).accepted, "the mood falls: a rule stops the run"
    ros.until(started(system, 2))
    veto = {"action": OperateMarket.Request.VETO, "agent": system.runs[-1].agent}
    assert ros.ask(OperateMarket, "marketplace/operate", author="test", **veto).accepted
    ros.until(started(system, 3))
    assert ros.ask(CancelRun, "marketplace/cancel", reason="enough").accepted
    ros.until(lambda: system.finished(scene_id))
    for agent, is_known in (("young", True), ("nobody", False)):
        given = {"agent": agent, "values": [2.0, 3.0, 3.0]}
        assert ros.ask(GiveFeedback, "feedback/give", **given).accepted is is_known
    ros.until(lambda: len(system.feedback_given) == 2)

    assert [(end.code, end.agent) for end in system.ends] == [
        ("NO_BIDS", ""), ("CANCELLED", "young"),
    ]  # fmt: skip
    assert [
        (auction.outcome, auction.winner, bool(auction.follows), len(auction.refused))
        for auction in system.auctions
    ] == [
        (Auction.NO_BIDS, "", False, 3),
        (Auction.AWARDED, "old", False, 0),
        (Auction.AWARDED, "middle", True, 0),
        (Auction.AWARDED, "young", True, 1),
    ]
    ended = [run for run in system.runs if run.event == Run.ENDED]
    assert [(run.agent, run.outcome, run.stop_cause) for run in ended] == [
        (agent, Run.CANCELLED, Run.BY_MARKET) for agent in ("old", "middle", "young")
    ]
    assert [(one.agent, one.kind) for one in system.feedback_given] == [("old", 2), ("young", 0)]
    told = {auction.reason[:1] == MARK for auction in system.auctions}
    assert told == {words == "replaced"}


def test_interrupted_run_is_retried_whatever_the_wording(
    ros: Any, tmp_path: Path, words: str
) -> None:
    del words
    system = System(ros, write_agents(tmp_path, wait="30 s", young=1.5))
    system.analyze(age=1, familiarity=3, mood=3)
    ros.until(started(system, 1))
    ros.remove(system.market)
    ros.add(active_market(system.folder.scene.space, "epoch-2"))
    ros.until(started(system, 2))

    ended = next(run for run in system.runs if run.event == Run.ENDED)
    assert (ended.epoch, ended.stop_cause) == ("epoch", Run.MARKET_LOST)
    ros.until(lambda: system.ends and len(system.auctions) == 2)
    assert [end.code for end in system.ends] == ["LOST"]
    assert system.auctions[-1].scene.scene_id == f"{system.auctions[0].scene.scene_id}+again"
