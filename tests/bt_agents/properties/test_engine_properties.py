# SPDX-License-Identifier: Apache-2.0
"""Laws of the engine, for random trees and random events around them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.builder import BEHAVIOURS
from bt_agents.engine.environment import GIVE_FEEDBACK, GoalState
from bt_agents.engine.nodes.give_feedback import GiveFeedback
from bt_agents.engine.nodes.skill import SkillLeaf
from bt_agents.engine.nodes.wait_for import WaitForMessage
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.field_types import Plain
from bt_agents_language.model.specs import NodeSpec
from random_trees import ACTIONS, ScriptedLeaf, placed, trees
from tree_harness import TreeHarness, scene

HEAD = """
tunables:
  rest: {default: 1 s, min: 0 s, max: 60 s, description: d}
  times: {default: 2, min: 1, max: 9, description: d}
"""
ENDED = (Status.SUCCESS, Status.FAILURE)
BROKEN: tuple[Plain, ...] = (-1.0, float("nan"), float("inf"), "x", None, 10**400)

states = st.sampled_from([s for s in GoalState if s.ended])
answers = st.builds(
    ScriptedReply,
    state=states,
    result=st.sampled_from([{}, {"word": "a"}, {"word": 5}]),
    accept_s=st.sampled_from([0.0, 0.5]),
    after_s=st.sampled_from([0.0, 1.0, 4.0]),
)
scripts = st.fixed_dictionaries(
    {name: st.lists(answers, min_size=1, max_size=3) for name in (*ACTIONS, GIVE_FEEDBACK)}
)
events = st.one_of(
    st.tuples(st.just("pass"), st.sampled_from([0.0, 0.5, 1.0, 5.0])),
    st.tuples(st.just("mood"), st.sampled_from([0.0, 1.0, 3.0])),
    st.tuples(st.just("age"), st.sampled_from([1.0, 4.0])),
    st.tuples(st.just("arrive"), st.sampled_from([{"data": 2, "word": "a"}, {"data": 0}, {}])),
    st.tuples(st.sampled_from(["rest", "times"]), st.sampled_from([0.0, 1, 2, *BROKEN])),
    st.tuples(st.just("interrupt"), st.none()),
)
stories = st.lists(events, max_size=14)


class Watched(TreeHarness):
    """A harness that counts the starts of each node, and records each tick."""

    def __init__(self, tree: NodeSpec, script: dict[str, list[ScriptedReply]]) -> None:
        ScriptedLeaf.alive = set()
        ScriptedLeaf.set_up = set()
        super().__init__(tree, head=HEAD, answers=script, awarded=scene(mood=3), random=Random(1))
        # The types that the reader guarantees for names cannot hold in a random tree.
        self.environment._result = {}

    def happen(self, event: tuple[str, object]) -> None:
        match event:
            case ("pass", float(duration)):
                self.environment.clock.advance(duration)
            case ("mood" | "age" as name, float(value)):
                self.set_live(name, value)
            case ("arrive", dict(message)):
                self.environment.arrive("t", message)
            case ("rest" | "times" as name, value):
                self.tunables[name] = value  # type: ignore[assignment]
            case ("interrupt", _):
                self.interrupt()

    def play(self, story: list[tuple[str, object]]) -> Iterator[None]:
        """Yield after the first tick and after the tick that follows each event."""
        self.tick()
        yield
        for event in story:
            if self.outcome != "running":
                return
            self.happen(event)
            self.tick()
            yield

    def leaves(self, kind: type[Behaviour]) -> list[Behaviour]:
        return [node for node in self.root.iterate() if isinstance(node, kind)]


def _under_way(harness: Watched) -> int:
    """Return the number of goals that are sent and neither ended nor cancelled."""
    open_goals = [
        goal
        for _, goal in harness.run._context._goals
        if not goal.state.ended and goal.cancelled_at is None  # type: ignore[attr-defined]
    ]
    return len(open_goals)


def _listening(harness: Watched) -> int:
    return sum(not inbox.closed for _, inbox in harness.environment._inboxes)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_nothing_runs_below_a_halted_node(
    tree: NodeSpec, script: dict[str, list[ScriptedReply]], story: list[tuple[str, object]]
) -> None:
    harness = Watched(tree, script)
    for _ in harness.play(story):
        assert harness.root.status in (Status.RUNNING, *ENDED)
        for node in harness.root.iterate():
            assert isinstance(node.status, Status)
            if node.status is not Status.RUNNING:
                assert all(below.status is not Status.RUNNING for below in node.iterate())
        senders = [*harness.leaves(SkillLeaf), *harness.leaves(GiveFeedback)]
        assert _under_way(harness) <= sum(leaf.status is Status.RUNNING for leaf in senders)
        listeners = harness.leaves(WaitForMessage)
        assert _listening(harness) == sum(leaf.status is Status.RUNNING for leaf in listeners)
        assert len(ScriptedLeaf.alive) == sum(
            node.spec.plugin is not None and node.status is Status.RUNNING
            for node in harness.root.iterate()
        )
    harness.interrupt()
    assert {node.status for node in harness.root.iterate()} == {Status.INVALID}
    assert _under_way(harness) == 0
    assert _listening(harness) == 0
    assert ScriptedLeaf.alive == set()


@settings(max_examples=150, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_modifiers_keep_their_contracts(
    tree: NodeSpec, script: dict[str, list[ScriptedReply]], story: list[tuple[str, object]]
) -> None:
    harness = Watched(tree, script)
    done: set[str] = set()
    for _ in harness.play(story):
        answered = {node.spec.path: status for node, status in harness.ticked}
        for node, status in harness.ticked:
            child = answered.get(node.children[0].spec.path) if node.children else None
            match node.spec.kind:
                case "succeed":
                    assert status is not Status.FAILURE
                case "fail":
                    assert status is not Status.SUCCESS
                case "invert" if child in ENDED:
                    assert {status, child} == set(ENDED)
                case "once":
                    assert not (node.spec.path in done and child is not None)
                    if child in ENDED:
                        done.add(node.spec.path)
                case "random" | "choose":
                    begun = [c for c in node.children if c.spec.path in answered]
                    assert len(begun) <= 1


@settings(max_examples=100, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_equal_inputs_produce_equal_traces(
    tree: NodeSpec, script: dict[str, list[ScriptedReply]], story: list[tuple[str, object]]
) -> None:
    traces = []
    for _ in range(2):
        harness = Watched(tree, script)
        for _ in harness.play(story):
            pass
        traces.append(
            (harness.changes, harness.asked, harness.environment.logged, harness.outcome)
        )
    assert traces[0] == traces[1]


@settings(max_examples=100, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_reported_changes_cover_every_status_change(
    tree: NodeSpec, script: dict[str, list[ScriptedReply]], story: list[tuple[str, object]]
) -> None:
    harness = Watched(tree, script)
    for _ in harness.play(story):
        told = dict.fromkeys((node.spec.path for node in harness.root.iterate()), Status.INVALID)
        told.update((change.path, change.status) for change in harness.changes)
        assert told == {node.spec.path: node.status for node in harness.root.iterate()}


@settings(max_examples=100, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_cancel_at_any_time_leaves_nothing_running(
    tree: NodeSpec, script: dict[str, list[ScriptedReply]], story: list[tuple[str, object]]
) -> None:
    harness = Watched(tree, script)
    for _ in harness.play(story):
        pass
    harness.run.cancel("enough")
    assert _under_way(harness) == 0
    assert _listening(harness) == 0
    assert ScriptedLeaf.alive == set()
    harness.after(5.0)
    assert harness.outcome != "running"
    assert ScriptedLeaf.set_up == set()
    assert harness.run.result is not None
    assert harness.run.result.orphans == ()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.integers(0, 9), min_size=1, max_size=5).filter(any), st.integers(0, 2**32))
def test_random_picks_follow_weights(weights: list[int], seed: int) -> None:
    children = "\n".join(
        f"    - {{log: '{place}', weight: {weight}}}" for place, weight in enumerate(weights)
    )
    harness = TreeHarness(f"repeat: forever\nrandom:\n  seed: {seed}\n  children:\n{children}")
    harness.tick(600)
    picked = Counter(int(text) for _, text in harness.environment.logged)
    for place, weight in enumerate(weights):
        share = weight / sum(weights)
        # Six standard deviations of the binomial distribution.
        bound = 6 * (600 * share * (1 - share)) ** 0.5
        assert abs(picked[place] - 600 * share) <= bound


def test_random_trees_cover_every_node_kind() -> None:
    found: set[str] = set()

    @settings(max_examples=300, deadline=None, derandomize=True, database=None)
    @given(trees)
    def collect(tree: NodeSpec) -> None:
        open_specs = [placed(tree)]
        while open_specs:
            spec = open_specs.pop()
            found.add(spec.kind)
            open_specs += spec.children

    collect()
    # Services and topics are drawn as bindings of 'action'; the scripted world remembers nobody.
    assert found >= set(BEHAVIOURS) - {"service", "publish", "remember"}
