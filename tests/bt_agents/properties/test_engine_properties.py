# SPDX-License-Identifier: Apache-2.0
"""Laws of the engine, for random trees and random events around them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status

from bt_agents.engine.environment import GIVE_FEEDBACK, GoalState
from bt_agents.engine.nodes.give_feedback import GiveFeedback
from bt_agents.engine.nodes.skill import SkillLeaf
from bt_agents.engine.nodes.wait_for import WaitForMessage
from bt_agents.engine.run import BEHAVIOURS
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

Script = dict[str, list[ScriptedReply]]
Story = list[tuple[str, object]]

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

    def __init__(self, tree: NodeSpec, script: Script) -> None:
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

    def play(self, story: Story) -> Iterator[None]:
        """Yield after the first tick and after the tick that follows each event."""
        self.tick()
        yield
        for event in story:
            if self.outcome != "running":
                return
            self.happen(event)
            self.tick()
            yield


def _open(harness: Watched) -> tuple[int, int, int]:
    """Return the numbers of goals under way, of open inboxes, and of plug-ins that run."""
    goals = sum(
        not goal.state.ended and goal.cancelled_at is None  # type: ignore[attr-defined]
        for _, goal in harness.run._context._goals
    )
    inboxes = sum(not inbox.closed for _, inbox in harness.environment._inboxes)
    return goals, inboxes, len(ScriptedLeaf.alive)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_nothing_runs_below_a_halted_node(tree: NodeSpec, script: Script, story: Story) -> None:
    harness = Watched(tree, script)
    for _ in harness.play(story):
        assert harness.root.status in (Status.RUNNING, *ENDED)
        for node in harness.root.iterate():
            assert isinstance(node.status, Status)
            if node.status is not Status.RUNNING:
                assert all(below.status is not Status.RUNNING for below in node.iterate())
        running = [node for node in harness.root.iterate() if node.status is Status.RUNNING]
        goals, inboxes, plugins = _open(harness)
        assert goals <= sum(isinstance(node, SkillLeaf | GiveFeedback) for node in running)
        assert inboxes == sum(isinstance(node, WaitForMessage) for node in running)
        assert plugins == sum(node.spec.plugin is not None for node in running)
    harness.interrupt()
    assert {node.status for node in harness.root.iterate()} == {Status.INVALID}
    assert _open(harness) == (0, 0, 0)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_once_and_choices_keep_their_contracts(
    tree: NodeSpec, script: Script, story: Story
) -> None:
    harness = Watched(tree, script)
    done: set[str] = set()
    for _ in harness.play(story):
        answered = {node.spec.path: status for node, status in harness.ticked}
        for node, _ in harness.ticked:
            child = answered.get(node.children[0].spec.path) if node.children else None
            match node.spec.kind:
                case "once":
                    assert not (node.spec.path in done and child is not None)
                    if child in ENDED:
                        done.add(node.spec.path)
                case "random" | "choose":
                    begun = [c for c in node.children if c.spec.path in answered]
                    assert len(begun) <= 1


@settings(max_examples=100, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_equal_inputs_produce_equal_traces(tree: NodeSpec, script: Script, story: Story) -> None:
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
    tree: NodeSpec, script: Script, story: Story
) -> None:
    harness = Watched(tree, script)
    for _ in harness.play(story):
        told = dict.fromkeys((node.spec.path for node in harness.root.iterate()), Status.INVALID)
        told.update((change.path, change.status) for change in harness.changes)
        assert told == {node.spec.path: node.status for node in harness.root.iterate()}


@settings(max_examples=100, deadline=None, derandomize=True)
@given(trees, scripts, stories)
def test_cancel_at_any_time_leaves_nothing_running(
    tree: NodeSpec, script: Script, story: Story
) -> None:
    harness = Watched(tree, script)
    for _ in harness.play(story):
        pass
    harness.run.cancel("enough")
    assert _open(harness) == (0, 0, 0)
    harness.after(5.0)
    assert ScriptedLeaf.set_up == set()
    assert harness.result.orphans == ()


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
