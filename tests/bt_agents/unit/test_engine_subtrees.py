# SPDX-License-Identifier: Apache-2.0
"""Subtrees: their inputs, their private values and their outputs."""

from __future__ import annotations

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import LONG, TreeHarness, agent, started

COUNT = """
subtrees:
  double:
    inputs: {n: number}
    outputs: {twice: number}
    tree:
      sequence:
        - set: {half: "${n}"}
        - set: {twice: "${half * 2}"}
"""


def test_caller_renames_subtree_outputs() -> None:
    harness = TreeHarness(
        """
        sequence:
          - subtree: double
            with: {n: 2}
            outputs: {four: twice}
          - subtree: double
            with: {n: "${four}"}
            outputs: {eight: twice}
          - say: ${four} and ${eight}
        """,
        head=COUNT,
    )
    assert harness.tick() == "succeeded"
    assert harness.said == ["4 and 8"]
    assert harness.run._context.scope.blackboard == {"four": 4, "eight": 8}


def test_subtree_writes_stay_local_to_their_call() -> None:
    # Only the first call writes 'half'; the second sees neither that value nor the caller's.
    head = """
    subtrees:
      one:
        inputs: {write: boolean}
        tree:
          sequence:
            - set: {half: inner}
              when: write
            - say: "${half}"
    """
    harness = TreeHarness(
        """
        sequence:
          - set: {half: outer}
          - {subtree: one, with: {write: true}}
          - say: "${half}"
          - {subtree: one, with: {write: false}}
        """,
        head=head,
    )
    assert harness.tick() == "failed"
    assert harness.said == ["inner", "outer"]
    assert "'half' has no value" in harness.message


def test_subtree_local_does_not_resolve_to_foreign_tunable() -> None:
    head = """
    subtrees:
      one:
        tree:
          sequence:
            - set: {half: mine}
              when: scene.age > 4
            - say: "${half}"
    """
    tree = agent("subtree: one", head).tree
    harness = TreeHarness(tree, head="tunables: {half: {default: yours, description: d}}")
    assert harness.tick() == "failed"
    assert "'half' has no value" in harness.message


def test_subtree_start_clears_earlier_writes() -> None:
    head = """
    tunables: {write: {default: true, description: d}}
    subtrees:
      one:
        tree:
          sequence:
            - set: {word: written}
              when: write
            - say: "${word}"
    """
    harness = started("subtree: one\nrepeat: 2", head=head)
    harness.tunables["write"] = False
    assert harness.tick() == "failed"
    assert harness.said == ["written"]


def test_unwritten_output_keeps_caller_value() -> None:
    head = """
    tunables: {write: {default: true, description: d}}
    subtrees:
      one:
        outputs: {word: text}
        tree: {set: {word: new}, when: write}
    """
    harness = TreeHarness(
        """
        sequence:
          - set: {mine: old}
          - subtree: one
            outputs: {mine: word}
          - say: ${mine}
        """,
        head=head,
    )
    harness.tunables["write"] = False
    assert harness.tick() == "succeeded"
    assert harness.said == ["old"]


TRIES = """
subtrees:
  one:
    outputs: {word: text}
    tree:
      sequence:
        - set: {word: tried}
        - drive: x
"""


def test_failed_subtree_still_returns_its_outputs() -> None:
    harness = TreeHarness(
        "sequence:\n  - {subtree: one, succeed: true}\n  - say: ${word}",
        head=TRIES,
        answers={"drive": [ScriptedReply(state=GoalState.ABORTED)]},
    )
    assert harness.tick() == "succeeded"
    assert harness.said == ["tried"]


def test_interrupted_subtree_returns_no_outputs() -> None:
    harness = started("subtree: one", head=TRIES, answers={"drive": LONG})
    harness.interrupt()
    assert harness.environment.running() == []
    assert "word" not in harness.run._context.scope.blackboard


def test_caller_sees_outputs_only_at_subtree_end() -> None:
    head = """
    subtrees:
      one:
        outputs: {word: text}
        tree:
          sequence:
            - set: {word: new}
            - wait: 5 s
    """
    harness = started(
        """
        sequence:
          - set: {word: old}
          - parallel:
              - subtree: one
              - sequence: [{wait: 1 s}, {say: "${word}"}]
          - say: ${word}
        """,
        head=head,
    )
    harness.after(1.0)
    assert harness.said == ["old"]
    assert harness.after(4.0) == "succeeded"
    assert harness.said == ["old", "new"]


def test_running_subtree_sees_changed_inputs() -> None:
    head = """
    tunables: {t: {default: 9 s, min: 0 s, max: 60 s, description: d}}
    subtrees:
      outer:
        inputs: {rest: duration}
        tree: {subtree: inner, with: {rest: "${rest / 2}"}}
      inner:
        inputs: {rest: duration}
        tree: {wait: "${rest}"}
    """
    harness = started("subtree: outer\nwith: {rest: '${t}'}", head=head)
    assert harness.after(4.0) == "running"
    harness.tunables["t"] = 8.0
    assert harness.tick() == "succeeded"


def test_concurrent_subtree_calls_do_not_share_names() -> None:
    head = """
    subtrees:
      one:
        inputs: {word: text, rest: duration}
        tree:
          sequence:
            - set: {mine: "${word}"}
            - wait: "${rest}"
            - say: "${mine}"
    """
    harness = TreeHarness(
        """
        parallel:
          - {subtree: one, with: {word: first, rest: 2 s}}
          - {subtree: one, with: {word: second, rest: 1 s}}
        """,
        head=head,
    )
    assert harness.tick(3, step_s=1.0) == "succeeded"
    assert harness.said == ["second", "first"]


def test_once_in_subtree_counts_per_call_site() -> None:
    head = "subtrees: {hi: {tree: {say: Hi., once: true}}}"
    harness = TreeHarness("repeat: 2\nsequence:\n  - subtree: hi\n  - subtree: hi", head=head)
    assert harness.tick(2) == "succeeded"
    assert harness.said == ["Hi.", "Hi."]


def test_cleanup_reads_values_written_by_tree() -> None:
    harness = started(
        "sequence:\n  - set: {place: gate 7}\n  - wait: 9 s",
        head="on_cancel: {say: 'We were on the way to ${place}.'}",
    )
    harness.run.cancel("enough")
    assert harness.tick() == "cancelled"
    assert harness.said == ["We were on the way to gate 7."]
