# SPDX-License-Identifier: Apache-2.0
"""Test files: their keys, and located errors for slips."""

from __future__ import annotations

from pathlib import Path

import pytest

from agent_texts import refusal
from bt_agents_core.errors import ReadError
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.local_time import LocalTime
from bt_agents_core.stop_cause import Cancellation
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.testing.path_patterns import matches
from bt_agents_language.files.testing.scenarios import GoalEnd, ScriptedAnswer, SkillUse
from bt_agents_language.tree.subtrees import MAX_NODES
from file_texts import read_test_text
from rehearsal_harness import cases_for
from tree_harness import SYMBOLS, TREES, agent

AGENT = agent(
    """
    sequence:
      - say: Hello.
      - name: question
        ask: Where to?
      - drive: ${answer}
        timeout: ${patience}
      - wait_for: {topic: buttons/confirm, type: std_msgs/msg/Bool, until: msg.data}
      - service: {name: reset, type: std_srvs/srv/Trigger, outputs: {note: message}}
    """,
    """
    tunables: {patience: {default: 8 s, min: 2 s, max: 30 s, description: d}}
    feedback: [{when: mood.change <= -1.0, give: negative, then: cancel}]
    """,
)


def problems(case: str) -> tuple[str, ...]:
    return refusal(cases_for, AGENT, case).lines


def test_case_describes_whole_rehearsal() -> None:
    [case] = cases_for(
        AGENT,
        """
        - name: all at once
          scene: {age: 4, mood: 3}
          person: true
          tunables: {patience: 3 s}
          clock: {hour: 22, weekday: sunday}
          seed: 7
          answers:
            ask: [yes, {gives: 7, after: 2 s}, {fails: silence, after: 1 min}]
            tree/2.drive: {ends: never}
            service: {outputs: {note: done}}
          replace: {"**.wait_for*": succeed}
          during:
            - {after: 2 s, mood: 1.5, person: false}
            - at: "**.wait_for*"
              publish: {topic: buttons/confirm, message: {data: true}}
            - {after: 4 s, tune: {patience: 10 s}}
            - {after: 5 s, cancel: operator}
          expect: {ends: succeeded}
        """,
    ).cases
    said = case.scenario
    assert (said.scene, said.person, said.seed) == ({"age": 4.0, "mood": 3.0}, True, 7)
    night = LocalTime(hour=22, weekday="sunday")
    assert (said.clock, said.tunables) == (night, {"patience": 3.0})
    assert [rule.key for rule in said.answers] == ["ask", "tree/2.drive", "service"]
    assert said.answers[0].answers == (
        ScriptedAnswer(outputs={"answer": "yes"}),
        ScriptedAnswer(outputs={"answer": "7"}, after_s=2.0),
        ScriptedAnswer(end=GoalEnd.FAILS, reason="silence", after_s=60.0),
    )
    assert said.answers[1].answers[0].end is GoalEnd.NEVER
    assert said.answers[2].answers[0].outputs == {"note": "done"}
    assert said.replace[0].node.kind == "check"
    mood, button, tune, cancel = said.during
    assert (mood.after_s, mood.values, mood.person) == (2.0, {"mood": 1.5}, False)
    assert (button.topic, button.message) == ("buttons/confirm", {"data": True})
    assert tune.tunables == {"patience": 10.0}
    assert cancel.cancel == Cancellation(by="operator", reason="operator")


