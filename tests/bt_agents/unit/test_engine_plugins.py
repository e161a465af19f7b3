# SPDX-License-Identifier: Apache-2.0
"""Plug-in behaviours as leaves: one object per run, isolated, and never fatal."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, ClassVar

import py_trees
import pytest
from py_trees.common import Status

from bt_agents.engine.nodes import plugin
from bt_agents_core.diagnostic import Position
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.model.specs import ListValue, Literal, MapValue, NodeSpec, Reference
from tree_harness import TreeHarness, failure, scene, started

POSITION = Position(file="a.yaml", line=7, column=3)
OWN_LIMIT_S = plugin.BLOCKS_S


class Nod(py_trees.behaviour.Behaviour):
    """Nods a number of times, once a tick."""

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
def long_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit for calls that is met on a busy machine, too."""
    monkeypatch.setattr(plugin, "BLOCKS_S", 30.0)
    Nod.made = []


def plugged(kind: type, **fields: object) -> NodeSpec:
    return NodeSpec(
        path="tree",
        position=POSITION,
        kind="nod",
        name="nod twice",
        fields=fields,  # type: ignore[arg-type]
        plugin=kind,
    )


def repeated(spec: NodeSpec, times: int) -> NodeSpec:
    return around(spec, "repeat", times=Literal(value=times))


def around(spec: NodeSpec, kind: str, **fields: Literal) -> NodeSpec:
    return NodeSpec(
        path=f"tree@{kind}",
        position=POSITION,
        kind=kind,
        name=kind,
        fields=fields,
        children=(spec,),
    )


def test_changed_fields_create_new_plugin_at_start() -> None:
    happy = parse_expression("live.mood > 3")
    harness = started(repeated(plugged(Nod, mood=Reference(name="live.mood"), happy=happy), 2))
    harness.set_mood(4.0)
    assert harness.tick() == "succeeded"
    assert [nod.more for nod in Nod.made] == [
        {"mood": 3.0, "happy": False},
        {"mood": 4.0, "happy": True},
    ]


def test_interrupted_plugin_is_terminated_and_reinitialised() -> None:
    harness = started(plugged(Nod, times=Literal(value=3)))
    assert harness.reports("tree") == [("RUNNING", "2 to go")]
    harness.interrupt()
    assert Nod.made[0].calls == ["setup {}", "initialise", "terminate INVALID"]
    assert harness.tick(2) == "succeeded"
    [nod] = Nod.made
    assert nod.name == "nod twice"
    assert nod.calls[3:] == ["initialise", "terminate SUCCESS", "shutdown"]


def test_plugin_is_set_up_once_per_run() -> None:
    harness = TreeHarness(repeated(plugged(Again), 300))
    assert harness.tick(300) == "succeeded"
    [nod] = Nod.made
    counts = [nod.calls.count(call) for call in ("setup {}", "initialise", "shutdown")]
    assert counts == [1, 300, 1]


class Again(Nod):
    def initialise(self) -> None:
        super().initialise()
        self.times = 1


def test_failed_plugin_is_shut_down_and_recreated() -> None:
    class Unlucky(Again):
        def update(self) -> Status:
            if len(Nod.made) < 3:
                raise RuntimeError("no luck")
            return super().update()

    retried = around(plugged(Unlucky), "retry", attempts=Literal(value=3))
    assert TreeHarness(retried).tick(3) == "succeeded"
    assert [nod.calls[-1] for nod in Nod.made] == ["shutdown"] * 3


@pytest.mark.parametrize("place", ["setup", "update"])
def test_first_of_several_errors_is_reported(place: str) -> None:
    class Broken(broken(place, RuntimeError("the first"))):  # type: ignore[misc]
        def shutdown(self) -> None:
            raise RuntimeError("the second")

        def terminate(self, new_status: Status) -> None:
            raise RuntimeError("the third")

    harness = started(plugged(Broken))
    assert harness.message == "RuntimeError: the first (tree, a.yaml:7:3)"
    assert harness.root.feedback_message == harness.message


