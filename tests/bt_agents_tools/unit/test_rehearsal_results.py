# SPDX-License-Identifier: Apache-2.0
"""Results of rehearsals: expectations, coverage, and their display."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents_core.errors import ReadError
from bt_agents_language.nodes.node_type import Mark
from bt_agents_tools.rehearsal.assertions import AssertionFailure, aligned
from bt_agents_tools.rehearsal.coverage import coverage
from bt_agents_tools.rehearsal.events import Event, EventKind
from bt_agents_tools.rehearsal.suite import failure, run_case
from bt_agents_tools.rehearsal.transcript import MOST_EVENTS, lines, table, time_text, transcript
from rehearsal_harness import cases_for, rehearsed
from tree_harness import SPACE, agent

TWO = """
sequence:
  - say: Hello.
  - drive: gate 7
  - say: Goodbye.
"""
RULES = "feedback: [{when: mood.change <= -1.0, give: negative, then: cancel}]"


def found(tree: str, expect: str, more: str = "", head: str = "") -> list[AssertionFailure]:
    spec = agent(tree, head)
    case = f"- {{name: x, scene: {{mood: 3}}, {more} expect: {{{expect}}}}}"
    [one] = cases_for(spec, case).cases
    return list(run_case(spec, SPACE, one).failures)


def test_met_expectation_is_not_mentioned() -> None:
    assert found(TWO, "bids: true") == []
    assert found(TWO, "does_not: [show, drive: gate 8, light]") == []


@pytest.mark.parametrize(
    ("expect", "message"),
    [
        ("ends: failed", "ends: expected failed, found succeeded"),
        ("says: [Hello., Bye.]", "says: 1 missing, 1 not expected"),
        ("says: {contains: [Goodbye., Hello.]}", "says: 1 missing (in this order, among others)"),
        ("does: {contains: [drive: gate 8]}", "does: 1 missing"),
        ("not_visited: '**.drive'", "not_visited: tree/1.drive was ticked"),
        ("within: 2 s", "within: expected at most 2.0 s, found 2.6 s"),
        ("feedback: positive", "feedback: expected positive, found none"),
        ("because: blocked", "because: expected a reason with 'blocked', but the tree succeeded"),
        ("bids: false", "bids: expected no bid, but nothing speaks against one"),
        ("does_not: [show, say: Goodbye.]", 'does_not: expected no say "Goodbye.", found say'),
    ],
)
def test_unmet_expectation_is_named_with_actual_result(expect: str, message: str) -> None:
    [finding] = found(TWO, expect)
    assert finding.message.startswith(message)
    assert str(finding.position).startswith("a.test.yaml:4:")


def test_unticked_node_is_not_visited() -> None:
    [finding] = found("sequence: [{check: false}, {say: a}]", "visited: tree/1.say")
    assert finding.message == "visited: tree/1.say was never ticked"


def test_cancel_source_is_compared() -> None:
    during = "during: [{after: 1 s, cancel: operator}],"
    [finding] = found("wait: 9 s", "cancelled_by: mood.change <= -1.0", during, RULES)
    assert finding.message == "cancelled_by: expected 'mood.change <= -1.0', found operator"


def test_endless_run_fails_every_test() -> None:
    [finding] = found("sequence: [{say: a}, {wait_for: live.mood > 4}]", "says: [a]")
    assert "the run did not end: it waits for ever" in finding.message


def test_unexpected_missing_bid_fails_test() -> None:
    head = "requires: scene.person"
    assert found(TWO, "bids: false", "person: false,", head) == []
    [finding] = found(TWO, "ends: succeeded", "person: false,", head)
    assert "it needs scene.person" in finding.message
    assert "'bids: false'" in finding.message


UNDECIDED = """
selector:
  - sequence:
      - subtree: level_of_pain
      - say: I call a nurse.
        when: level >= 4
  - say: Rest well.
