# SPDX-License-Identifier: Apache-2.0
"""Leaves that send, log, remember and report, and values computed for them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.engine.environment import GIVE_FEEDBACK, GoalState
from bt_agents.engine.scripted_environment import GivenFeedback, ScriptedReply
from bt_agents_core.diagnostic import Position
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_language.model.specs import Literal, MapValue, NodeSpec
from tree_harness import TreeHarness, agent, scene, started

TUNABLES = """
tunables:
  patience: {default: 90 s, min: 0 s, max: 5 min, description: d}
  steps: {default: 3, min: 1, max: 9, description: d}
"""


def test_log_writes_line_and_reports_it() -> None:
    harness = TreeHarness(
        """
        sequence:
          - log: The scene is ${scene.age}.
          - log: {message: Something is odd., level: warning}
          - log: {message: Broken., level: error}
        """
    )
    assert harness.tick() == "succeeded"
    assert harness.environment.logged == [
        ("info", "The scene is 3."),
        ("warning", "Something is odd."),
        ("error", "Broken."),
    ]
    assert harness.reports("tree/0.log") == [("SUCCESS", "The scene is 3.")]


def test_repeated_log_line_is_reported_again() -> None:
    harness = TreeHarness("log: once more\nrepeat: 3")
    assert harness.tick(3) == "succeeded"
    assert harness.reports("tree") == [("SUCCESS", "once more")] * 3


def test_instant_skill_reports_each_run_unlike_check() -> None:
    harness = TreeHarness("repeat: 3\nsequence:\n  - check: scene.age == 3\n  - say: x")
    harness.tick(3)
    assert len(harness.reports("tree/1.say")) == 3
    assert len(harness.reports("tree/0.check")) == 1


@pytest.mark.parametrize(
    ("word", "kind"), [("positive", FeedbackKind.POSITIVE), ("negative", FeedbackKind.NEGATIVE)]
)
def test_give_feedback_succeeds_once_accepted(word: str, kind: FeedbackKind) -> None:
    harness = TreeHarness(f"give_feedback: {word}")
    assert harness.tick() == "succeeded"
    assert harness.environment.feedback_given == [GivenFeedback(kind=kind, values={}, reason="")]
    assert harness.reports("tree") == [("SUCCESS", f"{word} feedback given")]


def test_direct_feedback_carries_its_values_and_the_reason() -> None:
    harness = TreeHarness(
        """
        give_feedback:
          kind: direct
          values: {age: "${scene.age + 1}", mood: 5}
          reason: At ${scene.age}.
        """
    )
    assert harness.tick() == "succeeded"
    assert harness.environment.feedback_given == [
        GivenFeedback(kind=FeedbackKind.DIRECT, values={"age": 4.0, "mood": 5.0}, reason="At 3.")
    ]


def test_refused_feedback_fails_with_its_reason() -> None:
    refusal = ScriptedReply(
        state=GoalState.REJECTED, message="the last run had no scene", after_s=1.0
    )
    harness = TreeHarness("give_feedback: positive", answers={GIVE_FEEDBACK: [refusal]})
    assert harness.tick() == "running"
    assert harness.after(1.0) == "failed"
    assert harness.message == "positive feedback rejected: the last run had no scene"


def test_cancel_does_not_wait_for_unanswered_feedback() -> None:
    harness = started(
        "give_feedback: positive", answers={GIVE_FEEDBACK: [ScriptedReply(after_s=99.0)]}
    )
    harness.run.cancel("enough")
    assert harness.outcome == "cancelled"
    assert harness.result.orphans == ()


def feedback(**fields: object) -> NodeSpec:
    return NodeSpec(
        path="tree",
        position=Position(file="a.yaml", line=1, column=1),
        kind="give_feedback",
        name="give_feedback",
        fields=fields,  # type: ignore[arg-type]
    )


def test_direct_feedback_without_values_is_refused() -> None:
    for fields in ({}, {"values": MapValue(items={})}):
        harness = TreeHarness(feedback(kind=Literal(value="direct"), **fields))
        assert harness.tick() == "failed"
        assert harness.message.startswith("direct feedback has no values, expected at least one")
        assert harness.environment.feedback_given == []


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("age", float("nan"), "expected a number between 1 and 5"),
        ("age", float("inf"), "expected a number between 1 and 5"),
        ("age", "old", "age is the text 'old', expected a number between 1 and 5"),
        ("age", True, "expected a number between 1 and 5"),
        ("age", 9.0, "age is 9, expected 1 to 5"),
        ("height", 1.0, "no scene parameter 'height'"),
    ],
)
def test_direct_feedback_refuses_impossible_values(name: str, value: object, words: str) -> None:
    values = MapValue(items={name: Literal(value=value)})  # type: ignore[arg-type]
    harness = TreeHarness(feedback(kind=Literal(value="direct"), values=values))
    assert harness.tick() == "failed"
    assert words in harness.message
    assert harness.environment.feedback_given == []


def test_values_are_computed_on_demand() -> None:
    harness = TreeHarness(
        """
        sequence:
          - set: {count: "${steps + 1}"}
          - say: {text: "${count * 2} steps, at most ${max(steps, 5)}.", rate: "${steps / 4}"}
        """,
        head=TUNABLES,
    )
    assert harness.tick() == "succeeded"
    assert harness.said == ["8 steps, at most 5."]
    assert harness.environment.goals[-1].goal.fields["rate"] == 0.75


def test_uncomputable_value_fails_with_message() -> None:
    harness = TreeHarness("say: '${1 / live.mood}'", awarded=scene(mood=0))
    assert harness.tick() == "failed"
    assert "by zero" in harness.message
    assert "(tree, a.yaml:" in harness.message


def test_quantities_in_text_are_spoken_with_units() -> None:
    harness = started("say: I wait ${patience}, in ${steps} steps.\nrepeat: 2", head=TUNABLES)
    harness.tunables["patience"] = 0.25
    harness.tick()
    assert harness.said == ["I wait 1.5 min, in 3 steps.", "I wait 250 ms, in 3 steps."]


def test_booleans_and_lists_are_spoken_as_words() -> None:
    harness = started(
        """
        sequence:
          - set: {things: [1.0, two, true]}
          - say: ${things}, ${live.person}
        """
    )
    assert harness.said == ["1, two, yes, yes"]


def test_unoffered_skill_fails_with_reason() -> None:
    tree = agent("say: x").tree
    assert tree.skill is not None
    lost = replace(tree.skill, binding=None, unoffered="its type is not installed")
    harness = TreeHarness(replace(tree, skill=lost))
    assert harness.tick() == "failed"
    assert "'say' cannot be done: its type is not installed" in harness.message
    assert harness.asked == []


@pytest.mark.parametrize(
    ("path", "result", "words"),
    [
        ("answer", {"answer": "tea"}, "tea"),
        ("data#drink.0", {"answer": "a", "data": '{"drink": ["milk"]}'}, "milk"),
        ("data#drink", {"answer": "a", "data": '{"food": 1}'}, "'result.data#drink' has no value"),
        ("data#drink", {"answer": "a", "data": "no json"}, "needs a JSON text, but: Expecting"),
        ("data#drink", {"answer": "a", "data": '{"drink": NaN}'}, "NaN is not a number"),
        ("data#drink", {"answer": "a", "data": "[" * 99_000}, "needs a JSON text"),
        ("data#drink", {"answer": "a", "data": 5}, "needs a JSON text of at most"),
    ],
)
def test_output_is_renamed_and_extracted_from_json_text(
    path: str, result: dict[str, Plain], words: str
) -> None:
    tree = agent(
        "sequence:\n  - ask: Which?\n    outputs: {drink: answer}\n  - say: ${drink}"
    ).tree
    ask, say = tree.children
    harness = started(
        replace(tree, children=(replace(ask, outputs={"drink": path}), say)),
        answers={"ask": [ScriptedReply(result=result)]},
    )
    assert words in (harness.said[0] if harness.said else harness.message)


@pytest.mark.parametrize(
    ("condition", "values"),
    [
        ("word == 'yess'", " (word is 'yes')"),
        ("truth", ""),
        ("not scene.person", " (scene.person is true)"),
        ("third > 4 or third < 1", " (third is 3.333)"),
        ("scene.person and truth", " (scene.person is true, truth is false)"),
        ("long == 'x'", f" (long is '{'a' * 39}…')"),
        ("third > 9 and live.age > 1", " (third is 3.333, live.age has no value)"),
        ("large == 1", " (large is 1e+300)"),
        ("1 > 2", ""),
        (
            "scene.mood + third + large + live.mood + scene.familiarity < 0",
            " (scene.mood is 3, third is 3.333, large is 1e+300, live.mood is 3, …)",
        ),
    ],
)
def test_failed_condition_reports_values_of_its_names(condition: str, values: str) -> None:
    harness = TreeHarness(
        f"""
        sequence:
          - set: {{word: yes, truth: false, third: '${{10 / 3}}', long: {"a" * 50}}}
          - set: {{large: 1e300}}
          - check: {condition}
        """,
        awarded=scene(mood=3, familiarity=2),
    )
    assert harness.tick() == "failed"
    assert harness.message == f"not so: {condition}{values}"


def test_unset_name_can_be_tested_and_defaulted() -> None:
    harness = TreeHarness(
        """
        repeat: 3
        sequence:
          - when: known(tries)
            say: again
          - set: {tries: "${tries else 0 + 1}"}
          - say: ${tries}
        """
    )
    harness.tick(20)
    assert harness.said == ["1", "again", "2", "again", "3"]


def test_number_is_parsed_from_answer_or_node_fails() -> None:
    tree = """
        sequence:
          - ask: How strong?
          - set: {pain: "${number(answer)}"}
          - say: It is ${pain + 1}.
        """
    told = TreeHarness(tree, answers={"ask": [ScriptedReply(result={"answer": "about 4"})]})
    assert told.tick() == "succeeded"
    assert told.said == ["It is 5."]
    not_told = TreeHarness(tree, answers={"ask": [ScriptedReply(result={"answer": "no idea"})]})
    assert not_told.tick() == "failed"
    assert "found none in digits in the text 'no idea'" in not_told.message