def test_blackboard_keys_map_to_names_and_are_removed() -> None:
    class Doubler(Nod):
        reads: ClassVar = {"/their/mood": "mood"}

        def __init__(self, name: str) -> None:
            super().__init__(name)
            board = self.board = self.attach_blackboard_client(namespace="their")
            board.register_key("mood", py_trees.common.Access.READ)
            board.register_key("twice", py_trees.common.Access.WRITE)
            board.register_key("own", py_trees.common.Access.WRITE)

        def update(self) -> Status:
            self.board.twice = [2 * self.board.mood]
            self.board.own = object()
            return Status.RUNNING if self.board.mood < 4 else Status.SUCCESS

    spec = replace(
        plugged(Doubler, mood=Reference(name="live.mood")), outputs={"doubled": "/their/twice"}
    )
    harness = started(spec)
    assert harness.run.scope.lookup("doubled") == [6.0]
    harness.set_mood(4.0)
    assert harness.tick() == "succeeded"
    assert harness.run.scope.lookup("doubled") == [8.0]
    keys = py_trees.blackboard.Blackboard.keys()
    assert not [key for key in keys if key.startswith("/their")]
    assert not harness.environment.logged


@pytest.mark.parametrize("place", ["init", "setup", "initialise", "update", "shutdown"])
def test_unattached_blackboard_client_is_removed(place: str) -> None:
    harness = TreeHarness(plugged(registering(place)))
    assert harness.tick(2) == "succeeded"
    assert_unregistered("/loose", "loose")


def test_failed_making_removes_blackboard_clients() -> None:
    class Halfway(registering("init")):  # type: ignore[misc]
        def __init__(self, name: str) -> None:
            super().__init__(name)
            raise RuntimeError("no nerve")

    assert TreeHarness(plugged(Halfway)).tick() == "failed"
    assert_unregistered("/loose", "loose")


def test_clients_of_others_stay() -> None:
    other = py_trees.blackboard.Client(name="other")
    other.register_key("/loose", py_trees.common.Access.READ)
    try:
        assert TreeHarness(plugged(registering("init"))).tick(2) == "succeeded"
        assert other.loose == 5
        assert "other" in py_trees.blackboard.Blackboard.clients.values()
    finally:
        other.unregister()


def registering(place: str) -> type:
    """Return a class whose method keeps a blackboard client outside its attributes."""

    def register() -> Status:
        board = py_trees.blackboard.Client(name="loose")
        board.register_key("/loose", py_trees.common.Access.WRITE)
        board.set("/loose", 5)
        return Status.SUCCESS

    return misbehaving(place, register)


def assert_unregistered(key: str, client: str) -> None:
    board = py_trees.blackboard.Blackboard
    assert key not in board.storage | board.metadata
    assert client not in board.clients.values()


def test_non_plain_data_does_not_leave_blackboard() -> None:
    def leak() -> Status:
        py_trees.blackboard.Blackboard.set("leak", object())
        return Status.SUCCESS

    message = failure(replace(plugged(misbehaving("update", leak)), outputs={"leak": "leak"}))
    assert "put a object on the blackboard as 'leak', expected a message" in message
    assert not py_trees.blackboard.Blackboard.exists("leak")


def test_plugin_gets_copies_without_access_to_run() -> None:
    given = {"list": [1, 2]}
    more = MapValue(items={"a": ListValue(items=())})
    harness = started(repeated(plugged(Nod, data=Literal(value=given), more=more), 2))
    [nod] = Nod.made
    assert nod.parent is None
    assert nod not in list(harness.root.iterate())
    nod.more["data"]["list"].append(3)  # type: ignore[index]
    assert given == {"list": [1, 2]}
    assert nod.more["more"] == {"a": ()}


def misbehaving(place: str, act: Callable[[], Status]) -> type:
    """Return a class with one method replaced."""

    class Misbehaving(Nod):
        def __init__(self, name: str) -> None:
            if place == "init":
                act()
            super().__init__(name, times=2)

    def instead(*_args: object, **_kwargs: object) -> Status:
        return act()

    def ticked(_self: object) -> Iterator[object]:
        yield act()

    if place != "init":
        setattr(Misbehaving, place, ticked if place == "tick" else instead)
    return Misbehaving


def broken(place: str, error: BaseException) -> type:
    def fail() -> Status:
        raise error

    return misbehaving(place, fail)


def blocking(place: str) -> type:
    return misbehaving(place, lambda: time.sleep(60.0) or Status.SUCCESS)


@pytest.mark.parametrize("place", ["init", "setup", "initialise", "update", "tick"])
@pytest.mark.parametrize(
    ("error", "words"),
    [
        (RuntimeError("no nerve"), "RuntimeError: no nerve"),
        (SystemExit(3), "the plug-in wanted to end the program"),
        (KeyError("x"), "KeyError: 'x'"),
        (asyncio.CancelledError("so"), "the plug-in raised CancelledError: so"),
    ],
)
def test_raising_plugin_fails_with_path_and_position(
    place: str, error: BaseException, words: str
) -> None:
    message = failure(plugged(broken(place, error)))
    assert message.startswith(words)
    assert message.endswith("(tree, a.yaml:7:3)")
    assert all("shutdown" in nod.calls for nod in Nod.made)


