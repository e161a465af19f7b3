# SPDX-License-Identifier: Apache-2.0
"""Laws of the ticker: our nodes behave like py_trees', and report every change."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import count
from random import Random
from typing import Any

from py_trees import composites, decorators
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.light_behaviour import LightBehaviour
from bt_agents.engine.loops import Loop
from bt_agents.engine.run import BEHAVIOURS
from bt_agents.engine.scripted_environment import ScriptedEnvironment
from bt_agents.engine.ticker import Ticker
from bt_agents_core.diagnostic import Position
from bt_agents_language.model.specs import Literal, NodeSpec

TREES = 3_000
TICKS = 20
SEED = 20_261_121

INVALID = Status.INVALID
# Rarely an error.
ANSWERS = [Status.SUCCESS] * 50 + [Status.FAILURE] * 40 + [Status.RUNNING] * 60 + [RuntimeError]


@dataclass
class Plan:
    """Plan of a node and its descendants, which can be built several times.

    Attributes:
        name: Unique in the tree.
        kind: Key of its node type; ``leaf`` for a leaf.
        children: Plans of its children.
        script: Answers of a leaf, repeated for ever.
        setting: Memory of a composite, count that a parallel needs, or rounds of a loop.
    """

    name: str
    kind: str
    children: list[Plan] = field(default_factory=list)
    script: list[object] = field(default_factory=list)
    setting: Any = None


class Scripted:
    """Methods of a leaf with scripted answers; each of its messages is a new string."""

    def __init__(self: Any, plan: Plan, calls: list[tuple[str, ...]]) -> None:
        super().__init__(plan.name)
        self.plan = plan
        self.calls = calls
        self.place = 0

    def initialise(self: Any) -> None:
        self.calls.append((self.name, "initialise", self.status.name))

    def update(self: Any) -> Status:
        answer: Any = self.plan.script[self.place % len(self.plan.script)]
        self.place += 1
        self.calls.append((self.name, "update", self.status.name))
        self.feedback_message = f"said {self.place // 4}"
        if answer is RuntimeError:
            raise RuntimeError(self.name)
        return answer  # type: ignore[no-any-return]

    def terminate(self: Any, new_status: Status) -> None:
        # A decorator of py_trees also ends children that have not begun.
        if self.status is not INVALID or new_status is not INVALID:
            self.calls.append((self.name, "terminate", self.status.name, new_status.name))


class StockLeaf(Scripted, Behaviour):
    pass


class OurLeaf(Scripted, LightBehaviour):
    pass


def planned(draw: Random, size: int) -> Plan:
    """Return a random tree of about ``size`` nodes."""
    numbers = count(1)

    def node(depth: int) -> Plan:
        number = next(numbers)
        name, left = str(number), size - number
        if left <= 0 or depth > 6 or (depth and draw.random() < 0.3):
            return Plan(name, "leaf", script=draw.choices(ANSWERS, k=draw.randint(1, 5)))
        if draw.random() < 0.4:
            kind = draw.choice(["invert", "succeed", "fail", "retry", "repeat"])
            return Plan(name, kind, [node(depth + 1)], setting=draw.randint(1, 3))
        width = min(draw.choice((1, 2, 2, 3, 3, 4)), left)
        children = [node(depth + 1) for _ in range(width)]
        kind = draw.choice(["sequence"] * 3 + ["selector"] * 3 + ["parallel"])
        setting: Any = draw.random() < 0.5
        if kind == "parallel":
            places = draw.sample(range(width), draw.randint(1, width))
            setting = "all" if draw.random() < 0.5 else tuple(places)
        return Plan(name, kind, children, setting=setting)

    return node(0)


def stock(plan: Plan, calls: list[tuple[str, ...]]) -> Behaviour:
    """Return the tree of py_trees' own classes."""
    children = [stock(child, calls) for child in plan.children]
    match plan.kind:
        case "leaf":
            return StockLeaf(plan, calls)
        case "sequence":
            return composites.Sequence(plan.name, plan.setting, children)
        case "selector":
            return composites.Selector(plan.name, plan.setting, children)
        case "parallel" if plan.setting == "all":
            policy = ParallelPolicy.SuccessOnAll(synchronise=True)
            return composites.Parallel(plan.name, policy, children)
        case "parallel":
            needed = [children[place] for place in plan.setting]
            policy = ParallelPolicy.SuccessOnSelected(needed, synchronise=True)
            return composites.Parallel(plan.name, policy, children)
        case "retry":
            return decorators.Retry(plan.name, children[0], plan.setting)
        case "repeat":
            return decorators.Repeat(plan.name, children[0], plan.setting)
        case kind:
            classes = {
                "invert": decorators.Inverter,
                "succeed": decorators.FailureIsSuccess,
                "fail": decorators.SuccessIsFailure,
            }
            return classes[kind](plan.name, children[0])


FIELDS = {
    "sequence": "memory",
    "selector": "memory",
    "parallel": "succeed_on",
    "retry": "attempts",
    "repeat": "times",
}


