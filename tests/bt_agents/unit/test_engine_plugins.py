# SPDX-License-Identifier: Apache-2.0
"""Behaviours of plug-ins as leaves: made anew at each start, kept apart, and never fatal."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import py_trees
import pytest
from py_trees.common import Status

from bt_agents_core.diagnostic import Position
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.model.specs import ListValue, Literal, MapValue, NodeSpec, Reference
from tree_harness import Stage, scene

POSITION = Position(file="a.yaml", line=7, column=3)


class Nod(py_trees.behaviour.Behaviour):
    """Nods so many times, once a tick."""

    made: list[Nod]

    def __init__(self, name: str, times: int = 1, **more: object) -> None:
        super().__init__(name)
        self.times = times
        self.more = more
        self.calls: list[str] = []
        Nod.made.append(self)

    def setup(self, **kwargs: Any) -> None:
        self.calls.append(f"setup {kwargs}")

    def initialise(self) -> None:
        self.calls.append("initialise")

    def update(self) -> Status:
        self.times -= 1
        self.feedback_message = f"{self.times} to go"
        return Status.RUNNING if self.times else Status.SUCCESS

    def terminate(self, new_status: Status) -> None:
        self.calls.append(f"terminate {new_status.name}")

    def shutdown(self) -> None:
        self.calls.append("shutdown")


@pytest.fixture(autouse=True)
def no_nods() -> None:
    Nod.made = []


def plugged(kind: type, path: str = "tree", **fields: object) -> NodeSpec:
    return NodeSpec(
        path=path,
        position=POSITION,
        kind="nod",
        name="nod twice",
        fields=fields,  # type: ignore[arg-type]
        plugin=kind,
    )


def repeated(spec: NodeSpec, times: int) -> NodeSpec:
    return NodeSpec(
        path="tree@repeat",
        position=POSITION,
        kind="repeat",
        name="repeat",
        fields={"times": Literal(value=times)},
        children=(spec,),
    )


def test_a_plug_in_is_set_up_ticked_and_shut_down() -> None:
    stage = Stage(plugged(Nod, times=Literal(value=2)))
    assert stage.tick() == "running"
    assert stage.reports("tree") == [("RUNNING", "1 to go")]
    assert stage.tick() == "succeeded"
    [nod] = Nod.made
    assert nod.name == "nod twice"
    assert nod.calls == ["setup {}", "initialise", "terminate SUCCESS", "shutdown"]


def test_each_start_makes_a_new_object_from_what_the_fields_mean_then() -> None:
    stage = Stage(
        repeated(
            plugged(
                Nod, mood=Reference(name="live.mood"), happy=parse_expression("live.mood > 3")
            ),
            2,
        )
    )
    stage.tick()
    stage.set_mood(4.0)
    assert stage.tick() == "succeeded"
    assert [nod.more for nod in Nod.made] == [
        {"mood": 3.0, "happy": False},
        {"mood": 4.0, "happy": True},
    ]


def test_an_interrupted_plug_in_is_stopped_and_made_anew() -> None:
    stage = Stage(plugged(Nod, times=Literal(value=3)))
    stage.tick()
    stage.interrupt()
    assert Nod.made[0].calls[-2:] == ["terminate INVALID", "shutdown"]
    assert stage.tick(3) == "succeeded"
    assert len(Nod.made) == 2


def test_a_cancel_stops_a_plug_in() -> None:
    stage = Stage(plugged(Nod, times=Literal(value=3)))
    stage.tick()
    stage.run.cancel("enough")
    assert stage.outcome == "cancelled"
    assert Nod.made[0].status is Status.INVALID


def test_a_plug_in_gets_copies_and_no_way_into_the_run() -> None:
    given = {"list": [1, 2]}
    stage = Stage(
        repeated(
            plugged(
                Nod, data=Literal(value=given), more=MapValue(items={"a": ListValue(items=())})
            ),
            2,
        )
    )
    stage.tick()
    [nod] = Nod.made
    assert nod.parent is None
    assert nod not in list(stage.root.iterate())
    nod.more["data"]["list"].append(3)  # type: ignore[index]
    assert given == {"list": [1, 2]}
    assert nod.more["more"] == {"a": ()}


def broken(place: str, error: BaseException) -> type:
    class Broken(Nod):
        def __init__(self, name: str) -> None:
            if place == "init":
                raise error
            super().__init__(name, times=2)

    def fail(*_args: object, **_kwargs: object) -> Status:
        raise error

    if place != "init":
        setattr(Broken, place, fail)
    return Broken


@pytest.mark.parametrize("place", ["init", "setup", "initialise", "update", "tick"])
@pytest.mark.parametrize("error", [RuntimeError("no nerve"), SystemExit(3), KeyError("x")])
def test_whatever_a_plug_in_raises_is_a_failure_with_path_and_place(
    place: str, error: BaseException
) -> None:
    stage = Stage(plugged(broken(place, error)))
    assert stage.tick() == "failed"
    assert stage.message.endswith("(tree, a.yaml:7:3)")
    words = {
        RuntimeError: "RuntimeError: no nerve",
        KeyError: "KeyError: 'x'",
        SystemExit: "the plug-in wanted to end the program",
    }
    assert stage.message.startswith(words[type(error)])
    assert all("shutdown" in nod.calls for nod in Nod.made)


def blocking(place: str) -> type:
    class Blocking(Nod):
        def __init__(self, name: str) -> None:
            if place == "init":
                time.sleep(60.0)
            super().__init__(name, times=2)

    def block(*_args: object, **_kwargs: object) -> Status:
        time.sleep(60.0)
        return Status.SUCCESS

    def block_in_a_tick(_self: object) -> Iterator[object]:
        yield block()

    if place != "init":
        setattr(Blocking, place, block_in_a_tick if place == "tick" else block)
    return Blocking


@pytest.mark.parametrize("place", ["init", "setup", "initialise", "update", "tick"])
def test_a_plug_in_that_blocks_is_a_failure_with_path_and_place(place: str) -> None:
    stage = Stage(plugged(blocking(place)))
    began = time.monotonic()
    assert stage.tick() == "failed"
    assert time.monotonic() - began < 30.0
    assert stage.message == "blocked for more than 0.25 s (tree, a.yaml:7:3)"
    assert all("shutdown" in nod.calls for nod in Nod.made)


@pytest.mark.parametrize("place", ["terminate", "shutdown", "stop"])
def test_a_plug_in_that_blocks_at_its_end_does_not_hold_up_the_end(place: str) -> None:
    stage = Stage(plugged(blocking(place)))
    stage.tick()
    stage.run.cancel("enough")
    assert stage.outcome == "cancelled"
    assert "blocked for more than 0.25 s (tree, a.yaml:7:3)" in stage.root.feedback_message


def test_what_has_blocked_once_gets_less_time_to_block_again() -> None:
    class Crowd(py_trees.composites.Sequence):
        def __init__(self, name: str) -> None:
            children = [blocking("shutdown")(f"{number}") for number in range(20)]
            super().__init__(name, memory=True, children=children)

    stage = Stage(plugged(Crowd))
    stage.tick()
    began = time.monotonic()
    stage.run.cancel("enough")
    assert stage.outcome == "cancelled"
    assert time.monotonic() - began < 20 * 0.25


def test_an_exception_that_is_no_error_is_a_failure_too() -> None:
    stage = Stage(plugged(broken("update", asyncio.CancelledError("told so"))))
    assert stage.tick() == "failed"
    assert stage.message == "the plug-in raised CancelledError: told so (tree, a.yaml:7:3)"


def test_a_message_as_long_as_it_likes_is_cut() -> None:
    class Talker(Nod):
        def update(self) -> Status:
            self.feedback_message = "x" * 10_000_000
            return Status.FAILURE

    stage = Stage(plugged(Talker))
    assert stage.tick() == "failed"
    assert len(stage.message) == 500


@pytest.mark.parametrize("place", ["terminate", "shutdown", "stop"])
def test_a_plug_in_that_raises_at_its_end_does_not_disturb_the_end(place: str) -> None:
    stage = Stage(plugged(broken(place, RuntimeError("no nerve"))))
    stage.tick()
    stage.run.cancel("enough")
    assert stage.outcome == "cancelled"
    assert stage.root.feedback_message == "RuntimeError: no nerve (tree, a.yaml:7:3)"


def test_a_plug_in_that_takes_other_fields_is_a_failure() -> None:
    class Bare(py_trees.behaviours.Success):
        def __init__(self, name: str) -> None:
            super().__init__(name)

    stage = Stage(plugged(Bare, depth=Literal(value=1)))
    assert stage.tick() == "failed"
    assert "unexpected keyword argument 'depth'" in stage.message


def test_a_field_without_a_value_is_a_failure_and_nothing_is_made() -> None:
    stage = Stage(plugged(Nod, age=Reference(name="scene.age")), awarded=scene(mood=3))
    assert stage.tick() == "failed"
    assert "'scene.age' has no value" in stage.message
    assert Nod.made == []


@pytest.mark.parametrize("made", [dict, lambda name: 5])
def test_what_is_no_behaviour_is_a_failure(made: Any) -> None:
    stage = Stage(plugged(made))
    assert stage.tick() == "failed"
    assert "expected a py_trees Behaviour" in stage.message


def test_a_tick_without_a_status_is_a_failure() -> None:
    class Dazed(Nod):
        def update(self) -> Status:
            return Status.INVALID

    stage = Stage(plugged(Dazed))
    assert stage.tick() == "failed"
    assert "expected RUNNING, SUCCESS or FAILURE" in stage.message
    assert "shutdown" in Nod.made[0].calls


def test_behaviours_that_come_with_py_trees_are_leaves_too() -> None:
    stage = Stage(repeated(plugged(py_trees.behaviours.Success), 2))
    assert stage.tick(2) == "succeeded"
    stage = Stage(plugged(py_trees.behaviours.Failure))
    assert stage.tick() == "failed"
    assert stage.message == "failure"


def test_the_children_of_a_composite_plug_in_are_set_up_and_shut_down_too() -> None:
    class Pair(py_trees.composites.Sequence):
        def __init__(self, name: str) -> None:
            super().__init__(name, memory=True, children=[Nod("a"), Nod("b")])

    stage = Stage(plugged(Pair))
    assert stage.tick() == "succeeded"
    for nod in Nod.made:
        assert nod.calls[0] == "setup {}"
        assert nod.calls[-1] == "shutdown"


def test_a_plug_in_is_ticked_by_py_trees_itself() -> None:
    callers = []

    class Curious(Nod):
        def update(self) -> Status:
            callers.append(Path(sys._getframe(1).f_code.co_filename).parent.name)
            return super().update()

    assert Stage(plugged(Curious)).tick() == "succeeded"
    assert callers == ["py_trees"]


def test_a_plug_in_with_a_way_of_its_own_to_be_ticked_keeps_it() -> None:
    class Twice(Nod):
        def tick_once(self) -> None:
            super().tick_once()
            super().tick_once()

    stage = Stage(plugged(Twice, times=Literal(value=2)))
    assert stage.tick() == "succeeded"


def test_a_plug_in_that_ends_the_program_does_not() -> None:
    class Quitter(Nod):
        def update(self) -> Status:
            sys.exit(1)

    stage = Stage(plugged(Quitter))
    assert stage.tick() == "failed"