"""
LEVEL = "subtrees: {level_of_pain: {outputs: {level: any}, tree: {set: {level: four}}}}"


def test_unexpected_undecidable_condition_fails_test() -> None:
    [finding] = found(UNDECIDED, "ends: succeeded", head=LEVEL)
    assert finding.message.startswith("cannot be decided: level >= 4 (")
    assert finding.message.endswith("; fix it, or expect 'because: cannot be decided'")
    assert found(UNDECIDED, "because: cannot be decided", head=LEVEL) == []


def test_undecidable_condition_is_reported_and_covers_nothing() -> None:
    result = rehearsed(UNDECIDED, head=LEVEL)
    assert "≡ error: cannot be decided: level >= 4 (" in transcript(result.events)
    [path] = [path for path in result.marks if path.endswith("@when")]
    assert result.marks[path] == {Mark.TICKED}


def test_failure_shows_expected_actual_and_transcript() -> None:
    spec = agent(TWO)
    expect = "{says: [Hello., Shall we go?, Goodbye.]}"
    [case] = cases_for(spec, f"- {{name: x, scene: {{mood: 3}}, expect: {expect}}}").cases
    assert failure(run_case(spec, SPACE, case)).splitlines() == [
        "a.test.yaml:4: says: 1 missing (in this order, these and no others)",
        "    expected                             │ found",
        "    Hello.                               │ Hello.",
        "  ✘ Shall we go?                         │ –",
        "    Goodbye.                             │ Goodbye.",
        "",
        "what happened (succeeded after 2.6 s, 7 ticks):",
        '    0.0 s  ▶ say "Hello."                                                  0.8 s',
        "    0.8 s  ▶ drive gate 7                                                  1.0 s",
        "    1.8 s  ✔ drive gate 7",
        '    1.8 s  ▶ say "Goodbye."                                                0.9 s',
        "    2.6 s  ● succeeded",
    ]


@pytest.mark.parametrize(
    ("expect", "row"),
    [
        ("says: [Hi., Goodbye.]", ("Hi.", "Hello.", False)),
        ("does: [say: Hi., drive: gate 7, say]", ('say "Hi."', 'say "Hello."', False)),
    ],
)
def test_substitute_is_paired_in_same_wording(expect: str, row: tuple[str, str, bool]) -> None:
    [finding] = found(TWO, expect)
    assert finding.rows[0] == row


def test_long_texts_wrap_in_both_columns() -> None:
    lines = list(table([("one " * 20, "two " * 5, False)]))
    assert all(len(line) <= 80 for line in lines)
    assert lines[1].startswith("  ✘ one one")
    assert lines[2].startswith("    one one")


def test_transcript_and_table_escape_control_characters() -> None:
    event = Event(kind=EventKind.LOGS, at_s=0.0, text="\x1b[31mred\nline")
    assert lines(event, ticks=False) == ["    0.0 s  ≡ \\x1b[31mred line"]
    assert "\\x1b[31mred" in list(table([("red", "\x1b[31mred", False)]))[1]


@given(st.lists(st.sampled_from("abc"), max_size=8), st.lists(st.sampled_from("abc"), max_size=8))
def test_alignment_keeps_all_items_and_pairs_equals(left: list[str], right: list[str]) -> None:
    pairs = aligned(left, right, str.__eq__, exact=True)
    assert [one for one, _ in pairs if one is not None] == left
    assert [other for _, other in pairs if other is not None] == right
    assert all(one == other for one, other in pairs if one is not None and other is not None)
    if left == right:
        assert all(one is not None and other is not None for one, other in pairs)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(59.94, "59.9 s"), (59.96, "1:00.0"), (3661.0, "1:01:01"), (3719.6, "1:02:00")],
)
def test_times_use_stopwatch_format(seconds: float, text: str) -> None:
    assert time_text(seconds) == text


def test_ticks_show_every_change() -> None:
    result = rehearsed(TWO)
    shown = [line for event in result.events for line in lines(event, ticks=True)]
    assert any("✔ drive" in line for line in shown)
    assert len(shown) > len(transcript(result.events).splitlines())
    stopped = rehearsed("drive: a\ntimeout: 3 s", "answers: {drive: {ends: never}}")
    shown = [line for event in stopped.events for line in lines(event, ticks=True)]
    assert any("    3.0 s    ■ drive" in line for line in shown)


def gaps(tree: str, *texts: str, head: str = "") -> list[str]:
    spec = agent(tree, head)
    results = [rehearsed(tree, text, head=head) for text in texts]
    return [str(gap) for gap in coverage(spec, [one.marks for one in results]).gaps]


def test_coverage_names_unticked_nodes_and_their_positions() -> None:
    tree = "selector:\n  - say: one\n  - sequence:\n      - say: two\n      - say: three\n"
    head = "on_cancel: {light: white}"
    assert gaps(tree, "", head=head) == [
        "never ticked: tree/1.sequence (a.yaml:10)",
        "never ticked: on_cancel (a.yaml:6)",
    ]


def test_coverage_counts_both_outcomes_of_decisions() -> None:
    tree = """
        sequence:
          - check: scene.age > 3
            succeed: true
          - when: scene.age > 3
            say: old
          - drive: gate 7
            timeout: 5 s
            succeed: true
    """
    assert gaps(tree, "scene: {age: 5}") == [
        "never false: tree/0.check (a.yaml:10)",
        "never left out: tree/1.say@when (a.yaml:12)",
        "never ran out of time: tree/2.drive@timeout (a.yaml:15)",
    ]
    assert gaps(tree, "scene: {age: 5}", "scene: {age: 1}\nanswers: {drive: {ends: never}}") == []


def test_coverage_requires_each_alternative_to_succeed() -> None:
    tree = "selector: [{drive: gate 7}, {drive: gate 8}]"
    assert gaps(tree, "answers: {drive: {fails: blocked}}") == [
        "never succeeded: tree/0.drive (a.yaml:8)",
        "never succeeded: tree/1.drive (a.yaml:8)",
    ]
    assert gaps(tree, "", "answers: {drive: [{fails: blocked}, {after: 1 s}]}") == []


def test_coverage_is_100_percent_only_when_complete() -> None:
    spec = agent("sequence: [{say: one}, {say: two}]")
    none = coverage(spec, [])
    assert (none.total, none.missed, none.percent) == (3, 3, 0)
    assert coverage(spec, [rehearsed("sequence: [{say: one}, {say: two}]").marks]).percent == 100


def test_coverage_requires_no_impossible_outcome() -> None:
    tree = "selector: [{drive: gate 7}, {say: Sorry., fail: true}]"
    assert gaps(tree, "", "answers: {drive: {fails: blocked}}") == []
    assert gaps("selector: [{check: false}, {say: a}]", "") == []


def test_non_bidding_agent_has_no_transcript() -> None:
    spec = agent(TWO, "requires: scene.person")
    [case] = cases_for(spec, "- {name: x, person: false, expect: {bids: true}}").cases
    shown = failure(run_case(spec, SPACE, case))
    assert shown.endswith("bids: expected a bid, but it needs scene.person")


def test_overlong_paths_are_omitted_instead_of_cut() -> None:
    deep = "check: scene.age > 3"
    for number in range(9):
        deep = f"{{name: a rather long name {number}, sequence: [{{{deep.strip('{}')}}}]}}"
    shown = transcript(rehearsed(deep, "scene: {mood: 3}").events)
    assert all(len(line) <= 80 for line in shown.splitlines())
    assert "(a.yaml:" in shown
    assert "a_rather" not in shown


def test_transcript_of_endless_run_is_cut() -> None:
    shown = transcript(rehearsed("say: Hello.\nrepeat: 500").events).splitlines()
    [cut] = [line for line in shown if "left out" in line]
    assert len(shown) == MOST_EVENTS + 1
    assert cut.strip() == "… 101 events left out"
    assert shown[-1].endswith("● succeeded")


def test_node_is_shown_with_its_inputs() -> None:
    head = "tunables: {patience: {default: 4 s, min: 1 s, max: 9 s, description: d}}"
    tree = "sequence: [wait: '${patience}', show: {text: Take it., clip: hand, duration: 3 s}]"
    shown = transcript(rehearsed(tree, head=head).events)
    assert "… waits: wait 4 s" in shown
    assert '▶ show "Take it.", clip hand' in shown


def test_message_without_waiting_node_is_lost() -> None:
    wait = "{wait_for: {topic: bell, type: std_msgs/msg/Bool%s}, timeout: 1 s}"
    tree = f"sequence: [wait: 2 s, {wait}]"
    rings = "during: [{after: 1 s, publish: {topic: bell, message: {data: true}}}]"
    early = transcript(rehearsed(tree % "", rings).events)
    assert "1.0 s  ◇ message on bell: data true – lost, no node waits for it" in early
    assert "◆ message" in transcript(rehearsed(tree % ", latched: true", rings).events)
    assert "◆ message" in transcript(rehearsed(tree % "", rings.replace("1 s", "2.5 s")).events)


# --- what the tree puts into the scene and remembers ---------------------------------------


@pytest.mark.parametrize(
    ("expect", "rows"),
    [
        ("told: {mood: 2}", None),
        ("told: {mood: 2, age: 5}", None),
        ("told: {mood: 4}", [("mood 4", "mood 2", False)]),
        ("told: {familiarity: 4}", [("familiarity 4", "–", False)]),
        ("told: {}", [("–", "mood 2", False), ("–", "age 5", False)]),
        ("remembered: {}", None),
    ],
)
def test_told_scene_values_can_be_expected(expect, rows):
    tree = "sequence:\n  - set: {scene.mood: 4, scene.age: 5}\n  - set: {scene.mood: 2}"
    expected = [] if rows is None else [("told: other values than expected", tuple(rows))]
    assert [(failure.message, failure.rows) for failure in found(tree, expect)] == expected


def test_expected_told_value_must_be_in_range():
    with pytest.raises(ReadError, match="out-of-range"):
        cases_for(agent("log: a"), "- name: it tells\n  expect: {told: {mood: 9}}\n")
