# SPDX-License-Identifier: Apache-2.0
"""Leaves that send, log, remember and report, and values computed for them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.engine.environment import GIVE_FEEDBACK, GoalState
from bt_agents.engine.scripted_environment import GivenFeedback, ScriptedReply
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import Literal, MapValue, Value
from tree_harness import TreeHarness, agent, failure, scene, started

TUNABLES = """
tunables:
  patience: {default: 90 s, min: 0 s, max: 5 min, description: d}
  steps: {default: 3, min: 1, max: 9, description: d}
"""


def test_log_writes_line_and_reports_it() -> None:
    levels = "{log: {message: Odd., level: warning}}, {log: {message: Broken., level: error}}"
    harness = started(f"sequence: [{{log: 'The scene is ${{scene.age}}.'}}, {levels}]")
    lines = [("info", "The scene is 3."), ("warning", "Odd."), ("error", "Broken.")]
    assert harness.environment.logged == lines
    assert harness.reports("tree/0.log") == [("SUCCESS", "The scene is 3.")]


def test_text_that_repeats_itself_is_bounded() -> None:
    tenfold = "${z}" * 10
    harness = TreeHarness(f"sequence: [set: {{z: a}}, {{set: {{z: '{tenfold}'}}, repeat: 9}}]")
    harness.tick(9)
    assert "the text has 1,000,000 characters, expected at most 100,000" in harness.message


def test_side_effects_are_reported_each_time_unlike_checks() -> None:
    harness = TreeHarness("repeat: 3\nsequence: [{check: scene.age == 3}, {say: x}, {log: y}]")
    harness.tick(3)
    paths = ("tree/0.check", "tree/1.say", "tree/2.log")
    assert [len(harness.reports(path)) for path in paths] == [1, 3, 3]


@pytest.mark.parametrize("kind", [FeedbackKind.POSITIVE, FeedbackKind.NEGATIVE])
def test_give_feedback_succeeds_once_accepted(kind: FeedbackKind) -> None:
    word = kind.name.lower()
    harness = started(f"give_feedback: {word}")
    assert harness.environment.feedback_given == [GivenFeedback(kind=kind, values={}, reason="")]
    assert harness.reports("tree") == [("SUCCESS", f"{word} feedback given")]


def test_direct_feedback_carries_its_values_and_the_reason() -> None:
    values = "{age: '${scene.age + 1}', mood: 5}"
    harness = started(
        f"give_feedback: {{kind: direct, values: {values}, reason: 'At ${{scene.age}}.'}}"
    )
    assert harness.environment.feedback_given == [
        GivenFeedback(kind=FeedbackKind.DIRECT, values={"age": 4.0, "mood": 5.0}, reason="At 3.")
    ]


def test_refused_feedback_fails_with_its_reason() -> None:
    refusal = ScriptedReply(
        state=GoalState.REJECTED, message="the last run had no scene", after_s=1.0
    )
    harness = TreeHarness("give_feedback: positive", answers={GIVE_FEEDBACK: [refusal]})
    assert harness.outcomes(0, 1) == "RF"
    assert harness.message == "positive feedback rejected: the last run had no scene"


def test_cancel_does_not_wait_for_unanswered_feedback() -> None:
    harness = started(
        "give_feedback: positive", answers={GIVE_FEEDBACK: [ScriptedReply(after_s=99.0)]}
    )
    harness.run.cancel("enough")
    assert harness.outcome == "cancelled"
    assert harness.result.orphans == ()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (None, "direct feedback has no values, expected at least one"),
        ({}, "direct feedback has no values, expected at least one"),
        ({"age": float("nan")}, "expected a number between 1 and 5"),
        ({"age": float("inf")}, "expected a number between 1 and 5"),
        ({"age": "old"}, "age is the text 'old', expected a number between 1 and 5"),
        ({"age": True}, "expected a number between 1 and 5"),
        ({"age": 9.0}, "age is 9, expected 1 to 5"),
        ({"height": 1.0}, "no scene parameter 'height'"),
    ],
)
def test_direct_feedback_refuses_impossible_values(
    values: dict[str, Plain] | None, words: str
) -> None:
    fields: dict[str, Value | Expression] = {"kind": Literal(value="direct")}
    if values is not None:
        items = {name: Literal(value=value) for name, value in values.items()}
        fields["values"] = MapValue(items=items)
    spec = agent("give_feedback: positive").tree
    harness = started(replace(spec, fields=fields))
    assert harness.outcome == "failed"
    assert words in harness.message
    assert harness.environment.feedback_given == []


def test_quantities_in_text_are_spoken_with_units() -> None:
    harness = started(
        "say: I wait ${patience}, in ${max(steps, 5)} steps.\nrepeat: 2", head=TUNABLES
    )
    harness.tunables["patience"] = 0.25
    harness.tick()
    assert harness.said == ["I wait 1.5 min, in 5 steps.", "I wait 250 ms, in 5 steps."]


def test_booleans_and_lists_are_spoken_as_words() -> None:
    tree = "sequence: [{set: {things: [1.0, two, true]}}, {say: '${things}, ${live.person}'}]"
    assert started(tree).said == ["1, two, yes, yes"]


def test_unoffered_skill_fails_with_reason() -> None:
    tree = agent("say: x").tree
    assert tree.skill is not None
    lost = replace(tree.skill, binding=None, unoffered="its type is not installed")
    harness = started(replace(tree, skill=lost))
    assert "'say' cannot be done: its type is not installed" in harness.message
    assert harness.asked == []


@pytest.mark.parametrize(
    ("path", "data", "words"),
    [
        ("answer", "", "tea"),
        ("data#drink.0", '{"drink": ["milk"]}', "milk"),
        ("data#drink", '{"food": 1}', "'result.data#drink' has no value"),
        ("data#drink", "no json", "needs a JSON text, but: Expecting"),
        ("data#drink", '{"drink": NaN}', "NaN is not a number"),
        ("data#drink", "[" * 99_000, "needs a JSON text"),
        ("data#drink", 5, "needs a JSON text of at most"),
    ],
)
def test_output_is_renamed_and_extracted_from_json_text(
    path: str, data: Plain, words: str
) -> None:
    tree = agent("sequence: [{ask: Which?, outputs: {drink: answer}}, {say: '${drink}'}]").tree
    ask, say = tree.children
    harness = started(
        replace(tree, children=(replace(ask, outputs={"drink": path}), say)),
        answers={"ask": [ScriptedReply(result={"answer": "tea", "data": data})]},
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
        ("1 > 2", ""),
        (
            "scene.mood + third + large + live.mood + scene.familiarity < 0",
            " (scene.mood is 3, third is 3.333, large is 1e+300, live.mood is 3, …)",
        ),
    ],
)
def test_failed_condition_reports_values_of_its_names(condition: str, values: str) -> None:
    given = f"{{word: yes, truth: false, third: '${{10 / 3}}', long: {'a' * 50}, large: 1e300}}"
    message = failure(
        f"sequence:\n  - set: {given}\n  - check: {condition}",
        awarded=scene(mood=3, familiarity=2),
    )
    assert message == f"not so: {condition}{values}"


def test_unset_name_can_be_tested_and_defaulted() -> None:
    counts = "{set: {tries: '${tries else 0 + 1}'}}, {say: '${tries}'}"
    harness = TreeHarness(f"repeat: 3\nsequence: [{{when: known(tries), say: again}}, {counts}]")
    harness.tick(20)
    assert harness.said == ["1", "again", "2", "again", "3"]


@pytest.mark.parametrize(
    ("answer", "said", "message"),
    [("about 4", ["It is 5."], ""), ("no idea", [], "found none in digits in the text 'no idea'")],
)
def test_number_is_parsed_from_answer_or_node_fails(
    answer: str, said: list[str], message: str
) -> None:
    number = "{set: {pain: '${number(answer)}'}}, {say: 'It is ${pain + 1}.'}"
    harness = started(
        f"sequence: [{{ask: How strong?}}, {number}]",
        answers={"ask": [ScriptedReply(result={"answer": answer})]},
    )
    assert harness.said == said
    assert message in harness.message
