# SPDX-License-Identifier: Apache-2.0
"""Tools of py_trees on our trees."""

from __future__ import annotations

from random import Random

from py_trees import display, trees, visitors
from py_trees.common import Status

from tree_harness import TreeHarness

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
