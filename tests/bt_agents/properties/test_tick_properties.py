# SPDX-License-Identifier: Apache-2.0
"""Laws of the ticker: it does to any tree what py_trees does, and tells all that changes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from random import Random
from unittest.mock import patch

from py_trees import blackboard, composites, decorators
from py_trees.behaviour import Behaviour
from py_trees.common import OneShotPolicy, ParallelPolicy, Status

from bt_agents.engine.ticking import CallTicked, Ticker

TREES = 10_000
TICKS = 20
SEED = 20_261_121

SUCCESS, FAILURE, RUNNING, INVALID = (
    Status.SUCCESS,
    Status.FAILURE,
    Status.RUNNING,
    Status.INVALID,
)
# Rarely something that no update may return, or an error.
ANSWERS = [SUCCESS] * 50 + [FAILURE] * 40 + [RUNNING] * 60 + [INVALID, "nonsense", RuntimeError]


@dataclass
class Story:
    """What happens to one copy of a tree.

    Attributes:
        calls: Each call of a node's methods, in order.
        now: Time that passes in ticks [s].
    """

    calls: list[tuple[str, ...]]
    now: float = 0.0


class Scripted(Behaviour):
    """A leaf that answers as written; each of its words is another string."""

    def __init__(self, name: str, story: Story, script: list[object]) -> None:
        super().__init__(name)
        self.story = story
        self.script = script
        self.place = 0
        self.logger.error = lambda words: story.calls.append((name, words))  # type: ignore[method-assign]

    def update(self) -> Status:
        answer = self.script[self.place % len(self.script)]
        self.place += 1
        self.story.calls.append((self.name, "update", self.status.name))
        self.feedback_message = f"said {self.place // 4}"
        if answer is RuntimeError:
            raise RuntimeError(self.name)
        return answer  # type: ignore[return-value]


def noting(kind: type[Behaviour]) -> type[Behaviour]:
    """Return a class whose nodes note when they begin and end, and with which status."""

    class Noting(kind):  # type: ignore[misc, valid-type]
        story: Story

        def initialise(self) -> None:
            self.story.calls.append((self.name, "initialise", self.status.name))
            super().initialise()

        def terminate(self, new_status: Status) -> None:
            said = (self.name, "terminate", self.status.name, new_status.name)
            self.story.calls.append(said)
            super().terminate(new_status)

    return Noting


class Odd(composites.Sequence):
    """A composite of somebody else with a ``tick`` of its own: the last child decides."""

    def tick(self) -> Iterator[Behaviour]:
        for child in self.children:
            yield from child.tick()
        self.current_child = self.children[-1]
        status = self.children[-1].status
        if status is not RUNNING:
            self.stop(status)
        self.status = status
        yield self


class Halting(decorators.Decorator):
    """A decorator of somebody else with a ``stop`` of its own."""

    def update(self) -> Status:
        return self.decorated.status

    def stop(self, new_status: Status) -> None:
        self.feedback_message = f"stopped as {new_status.name}"
        super().stop(new_status)


class Alternating(CallTicked):
    """One that is ticked by plain calls: two children in turn, the others are dropped."""

    def __init__(self, name: str, children: list[Behaviour]) -> None:
        super().__init__(name)
        self.children = children
        self.turns = 0
        for child in children:
            child.parent = self

    def turn(self, tree: Ticker) -> Status:
        if self.status is not RUNNING:
            self.turns += 1
        chosen, other = (
            self.children[turn % len(self.children)] for turn in (self.turns, self.turns + 1)
        )
        for child in self.children:
            if child not in (chosen, other):
                tree.drop_child(child)
        status = tree.tick_child(chosen)
        return status if chosen is other or status is FAILURE else tree.tick_child(other)

    def stop(self, new_status: Status) -> None:
        for child in self.children:
            if new_status is INVALID or child.status is RUNNING:
                child.stop(INVALID)
        super().stop(new_status)


NOTING = {
    kind: noting(kind)
    for kind in (
        Scripted,
        composites.Sequence,
        composites.Selector,
        composites.Parallel,
        Odd,
        decorators.Inverter,
        decorators.Timeout,
        decorators.OneShot,
        decorators.EternalGuard,
        decorators.Retry,
    )
}


class Planter:
    """Makes the same tree twice: it draws from chance alone what is in it.

    Args:
        seed: Of the chance.
        story: Takes what its nodes do.
        size: About how many nodes.
    """

    def __init__(self, seed: int, story: Story, size: int) -> None:
        self.random = Random(seed)
        self.story = story
        self.left = size
        self.count = 0

    def node(self, depth: int = 0) -> Behaviour:
        """Return a node and those below it."""
        self.count += 1
        self.left -= 1
        name = str(self.count)
        if self.left <= 0 or depth > 6 or (depth and self.random.random() < 0.3):
            return self._leaf(name)
        if self.random.random() < 0.6:
            return self._composite(name, depth)
        return self._decorator(name, depth)

    def _kind(self, kind: type[Behaviour]) -> Callable[..., Behaviour]:
        """Return a class, in half of the cases one that notes what it does."""
        if self.random.random() < 0.5 or kind not in NOTING:
            return kind

        def made(*args: object, **settings: object) -> Behaviour:
            node = NOTING[kind](*args, **settings)  # type: ignore[arg-type]
            node.story = self.story  # type: ignore[attr-defined]
            return node

        return made

    def _leaf(self, name: str) -> Behaviour:
        script: list[object] = self.random.choices(ANSWERS, k=self.random.randint(1, 5))
        return self._kind(Scripted)(name, self.story, script)

    def _composite(self, name: str, depth: int) -> Behaviour:
        number = min(self.random.choice((0, 1, 2, 2, 3, 3, 4)), max(self.left, 1))
        children = [self.node(depth + 1) for _ in range(number)]
        kind = self.random.choice("ssssllllppppoa")
        memory = self.random.random() < 0.5
        if kind == "s":
            return self._kind(composites.Sequence)(name, memory, children)
        if kind == "l":
            return self._kind(composites.Selector)(name, memory, children)
        if kind == "o" and children:
            return self._kind(Odd)(name, memory, children)
        if kind == "a" and children:
            return Alternating(name, children)
        return self._kind(composites.Parallel)(name, self._policy(children), children)

    def _policy(self, children: list[Behaviour]) -> ParallelPolicy.Base:
        synchronise = self.random.random() < 0.5
        match self.random.randint(0, 3 if children else 1):
            case 0:
                return ParallelPolicy.SuccessOnAll(synchronise)
            case 1:
                return ParallelPolicy.SuccessOnOne()
            case _:
                some = self.random.sample(children, self.random.randint(1, len(children)))
                return ParallelPolicy.SuccessOnSelected(some, synchronise)

    def _decorator(self, name: str, depth: int) -> Behaviour:
        child = self.node(depth + 1)
        draw = self.random
        kind = draw.choice(DECORATORS)
        settings: dict[str, object] = {}
        match kind:
            case decorators.Retry:
                settings = {"num_failures": draw.randint(1, 3)}
            case decorators.Repeat:
                settings = {"num_success": draw.choice((-1, 1, 2))}
            case decorators.Timeout:
                settings = {"duration": draw.choice((0.0, 1.5, 4.5))}
            case decorators.Condition:
                settings = {"status": draw.choice((SUCCESS, FAILURE, RUNNING))}
            case decorators.OneShot:
                settings = {"policy": draw.choice(list(OneShotPolicy))}
            case decorators.StatusToBlackboard:
                settings = {"variable_name": "status"}
            case decorators.ForEach:
                settings = {"source_key": "many", "target_key": "one"}
            case decorators.EternalGuard:
                answers = draw.choices([True, True, True, False, SUCCESS, RUNNING, FAILURE], k=4)
                settings = {"condition": _in_turn(answers)}
        return self._kind(kind)(name=name, child=child, **settings)


DECORATORS = (
    decorators.Condition,
    decorators.Count,
    decorators.EternalGuard,
    decorators.EternalGuard,
    decorators.FailureIsRunning,
    decorators.FailureIsSuccess,
    decorators.ForEach,
    decorators.Inverter,
    decorators.OneShot,
    decorators.PassThrough,
    decorators.Repeat,
    decorators.Retry,
    decorators.RunningIsFailure,
    decorators.RunningIsSuccess,
    decorators.StatusToBlackboard,
    decorators.SuccessIsFailure,
    decorators.SuccessIsRunning,
    decorators.Timeout,
    Halting,
)


def _in_turn(answers: list[object]) -> Callable[[], object]:
    looks = 0

    def condition() -> object:
        nonlocal looks
        looks += 1
        return answers[looks % len(answers)]

    return condition


def _shown(nodes: Iterable[Behaviour]) -> list[object]:
    """Return all that py_trees shows of nodes."""
    return [
        (
            node.status,
            node.feedback_message,
            _name(getattr(node, "current_child", None)),
            _name(node.tip()),
        )
        for node in nodes
    ]


def _name(node: Behaviour | None) -> str:
    return "" if node is None else node.name


def _done(call: Callable[[], object]) -> str:
    """Return the error of a call, or nothing."""
    try:
        call()
    except Exception as error:
        return repr(error)
    return ""


def _change(root: Behaviour, planter: Planter) -> None:
    """Let somebody take a node out of a composite, or put one more into it."""
    places = [node for node in root.iterate() if isinstance(node, composites.Composite)]
    if not places:
        return
    place = planter.random.choice(places)
    if place.children and planter.random.random() < 0.5:
        place.remove_child(planter.random.choice(place.children))
    else:
        place.add_child(planter.node(7))


def test_the_ticker_does_what_py_trees_does_to_any_tree_of_its_nodes() -> None:
    blackboard.Blackboard.set("many", [1, 2, 3])
    chance = Random(SEED)
    stories: list[Story] = []
    with patch("time.monotonic", lambda: stories[0].now):
        for number in range(TREES):
            size = chance.choice((2, 4, 6, 8, 8, 10, 12, 15, 30))
            planters = [Planter(number, Story([]), size) for _ in range(2)]
            stock, ours = (planter.node() for planter in planters)
            told: dict[int, tuple[Status, str]] = {}
            visited: list[str] = []
            ticker = Ticker(
                ours,
                tell=_told(told) if chance.random() < 0.7 else None,
                visit=(lambda node, _, seen=visited: seen.append(node.name))  # type: ignore[misc]
                if chance.random() < 0.5
                else None,
            )
            whole = True
            for tick in range(TICKS):
                ways = (stock.tick_once, ticker.tick)
                event = chance.random()
                if event < 0.04:
                    ways = (partial(stock.stop, INVALID), ticker.halt)
                elif event < 0.05:
                    # Who is stopped by that is not told.
                    whole = False
                    for root, planter in zip((stock, ours), planters, strict=True):
                        _change(root, planter)
                elif ticker.visit is not None:
                    ways = (partial(_walk, stock, answered := []), ticker.tick)
                    visited.clear()
                ends = []
                for way, planter in zip(ways, planters, strict=True):
                    stories[:] = [planter.story]
                    planter.story.now += 1.0
                    planter.story.calls.clear()
                    ends.append(_done(way))
                where = f"tree {number}, tick {tick}"
                assert ends[0] == ends[1], where
                assert planters[0].story.calls == planters[1].story.calls, where
                nodes = list(ours.iterate())
                assert _shown(stock.iterate()) == _shown(nodes), where
                whole = whole and not ends[0]
                if ticker.visit is not None and whole and event >= 0.05:
                    assert visited == answered, where
                if ticker.told(ours) is not None and whole:
                    for node in nodes:
                        status, message = told.get(id(node), (INVALID, ""))
                        assert status is node.status, where
                        assert status is INVALID or message == node.feedback_message, where


def _walk(root: Behaviour, answered: list[str]) -> None:
    answered += [node.name for node in root.tick()]


def _told(told: dict[int, tuple[Status, str]]) -> Callable[[Behaviour], None]:
    def tell(node: Behaviour) -> None:
        new = (node.status, node.feedback_message)
        assert told.get(id(node)) != new
        told[id(node)] = new

    return tell


def _balanced(levels: int) -> Behaviour:
    """Return so many levels of sequences of ten; all their leaves succeed."""
    if not levels:
        return Scripted("leaf", Story([]), [SUCCESS])
    return composites.Sequence("s", True, [_balanced(levels - 1) for _ in range(10)])


def _calls(call: Callable[[], object]) -> int:
    """Return how many calls of Python or C a call makes."""
    calls = 0

    def count(_frame: object, event: str, _arg: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        call()
    finally:
        sys.setprofile(None)
    return calls


def test_a_tick_costs_as_much_as_the_nodes_that_it_visits_and_tells_nothing_new() -> None:
    costs = []
    for levels in (1, 2, 3):
        root = _balanced(levels)
        last = [node for node in root.iterate() if isinstance(node, Scripted)][-1]
        last.script = [RUNNING]
        told: list[Behaviour] = []
        ticker = Ticker(root, tell=told.append)
        ticker.tick()
        last.update = lambda: RUNNING  # type: ignore[method-assign]
        told.clear()
        costs.append(_calls(ticker.tick))
        assert told == []
    assert costs[2] - costs[1] == costs[1] - costs[0] < 5


@dataclass
class ByValue(Behaviour):
    """A behaviour that is equal to others of the same name, and cannot be a key."""

    called: str

    def __post_init__(self) -> None:
        super().__init__(self.called)

    def update(self) -> Status:
        return RUNNING if self.status is INVALID else SUCCESS


def test_behaviours_that_compare_by_value_are_ticked_too() -> None:
    twins = [ByValue("x"), ByValue("x")]
    told: list[str] = []
    root = composites.Parallel("p", ParallelPolicy.SuccessOnAll(), twins)
    ticker = Ticker(root, tell=lambda node: told.append(f"{node.name} {node.status.name}"))
    assert [ticker.tick(), ticker.tick()] == [RUNNING, SUCCESS]
    assert told == ["x RUNNING", "x RUNNING", "p RUNNING", "x SUCCESS", "x SUCCESS", "p SUCCESS"]
    assert Ticker(ByValue("y"), tell=print).tick() is RUNNING
    ticker.halt()
    assert {node.status for node in root.iterate()} == {INVALID}
