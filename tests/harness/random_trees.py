# SPDX-License-Identifier: Apache-2.0
"""Random trees of all node types, in the form that the reader gives the engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import py_trees
from hypothesis import strategies as st
from py_trees.common import Status

from bt_agents_core.diagnostic import Position
from bt_agents_core.field_types import BindingKind
from bt_agents_language.expression.expressions import Expression, parse_expression
from bt_agents_language.model.specs import (
    Binding,
    Computed,
    Literal,
    MapValue,
    NodeSpec,
    Reference,
    SkillSpec,
    Text,
    Value,
)

ACTIONS = ("act0", "act1", "act2")
CONDITIONS = ("true", "false", "live.mood > 2", "live.age > 2", "1 / live.mood > 0", "word == 'a'")
POSITION = Position(file="random.yaml", line=1, column=1)


class ScriptedLeaf(py_trees.behaviour.Behaviour):
    """Leaf that ends in a given way after a given number of ticks; ``crash`` raises instead.

    Attributes:
        alive: Leaves of the current example that have started and not ended.
        set_up: Leaves that are set up and not shut down.
    """

    alive: set[ScriptedLeaf]
    set_up: set[ScriptedLeaf]

    def __init__(self, name: str, ticks: int, end: str) -> None:
        super().__init__(name)
        self.ticks = self.left = ticks
        self.end = end

    def setup(self, **_kwargs: object) -> None:
        ScriptedLeaf.set_up.add(self)

    def initialise(self) -> None:
        self.left = self.ticks
        ScriptedLeaf.alive.add(self)

    def update(self) -> Status:
        self.left -= 1
        if self.left >= 0:
            return Status.RUNNING
        if self.end == "crash":
            raise RuntimeError("strings torn")
        return Status[self.end]

    def terminate(self, new_status: Status) -> None:
        ScriptedLeaf.alive.discard(self)

    def shutdown(self) -> None:
        ScriptedLeaf.set_up.discard(self)


def _node(kind: str, /, *children: NodeSpec, **fields: Value | Expression) -> NodeSpec:
    return NodeSpec(
        path="", position=POSITION, kind=kind, name=kind, fields=fields, children=children
    )


def placed(spec: NodeSpec, path: str = "tree") -> NodeSpec:
    """Return the tree with a unique path for every node."""
    children = tuple(
        placed(child, f"{path}/{index}.{child.kind}") for index, child in enumerate(spec.children)
    )
    return replace(spec, path=path, children=children)


conditions = st.sampled_from([parse_expression(text) for text in CONDITIONS])
seconds: st.SearchStrategy[Value] = st.one_of(
    st.sampled_from([0.0, 0.5, 1.0, 3.0]).map(lambda value: Literal(value=value)),
    st.just(Reference(name="rest")),
    st.just(Computed(expression=parse_expression("rest * 2"))),
)
counts: st.SearchStrategy[Value] = st.one_of(
    st.sampled_from([1, 2, 3, "forever"]).map(lambda value: Literal(value=value)),
    st.just(Reference(name="times")),
)
left_out = st.sampled_from(["success", "failure"]).map(lambda word: Literal(value=word))
weights: st.SearchStrategy[Value] = st.one_of(
    st.sampled_from([0, 1.0, 2.5]).map(lambda value: Literal(value=value)),
    st.just(Reference(name="rest")),
)


def _skill(name: str, kind: BindingKind) -> NodeSpec:
    binding = Binding(kind=kind, name=name, type="p/action/T", fields=MapValue(items={}))
    skill = SkillSpec(
        name=name,
        description="",
        main=None,
        inputs=(),
        outputs=(),
        binding=binding,
        position=POSITION,
    )
    return replace(_node("action"), skill=skill, outputs={"word": "word"})


def _feedback(kind: str) -> NodeSpec:
    values = MapValue(items={"mood": Reference(name="rest")})
    return _node("give_feedback", kind=Literal(value=kind), values=values)


def _message(condition: Expression | None, hold: Value) -> NodeSpec:
    fields: dict[str, Value | Expression] = {
        "topic": Literal(value="t"),
        "type": Literal(value="p/msg/T"),
        "for": hold,
    }
    if condition is not None:
        fields["until"] = condition
    return replace(_node("wait_for", **fields), outputs={"word": "word"})


def _puppet(ticks: int, end: str) -> NodeSpec:
    fields = {"ticks": Literal(value=ticks), "end": Literal(value=end)}
    return replace(_node("leaf", **fields), plugin=ScriptedLeaf)


leaves: st.SearchStrategy[NodeSpec] = st.one_of(
    st.builds(_skill, st.sampled_from(ACTIONS), st.sampled_from(BindingKind)),
    st.builds(_puppet, st.integers(0, 2), st.sampled_from(["SUCCESS", "FAILURE", "crash"])),
    conditions.map(lambda condition: _node("check", condition=condition)),
    st.sampled_from(["a", "b"]).map(lambda word: _node("set", word=Literal(value=word))),
    seconds.map(lambda duration: _node("wait", duration=duration)),
    st.builds(
        lambda c, hold: _node("wait_for", condition=c, **{"for": hold}), conditions, seconds
    ),
    st.builds(_message, st.sampled_from([None, parse_expression("msg.data > 1")]), seconds),
    st.just(_node("log", message=Text(parts=("so ", Reference(name="word"))))),
    st.sampled_from(["positive", "negative", "direct"]).map(_feedback),
)


def _parallel(children: list[NodeSpec], succeed_on: object) -> NodeSpec:
    if isinstance(succeed_on, tuple):
        succeed_on = tuple(place for place in succeed_on if place < len(children)) or "all"
    return _node("parallel", *children, succeed_on=Literal(value=succeed_on))  # type: ignore[arg-type]


def _choose(cases: list[tuple[NodeSpec, Expression | None]]) -> NodeSpec:
    return _node(
        "choose",
        *(
            _node("case", child, **({} if condition is None else {"condition": condition}))
            for child, condition in cases
        ),
    )


def _random(choices: list[tuple[NodeSpec, Value]], seed: int | None) -> NodeSpec:
    fields = {} if seed is None else {"seed": Literal(value=seed)}
    children = (_node("weight", child, weight=weight) for child, weight in choices)
    return _node("random", *children, **fields)


def _repeat(child: NodeSpec, times: Value, until: Expression | None, pause: Value) -> NodeSpec:
    fields = {} if until is None else {"until": until}
    return _node("repeat", child, times=times, pause=pause, **fields)


def _around(node: st.SearchStrategy[NodeSpec]) -> st.SearchStrategy[NodeSpec]:
    several = st.lists(node, min_size=1, max_size=4)
    memory = st.booleans().map(lambda value: Literal(value=value))
    build: Callable[..., st.SearchStrategy[NodeSpec]] = st.builds
    return st.one_of(
        build(lambda c, m: _node("sequence", *c, memory=m), several, memory),
        build(lambda c, m: _node("selector", *c, memory=m), several, memory),
        build(_parallel, several, st.sampled_from(["all", "one", 1, 2, 3, (0,), (0, 2)])),
        build(_choose, st.lists(st.tuples(node, conditions | st.none()), min_size=1, max_size=3)),
        build(
            _random,
            st.lists(st.tuples(node, weights), min_size=1, max_size=3),
            st.none() | st.integers(0, 9),
        ),
        build(
            lambda c, o, w: _node("when", c, condition=w, otherwise=o), node, left_out, conditions
        ),
        build(lambda c, o: _node("once", c, otherwise=o), node, left_out),
        build(
            lambda c, o, d: _node("cooldown", c, duration=d, otherwise=o), node, left_out, seconds
        ),
        build(lambda c: _node("succeed", c), node),
        build(lambda c: _node("fail", c), node),
        build(lambda c, w: _node("while", c, condition=w), node, conditions),
        build(lambda c, h: _node("on_failure", c, h), node, node),
        build(lambda c, n, p: _node("retry", c, attempts=n, pause=p), node, counts, seconds),
        build(_repeat, node, counts, st.none() | conditions, seconds),
        build(lambda c, limit: _node("timeout", c, limit=limit), node, seconds),
        build(lambda c: _node("invert", c), node),
        build(lambda c: replace(_node("subtree", c), outputs={"word": "word"}), node),
    )


trees = st.recursive(leaves, _around, max_leaves=12).map(placed)