@pytest.mark.parametrize("place", ["init", "setup", "initialise", "update", "tick"])
def test_blocking_plugin_fails_with_path_and_position(
    place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugin, "BLOCKS_S", OWN_LIMIT_S)
    began = time.monotonic()
    message = failure(plugged(blocking(place)))
    assert time.monotonic() - began < 30.0
    assert message == "blocked for more than 0.25 s (tree, a.yaml:7:3)"
    assert all("shutdown" in nod.calls for nod in Nod.made)


def messages_of_cancel(kind: type, limit_s: float) -> list[str]:
    """Cancel a run of a plug-in; return its last message and the lines of the log."""
    harness = started(plugged(kind))
    harness.root._limit_s = limit_s
    harness.run.cancel("enough")
    assert harness.outcome == "cancelled"
    return [harness.root.feedback_message, *(text for _, text in harness.environment.logged)]


@pytest.mark.parametrize("place", ["terminate", "shutdown", "stop"])
def test_plugin_blocking_in_shutdown_does_not_delay_end(place: str) -> None:
    told = messages_of_cancel(blocking(place), OWN_LIMIT_S)
    assert any("blocked for more than 0.25 s (tree, a.yaml:7:3)" in text for text in told)


def test_plugin_that_blocked_gets_shorter_limit() -> None:
    class Crowd(py_trees.composites.Sequence):
        def __init__(self, name: str) -> None:
            children = [blocking("shutdown")(f"{number}") for number in range(20)]
            super().__init__(name, memory=True, children=children)

    began = time.monotonic()
    messages_of_cancel(Crowd, OWN_LIMIT_S)
    assert time.monotonic() - began < 20 * 0.25


def test_long_plugin_message_is_truncated() -> None:
    class Talker(Nod):
        def update(self) -> Status:
            self.feedback_message = "x" * 10_000_000
            return Status.FAILURE

    assert len(failure(plugged(Talker))) == 500


def test_error_of_plugin_is_short_and_printable() -> None:
    class Loud(Nod):
        def update(self) -> Status:
            raise RuntimeError("\x1b[31mred\nblue" + "x" * 10_000_000)

    words = failure(plugged(Loud))
    assert words.startswith("RuntimeError: \\x1b[31mred\\nbluexx")
    assert words.endswith("x… (tree, a.yaml:7:3)")
    assert len(words) < 600


@pytest.mark.parametrize("place", ["terminate", "shutdown", "stop"])
def test_plugin_raising_in_shutdown_does_not_disturb_end(place: str) -> None:
    told = messages_of_cancel(broken(place, RuntimeError("no nerve")), 30.0)
    assert any(text.endswith("RuntimeError: no nerve (tree, a.yaml:7:3)") for text in told)


def test_field_without_value_fails_before_creating_plugin() -> None:
    message = failure(plugged(Nod, age=Reference(name="scene.age")), awarded=scene(mood=3))
    assert "'scene.age' has no value" in message
    assert Nod.made == []


@pytest.mark.parametrize("made", [dict, lambda name: 5])
def test_plugin_that_is_not_a_behaviour_fails(made: Any) -> None:
    assert "expected a py_trees Behaviour" in failure(plugged(made))


def test_plugin_tick_without_status_fails() -> None:
    dazed = misbehaving("update", lambda: Status.INVALID)
    assert "expected RUNNING, SUCCESS or FAILURE" in failure(plugged(dazed))
    assert "shutdown" in Nod.made[0].calls


def test_composite_plugin_sets_up_and_shuts_down_children() -> None:
    class Pair(py_trees.composites.Sequence):
        def __init__(self, name: str) -> None:
            super().__init__(name, memory=True, children=[Nod("a"), Nod("b")])

    assert TreeHarness(plugged(Pair)).tick() == "succeeded"
    assert [(nod.calls[0], nod.calls[-1]) for nod in Nod.made] == [("setup {}", "shutdown")] * 2


def test_plugin_keeps_its_overridden_tick() -> None:
    class Twice(Nod):
        def tick_once(self) -> None:
            super().tick_once()
            super().tick_once()

    harness = TreeHarness(plugged(Twice, times=Literal(value=2)))
    assert harness.tick() == "succeeded"