def ours(plan: Plan, calls: list[tuple[str, ...]]) -> Behaviour:
    """Return the tree of our classes."""
    nothing: Any = None
    context = RunContext(ScriptedEnvironment(), nothing, Random(1))

    def made(plan: Plan) -> Behaviour:
        if plan.kind == "leaf":
            return OurLeaf(plan, calls)
        children = iter(plan.children)
        fields = {FIELDS[plan.kind]: Literal(value=plan.setting)} if plan.kind in FIELDS else {}
        spec = NodeSpec(
            path=plan.name,
            position=Position(file="a.yaml", line=1, column=1),
            kind=plan.kind,
            name=plan.name,
            fields=fields,
            children=(nothing,) * len(plan.children),
        )
        return BEHAVIOURS[plan.kind](spec, context, nothing, lambda _, __: made(next(children)))

    return made(plan)


def _shown(nodes: Iterable[Behaviour], *, tips: bool) -> list[object]:
    """Return the state of nodes in py_trees, as far as both kinds of trees agree on it."""
    return [
        (
            node.name,
            node.status,
            node.feedback_message if isinstance(node, Scripted) else "",
            _name(getattr(node, "current_child", None)) if tips else "",
            _name(node.tip()) if tips else "",
        )
        for node in nodes
    ]


def _name(node: Behaviour | None) -> str:
    return "" if node is None else node.name


def _error_of(call: Callable[[], object]) -> str:
    """Return the error of a call, or None."""
    try:
        call()
    except Exception as error:
        return repr(error)
    return ""


def test_nodes_match_py_trees_tick_for_tick() -> None:
    chance = Random(SEED)
    for number in range(TREES):
        plan = planned(chance, chance.choice((2, 4, 6, 8, 8, 10, 12, 15, 30)))
        stock_calls: list[tuple[str, ...]] = []
        our_calls: list[tuple[str, ...]] = []
        stock_root, our_root = stock(plan, stock_calls), ours(plan, our_calls)
        nodes = list(our_root.iterate())
        # Of several failures in a parallel py_trees names the first, and ours the last; between
        # two rounds the tip of py_trees is below the loop, and ours the loop.
        tips = not any(isinstance(node, (composites.Parallel, Loop)) for node in nodes)
        reported: dict[int, tuple[Status, str]] = {}
        visited: list[str] = []
        answered: list[str] = []
        reporting = chance.random() < 0.7
        ticker = Ticker(
            our_root,
            on_change=_reported(reported) if reporting else None,
            on_visit=lambda node, _, seen=visited: seen.append(node.name),  # type: ignore[misc]
        )
        for tick in range(TICKS):
            where = f"tree {number}, tick {tick}"
            for log in (stock_calls, our_calls, visited, answered):
                log.clear()
            if chance.random() < 0.04:
                stock_root.stop(INVALID)
                ticker.halt()
                error = ""
            else:
                walk = (node.name for node in stock_root.tick())
                error = _error_of(lambda: answered.extend(walk))  # noqa: B023
                assert _error_of(ticker.tick) == error, where
            assert stock_calls == our_calls, where
            if error:
                # An exception in a leaf ends the use of the tree: leaves of agents never raise.
                break
            assert visited == answered, where
            assert _shown(stock_root.iterate(), tips=tips) == _shown(nodes, tips=tips), where
            if reporting:
                for node in nodes:
                    status, message = reported.get(id(node), (INVALID, ""))
                    assert status is node.status, where
                    assert status is INVALID or message == node.feedback_message, where


def _reported(reported: dict[int, tuple[Status, str]]) -> Callable[[Behaviour], None]:
    def report(node: Behaviour) -> None:
        new = (node.status, node.feedback_message)
        assert reported.get(id(node)) != new
        reported[id(node)] = new

    return report


def _balanced(levels: int) -> Plan:
    """Return levels of sequences of ten; all their leaves succeed."""
    if not levels:
        return Plan("leaf", "leaf", script=[Status.SUCCESS])
    children = [_balanced(levels - 1) for _ in range(10)]
    return Plan("s", "sequence", children, setting=True)


def _calls(call: Callable[[], object]) -> int:
    """Return how many Python or C calls a call makes."""
    calls = 0

    def count(_frame: object, event: str, _arg: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    # Objects collected meanwhile have finalizers of other code.
    gc.disable()
    sys.setprofile(count)
    try:
        call()
    finally:
        sys.setprofile(None)
        gc.enable()
    return calls


def test_tick_cost_scales_with_visited_nodes() -> None:
    costs = []
    for levels in (1, 2, 3):
        root = ours(_balanced(levels), [])
        last = [node for node in root.iterate() if isinstance(node, OurLeaf)][-1]
        last.update = lambda: Status.RUNNING  # type: ignore[method-assign]
        reported: list[Behaviour] = []
        ticker = Ticker(root, on_change=reported.append)
        ticker.tick()
        reported.clear()
        costs.append(_calls(ticker.tick))
        assert reported == []
    assert costs[2] - costs[1] == costs[1] - costs[0] < 5