def test_case_holds_positioned_expectations() -> None:
    [case] = cases_for(
        AGENT,
        """
        - name: expectations
          during: [{after: 1 s, cancel: operator}]
          expect:
            bids: true
            says: {contains: [Hello.]}
            does: [say, ask: Where to?, drive: {destination: yes}]
            visited: [tree/0.say, "**.drive"]
            not_visited: tree/1.question
            ends: failed
            because: blocked
            within: 30 s
            feedback: [negative]
            cancelled_by: operator
        """,
    ).cases
    _, says, does, first, second, third, ends, _, within, teaches, _ = case.expectations
    assert " ".join(type(one).__name__ for one in case.expectations) == (
        "ExpectedBids Says Does Visits Visits Visits Ends Because Within Teaches CancelledBy"
    )
    assert (says.texts, says.exact) == (("Hello.",), False)
    assert does.uses == (
        SkillUse(skill="say"),
        SkillUse(skill="ask", inputs={"text": "Where to?"}),
        SkillUse(skill="drive", inputs={"destination": "yes"}),
    )
    assert [one.wanted for one in (first, second, third)] == [True, True, False]
    assert str(ends.position) == "a.test.yaml:13:7"
    assert within.seconds == 30.0
    assert teaches.kinds == (FeedbackKind.NEGATIVE,)


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("expect: {ends: succeded}", "[bad-choice]: 'ends' is 'succeded'"),
        ("expect: {end: succeeded}", "[unknown-key]: 'expect' has no key 'end'"),
        ("expect: {}", "[missing-value]: nothing is expected"),
        ("expect: {visited: tree/9.say}", "[unknown-path]: no node of the agent has the path"),
        ("expect: {does: [dance]}", "[unknown-name]: the agent's tree uses no skill 'dance'"),
        ("expect: {does: [{say: {txt: a}}]}", "[unknown-key]: 'say' has no input 'txt'"),
        ("expect: {feedback: bad}", "[bad-choice]: feedback is 'bad'"),
        ("expect: {cancelled_by: mood.change <= -2}", "[unknown-name]: nothing cancels this run"),
        ("expect: {bids: false, ends: failed}", "[contradiction]: an agent that does not bid"),
        ("expect: {within: soon}", "[bad-duration]"),
        ("variants: {tree/0.say: 2}", "[unknown-path]: no node of the agent that has"),
        ("answers: {sing: yes}", "[unknown-name]: the agent's tree uses no skill 'sing'"),
        ("answers: {drive: yes}", "[wrong-type]: the answer of 'drive': it gives nothing back"),
        ("answers: {ask: {gives: a, fails: b}}", "[contradiction]: the answer of 'ask' has"),
        ("answers: {ask: {outputs: {anwser: a}}}", "[unknown-name]: there is no output 'anwser'"),
        ("answers: {ask: {ends: badly}}", "[bad-choice]: 'ends' is 'badly'"),
        ("answers: {ask: {givs: a}}", "[unknown-key]: the answer of 'ask' has no key 'givs'"),
        ("answers: {ask: []}", "[missing-value]: 'ask' has no answer"),
        ("answers: {tree/8.ask: yes}", "[unknown-path]: no node of the agent that uses a skill"),
        ("answers: {ask: '${answer}'}", "[unknown-name]"),
        ("tunables: {patients: 3 s}", "[unknown-name]: the agent has no tunable 'patients'"),
        ("tunables: {patience: 1 h}", "[out-of-range]: 'patience' is 1 h, expected 2 s to 30 s"),
        ("scene: {age: 9}", "[out-of-range]"),
        ("scene: {agee: 4}", "[unknown-name]: there is no scene parameter 'agee'"),
        ("seed: -1", "[out-of-range]"),
        ("clock: {hour: 24}", "[out-of-range]: 'hour' is 24, expected 0 to 23"),
        ("clock: {weekday: sun}", "[bad-choice]: 'weekday' is 'sun'"),
        ("clock: 22:30", "[wrong-type]: 'clock'"),
        ("picks: tree/0.say", "[unknown-path]: no child of a 'random' has the path 'tree/0.say'"),
        ("during: [{after: 2 s, cancel: {reason: a, by: boss}}]", "[bad-choice]: 'by' is 'boss'"),
        ("during: [{after: 2 s, cancel: {by: host}}]", "[missing-key]: 'cancel' needs the key"),
        ("replace: {tree/0.say: skip}", "[bad-choice]: its replacement is 'skip'"),
        ("replace: {tree/0.say: {sya: a}}", "a.test.yaml:5:28: error[unknown-node]: there is no"),
        ("replace: {tree/0.say: {say: '${nobody}'}}", "[unknown-name]: there is no name 'nobody'"),
        ("replace: {tree/0.say: {subtree: x}}", "a.test.yaml:5:37: error[unknown-subtree]"),
        ("expect: {does_not: [dance]}", "[unknown-name]: there is no skill 'dance'"),
        ("during: [{mood: 2}]", "[missing-key]: what happens needs a time"),
        ("during: [{after: 2 s}]", "[missing-key]: nothing happens here"),
        ("during: [{after: 2 s, moood: 1}]", "[unknown-key]: what happens has no key 'moood'"),
        ("during: [{after: 2 s, publish: {topic: bell}}]", "[unknown-name]: no node of the agent"),
        ("during: [{at: tree/7.x, cancel: a}]", "[unknown-path]"),
    ],
)  # fmt: skip
def test_errors_are_reported_with_position(case: str, expected: str) -> None:
    text = f"- name: a\n  {case}\n" + ("" if "expect" in case else "  expect: {ends: failed}\n")
    (line,) = problems(text)
    assert expected in line
    assert line.startswith("a.test.yaml:5:" if "expect: {e" not in text else "a.test.yaml:")


