# SPDX-License-Identifier: Apache-2.0
"""Subtrees: their inputs, their private values and their outputs."""

from __future__ import annotations

from tree_harness import FAILS, LONG, TreeHarness, agent, failure, started

COUNT = """
subtrees:
  double:
    inputs: {n: number}
    outputs: {twice: number}
    tree: {sequence: [{set: {half: "${n}"}}, {set: {twice: "${half * 2}"}}]}
"""


def one(tree: str, declared: str = "") -> str:
    """Return the declaration of a subtree with the name ``one``."""
    return f"subtrees: {{one: {{{declared}tree: {tree}}}}}"


def test_caller_renames_subtree_outputs() -> None:
    harness = started(
        """
        sequence:
          - {subtree: double, with: {n: 2}, outputs: {four: twice}}
          - {subtree: double, with: {n: "${four}"}, outputs: {eight: twice}}
          - say: ${four} and ${eight}
        """,
        head=COUNT,
    )
    assert harness.said == ["4 and 8"]
    assert harness.run._context.scope.blackboard == {"four": 4, "eight": 8}


def test_subtree_writes_stay_local_to_their_call() -> None:
    # Only the first call writes 'half'; the second sees neither that value nor the caller's.
    harness = started(
        """
        sequence:
          - set: {half: outer}
          - {subtree: one, with: {write: true}}
          - say: "${half}"
          - {subtree: one, with: {write: false}}
        """,
        head=one(
            "{sequence: [{set: {half: inner}, when: write}, {say: '${half}'}]}",
            "inputs: {write: boolean}, ",
        ),
    )
    assert harness.said == ["inner", "outer"]
    assert "'half' has no value" in harness.message


def test_subtree_local_does_not_resolve_to_foreign_tunable() -> None:
    head = one("{sequence: [{set: {half: mine}, when: scene.age > 4}, {say: '${half}'}]}")
    tree = agent("subtree: one", head).tree
    foreign = "tunables: {half: {default: yours, description: d}}"
    assert "'half' has no value" in failure(tree, head=foreign)


def test_subtree_start_clears_earlier_writes() -> None:
    tunable = "tunables: {write: {default: true, description: d}}"
    subtree = one("{sequence: [{set: {word: written}, when: write}, {say: '${word}'}]}")
    harness = started("subtree: one\nrepeat: 2", head=f"{tunable}\n{subtree}")
    harness.tunables["write"] = False
    assert (harness.tick(), harness.said) == ("failed", ["written"])


def test_unwritten_output_keeps_caller_value() -> None:
    subtree = one("{set: {word: new}, when: scene.age > 4}", "outputs: {word: text}, ")
    call = "{set: {mine: old}}, {subtree: one, outputs: {mine: word}}, {say: '${mine}'}"
    assert started(f"sequence: [{call}]", head=subtree).said == ["old"]


TRIES = one("{sequence: [{set: {word: tried}}, {drive: x}]}", "outputs: {word: text}, ")


def test_failed_subtree_still_returns_its_outputs() -> None:
    harness = started(
        "sequence: [{subtree: one, succeed: true}, {say: '${word}'}]",
        head=TRIES,
        answers={"drive": FAILS},
    )
    assert harness.said == ["tried"]


def test_interrupted_subtree_returns_no_outputs() -> None:
    harness = started("subtree: one", head=TRIES, answers={"drive": LONG})
    harness.interrupt()
    assert "word" not in harness.run._context.scope.blackboard


def test_running_subtree_sees_changed_inputs() -> None:
    head = """
    tunables: {t: {default: 9 s, min: 0 s, max: 60 s, description: d}}
    subtrees:
      outer: {inputs: {rest: duration}, tree: {subtree: inner, with: {rest: "${rest / 2}"}}}
      inner: {inputs: {rest: duration}, tree: {wait: "${rest}"}}
    """
    harness = started("subtree: outer\nwith: {rest: '${t}'}", head=head)
    assert harness.after(4.0) == "running"
    harness.tunables["t"] = 8.0
    assert harness.tick() == "succeeded"


def test_once_in_subtree_counts_per_call_site() -> None:
    tree = "repeat: 2\nsequence: [{subtree: one}, {subtree: one}]"
    harness = TreeHarness(tree, head=one("{say: Hi., once: true}"))
    assert (harness.tick(2), harness.said) == ("succeeded", ["Hi.", "Hi."])


def test_cleanup_reads_values_written_by_tree() -> None:
    harness = started(
        "sequence: [{set: {place: gate 7}}, {wait: 9 s}]",
        head="on_cancel: {say: 'We were on the way to ${place}.'}",
    )
    harness.run.cancel("enough")
    assert harness.tick() == "cancelled"
    assert harness.said == ["We were on the way to gate 7."]
