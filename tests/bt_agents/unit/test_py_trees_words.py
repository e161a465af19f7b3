# SPDX-License-Identifier: Apache-2.0
"""Words of docs/py_trees_ros.md tick like classes of py_trees; its tools take our trees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from random import Random

import pytest
from py_trees import decorators, display, idioms, trees, visitors
from py_trees.behaviour import Behaviour
from py_trees.behaviours import StatusQueue, SuccessEveryN, TickCounter
from py_trees.common import OneShotPolicy, Status

import tree_harness
from bt_agents.engine.nodes import plugin
from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.node_type import NodeField, NodeType
from tree_harness import TreeHarness

STATUSES = {"R": Status.RUNNING, "S": Status.SUCCESS, "F": Status.FAILURE}
QUEUES = ("RSFRS", "RFSRS", "FFRS", "SSRF", "RRRR", "S", "F")
LEAVES: Mapping[str, tuple[Callable[[], Behaviour], str]] = {
    "counter": (lambda: TickCounter("x", 3, Status.SUCCESS), "check: true\nrepeat: 4"),
    "failing counter": (
        lambda: TickCounter("x", 3, Status.FAILURE),
        "check: true\nrepeat: 4\nfail: true",
    ),
    "every third": (
        lambda: decorators.FailureIsRunning("x", SuccessEveryN("y", 3)),
        "sequence: [set: {n: '${n else 0 + 1}'}, check: n % 3 == 0]\nretry: forever",
    ),
}
DECORATORS: Mapping[str, tuple[Callable[[str, Behaviour], Behaviour], str]] = {
    "pass through": (decorators.PassThrough, ""),
    "failure is running": (decorators.FailureIsRunning, "retry: forever"),
    "success is running": (decorators.SuccessIsRunning, "repeat: forever"),
    "running is failure": (decorators.RunningIsFailure, "timeout: 0 s"),
    "until success": (partial(decorators.Condition, status=Status.SUCCESS), "retry: forever"),
    "until failure": (
        partial(decorators.Condition, status=Status.FAILURE),
        "repeat: forever\nsucceed: true",
    ),
}


class Queue(StatusQueue):
    """Ends its ticks according to the letters of its queue, then always with SUCCESS."""

    def __init__(self, name: str, queue: str) -> None:
        super().__init__(name, [STATUSES[letter] for letter in queue], Status.SUCCESS)


@pytest.fixture(autouse=True)
def queue_node(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the queue a node of the language, with a time limit for busy machines."""
    monkeypatch.setattr(plugin, "BLOCKS_S", 60.0)
    field = NodeField(name="queue", type=FieldType.TEXT)
    queue = NodeType(key="queue", plugin=Queue, main="queue", fields=(field,))
    symbols = replace(tree_harness.SYMBOLS, plugins={"queue": queue})
    monkeypatch.setattr(tree_harness, "SYMBOLS", symbols)


def ticks_of(root: Behaviour) -> str:
    """Return the first letters of the statuses up to the first end, for at most 8 ticks."""
    letters = ""
    while len(letters) < 8 and not letters.endswith(("S", "F")):
        root.tick_once()
        letters += root.status.name[0]
    return letters


def ticks_of_words(harness: TreeHarness) -> str:
    letters = ""
    while len(letters) < 8 and harness.outcome == "running":
        harness.tick()
        letters += harness.root.status.name[0]
    return letters


@pytest.mark.parametrize("name", LEAVES)
def test_words_for_leaves_tick_alike(name: str) -> None:
    leaf, words = LEAVES[name]
    assert ticks_of_words(TreeHarness(words)) == ticks_of(leaf())


@pytest.mark.parametrize("queue", QUEUES)
@pytest.mark.parametrize("name", DECORATORS)
def test_words_for_decorators_tick_alike(name: str, queue: str) -> None:
    around, words = DECORATORS[name]
    harness = TreeHarness(f"queue: {queue}\n{words}")
    assert ticks_of_words(harness) == ticks_of(around("x", Queue("y", queue)))


def test_once_ticks_like_oneshot() -> None:
    shot = decorators.OneShot("x", Queue("y", "RSFF"), OneShotPolicy.ON_SUCCESSFUL_COMPLETION)
    harness = TreeHarness("sequence: [{queue: RSFF, once: true}]\nrepeat: 3")
    assert ticks_of_words(harness) == ticks_of(decorators.Repeat("z", shot, 3))


def test_sequence_of_once_picks_up_after_interruption() -> None:
    tasks: list[Behaviour] = [TickCounter(name, 2, Status.SUCCESS) for name in ("a", "b")]
    theirs = idioms.pick_up_where_you_left_off("x", tasks)
    three_ticks = "{check: true, repeat: 3, once: true}"
    ours = TreeHarness(f"sequence: [{three_ticks}, {three_ticks}]")
    for _ in range(4):
        theirs.tick_once()
        assert ours.tick() == "running"
    theirs.stop(Status.INVALID)
    ours.interrupt()
    assert ticks_of_words(ours) == ticks_of(theirs)


TREE = """
sequence:
  - parallel:
      succeed_on: one
      children:
        - say: hello
          timeout: 5 s
        - wait: 20 s
  - when: scene.age > 9
    say: left out
  - choose:
      - {name: old, when: scene.age > 9, say: never}
      - {name: young, when: scene.age < 9, say: good-bye, retry: 2}
  - random: [{wait: 1 s}, {wait: 2 s, weight: 2}]
  - wait: 1 s
    once: true
    cooldown: 1 s
    while: scene.age > 0
    on_failure: {say: never}
"""


def test_py_trees_manager_ticks_tree_like_a_run() -> None:
    ours, theirs = (TreeHarness(TREE, random=Random(1)) for _ in range(2))
    seen = visitors.SnapshotVisitor()
    manager = trees.BehaviourTree(theirs.root)
    manager.visitors += [seen, visitors.DebugVisitor()]
    manager.setup()
    while ours.outcome == "running":
        ours.tick()
        manager.tick()
        for harness in (ours, theirs):
            harness.environment.clock.advance(1.0)
        names = {node.id: node.name for node in theirs.root.iterate()}
        assert [node.name for node, _ in ours.ticked] == [names[one] for one in seen.visited]
        pairs = zip(ours.root.iterate(), theirs.root.iterate(), strict=True)
        assert all(one.status is two.status for one, two in pairs)
    assert theirs.root.status is Status.SUCCESS
    assert theirs.said == ours.said == ["hello", "good-bye"]


def test_nodes_provide_the_py_trees_behaviour_interface() -> None:
    root = TreeHarness(TREE).root
    nodes = list(root.iterate())
    assert len({node.id for node in nodes}) == len(nodes)
    assert {node.id for node in nodes} == {node.id for node in nodes}
    assert root.qualified_name == "LightSequence/sequence"
    assert all(child.parent is node for node in nodes for child in node.children)
    assert list(root.iterator)[-1] is root
    for node in nodes:
        assert node.name in display.unicode_tree(root, show_status=True)
        node.logger.debug("seen")
    root.stop(Status.INVALID)
    assert {node.status for node in nodes} == {Status.INVALID}