def test_one_pass_reports_all_errors() -> None:
    cases = "- name: a\n- expect: {ends: won}\n- name: b\n  seed: x\n  expect: 3"
    assert len(problems(cases)) == 5


def test_case_names_must_differ() -> None:
    case = "- name: a\n  expect: {ends: failed}\n"
    assert "[name-taken]: there is a case 'a' already (line 4)" in problems(case * 2)[0]


def test_a_file_without_cases_is_refused() -> None:
    assert "[missing-value]: there is no case" in problems("[]")[0]


@pytest.mark.parametrize("name", ["a", "a.yaml"])
def test_agent_is_referenced_by_name_or_file(name: str) -> None:
    text = f"format: 1\ntest: {name}\ncases: [{{name: x, expect: {{ends: failed}}}}]"
    assert read_test_text(text, "a.test.yaml", [AGENT], SYMBOLS).agent is AGENT


def test_unknown_agent_error_suggests_nearest_name() -> None:
    text = "format: 1\ntest: attentive_gide\ncases: [{name: x, expect: {ends: failed}}]"
    error = refusal(read_test_text, text, "a.test.yaml", read_trees(TREES).agents, SYMBOLS)
    assert "did you mean 'attentive_guide'?" in error.report


@pytest.mark.parametrize(
    ("pattern", "path", "fits"),
    [
        ("tree/*.say", "tree/0.say", True),
        ("tree/*.say", "tree/0.sequence/1.say", False),
        ("**/*.say", "tree/0.sequence/1.say", True),
        ("tree/**.say", "tree/0.sequence/1.say", True),
        ("**/0.say", "0.say", True),
        ("**.drive*", "tree/4.drive@timeout", True),
        ("tree/0.s.y", "tree/0.say", False),
        ("**", "tree/0.say", True),
    ],
)
def test_wildcards_match_paths(pattern: str, path: str, fits: bool) -> None:
    assert matches(pattern, path) is fits


def test_broken_agent_file_is_reported_for_its_test(tmp_path: Path) -> None:
    (tmp_path / "porter.yaml").write_text("format: 1\n")
    for name in ("porter", "porter.yaml"):
        text = f"format: 1\ntest: {name}\ncases: [{{name: x, expect: {{ends: failed}}}}]\n"
        test = str(tmp_path / "a.test.yaml")
        [problem] = refusal(read_test_text, text, test, [AGENT], SYMBOLS).diagnostics
        assert problem.code == "unknown-agent"
        assert "cannot be tested, as its file has errors" in problem.message
        assert "possible here" not in problem.hint


def test_replacements_are_bounded_by_tree_size() -> None:
    spec = agent("sequence: [" + "{say: a}, " * 300 + "]")
    many = "{sequence: [" + "{wait: 1 s}, " * (MAX_NODES // 300) + "]}"
    with pytest.raises(ReadError, match="tree-too-large"):
        cases_for(spec, f"- {{name: x, replace: {{'**.say': {many}}}, expect: {{ends: failed}}}}")
