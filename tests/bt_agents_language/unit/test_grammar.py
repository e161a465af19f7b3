# SPDX-License-Identifier: Apache-2.0
"""Composites, decorators and leaves of the language, and the nodes that they become."""

from __future__ import annotations

import pytest

from agent_texts import problems_of
from bt_agents_core.diagnostic import Diagnostic
from bt_agents_language.model.specs import Computed, Literal, NodeSpec, Reference, iter_nodes
from tree_harness import agent


def tree(text: str, head: str = "") -> NodeSpec:
    return agent(text, head).tree


def problems(text: str, head: str = "") -> list[str]:
    """Return 'code: message' of every error of a tree."""
    return [f"{one.code}: {one.message}" for one in problems_of(agent, text, head)]


@pytest.mark.parametrize(("written", "value"), [("1", 1), ("[one]", (0,)), ("all", "all")])
def test_parallel_accepts_count_or_child_names(written, value):
    text = f"parallel: {{succeed_on: {written}, children: [{{say: a, name: one}}, {{say: b}}]}}"
    assert tree(text).fields["succeed_on"] == Literal(value=value)


def test_choose_has_named_cases_and_otherwise():
    spec = tree(
        """
        choose:
          children:
            - name: young
              when: scene.age < 2
              say: Hi!
            - name: old
              when: scene.age > 4
              timeout: 5 s
              say: Good morning.
          otherwise: {say: Hello.}
        """
    )
    cases = spec.children
    assert [case.kind for case in cases] == ["case"] * 3
    told = [
        (case.name, case.path, getattr(case.fields.get("condition"), "text", "")) for case in cases
    ]
    assert told == [
        ("young", "tree/0.young@when", "scene.age < 2"),
        ("old", "tree/1.old@when", "scene.age > 4"),
        ("otherwise", "tree/2.say@when", ""),
    ]
    assert cases[1].children[0].kind == "timeout"


def test_when_under_otherwise_has_its_own_path():
    spec = tree(
        """
        choose:
          children: [{name: young, when: scene.age < 2, say: Hi!}]
          otherwise: {say: Hello., when: scene.age > 4}
        """
    )
    paths = [node.path for node in iter_nodes(spec)]
    assert paths[-3:] == ["tree/1.say@case", "tree/1.say@when", "tree/1.say"]


def test_random_has_weights():
    children = "[{say: a, weight: 3}, {say: b}, {fail: true, say: c}]"
    spec = tree(f"random: {{seed: 7, children: {children}}}")
    assert spec.fields == {"seed": Literal(value=7)}
    assert [c.kind for c in spec.children] == ["weight"] * 3
    assert [c.fields["weight"] for c in spec.children] == [
        Literal(value=3.0), Literal(value=1.0), Literal(value=1.0),
    ]  # fmt: skip
    assert spec.children[0].path == "tree/0.say@weight"


def test_retry_and_repeat_have_long_forms():
    retry = tree("{say: x, retry: {attempts: forever, pause: 2 s}}")
    assert retry.fields == {"attempts": Literal(value="forever"), "pause": Literal(value=2.0)}
    repeat = tree("{say: x, repeat: {until: live.mood > 4, pause: 1 s}}")
    assert repeat.fields["times"] == Literal(value="forever")
    assert getattr(repeat.fields["until"], "text", "") == "live.mood > 4"


def test_skipped_node_fails_only_under_selector():
    text = "selector: [{say: x, once: true}, {say: y, cooldown: 3 s}]"
    once, cooldown = tree(text).children
    assert once.fields == {"otherwise": Literal(value="failure")}
    assert cooldown.fields["duration"] == Literal(value=3.0)
    for composite in ("sequence", "parallel"):
        skipped = tree(f"{composite}: [{{say: x, when: scene.person, timeout: 1 s}}]").children[0]
        assert skipped.fields["otherwise"] == Literal(value="success")


def test_false_switch_adds_no_modifier():
    assert tree("{say: x, once: false, succeed: false, invert: false}").kind == "say"


def test_wait_for_accepts_condition_or_message():
    assert getattr(tree("wait_for: live.person").fields["condition"], "text", "") == "live.person"
    held = tree("wait_for: {condition: live.mood >= 3, for: 2 s}")
    assert held.fields["for"] == Literal(value=2.0)
    heard = "wait_for: {topic: go, type: std_msgs/msg/Bool, until: msg.data, outputs: {w: data}}"
    assert tree(heard).outputs == {"w": "data"}


def test_log_and_give_feedback_have_short_forms():
    log = tree("log: hello")
    assert log.fields == {"message": Literal(value="hello"), "level": Literal(value="info")}
    assert tree("give_feedback: positive").fields == {"kind": Literal(value="positive")}


def test_a_reference_can_be_an_expression():
    spec = tree("sequence: [{set: {n: 1}}, {set: {n: '${n + 1}'}}, {say: '${n * 2} times'}]")
    value = spec.children[1].fields["n"]
    assert isinstance(value, Computed)
    assert value.expression.text == "n + 1"


def test_error_points_at_wrong_token_in_text_expression():
    (problem,) = problems_of(agent, "say: You are ${scene.agee + 1} years old.")
    assert (problem.code, str(problem.position)) == ("unknown-name", "a.yaml:8:18")


def test_skill_outputs_can_be_renamed():
    spec = tree("sequence: [{ask: Who?, outputs: {who: answer}}, {say: 'Hello ${who}.'}]")
    assert spec.children[0].outputs == {"who": "answer"}
    assert spec.children[1].fields["text"].parts[1] == Reference(name="who")  # type: ignore[union-attr]


SUBTREE = """
subtrees:
  ask_name:
    inputs: {question: text}
    outputs: {name: text}
    tree:
      sequence:
        - ask: {text: "${question}"}
        - set: {name: "${answer}"}
"""


def test_subtree_exposes_only_its_outputs_to_caller():
    text = "sequence:\n  - subtree: ask_name\n    with: {question: Who?}\n  - say: Hello ${name}."
    spec = tree(text, SUBTREE)
    assert spec.children[0].outputs == {"name": "name"}
    renamed = text.replace("with:", "outputs: {who: name}\n    with:").replace("{name}", "{who}")
    assert tree(renamed, SUBTREE).children[0].outputs == {"who": "name"}


@pytest.mark.parametrize(
    "text",
    [
        "{ask: Well?, when: answer == 'yes'}",
        "{say: '${answer}', on_failure: {ask: Well?}}",
        "{ask: '${answer}'}",
    ],
)
def test_name_without_value_yet_is_an_error(text):
    found = problems(text)
    assert [line.split(":")[0] for line in found] == ["no-value-yet"]
    assert "gives it one later" in found[0]


@pytest.mark.parametrize(
    "text",
    [
        "selector: [{ask: Well?}, {say: '${answer}'}]",
        "parallel: [{say: '${answer}'}, {ask: Well?}]",
        "sequence: {memory: false, children: [{say: '${answer}'}, {ask: Well?}]}",
        "{ask: Well?, retry: {attempts: 2}, on_failure: {say: '${answer}'}}",
        "{repeat: 2, selector: [{say: '${answer}'}, {ask: Well?}]}",
        "{ask: Well?, repeat: {until: answer == 'yes'}}",
        "sequence: [{random: [{ask: x}, {set: {answer: a}}]}, {say: '${answer}'}]",
    ],
)
def test_name_is_usable_wherever_it_may_have_value(text):
    assert tree(text) is not None


def test_on_cancel_may_read_names_written_by_tree():
    spec = agent("ask: Well?", "on_cancel: {say: '${answer}'}")
    assert spec.on_cancel is not None


TUNABLES = """
tunables:
  far: {default: 2 m, min: 1 m, max: 3 m}
  patience: {default: 2 s, min: 1 s, max: 9 s}
"""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("wait: ${patience * 2 + 1}", ""),
        ("wait: ${max(patience, 3)}", ""),
        ("check: patience > 3 and far between 1 and 2", ""),
        ("say: 'I am ${far / 2} away, ${round(far)} about.'", ""),
        ("check: far / patience > 1", ""),
        ("wait: ${patience + far}", "bad-expression"),
        ("wait: ${abs(far)}", "wrong-value"),
        ("wait: ${patience * patience}", "bad-expression"),
        ("check: patience > far", "bad-expression"),
        ("check: patience between 1 and far", "bad-expression"),
        ("check: min(patience, far) > 1", "bad-expression"),
        ("sequence: [{set: {c: '${far}'}}, {wait: '${c}'}]", "wrong-value"),
    ],
)
def test_quantities_keep_their_dimension_in_expressions(text, expected):
    assert [line.split(":")[0] for line in problems(text, TUNABLES)] == [expected] * bool(expected)


MEASURE = "subtrees: {{measure: {{outputs: {{level: {0}}}, tree: {{{1}}}}}, inner: {2}}}"
INNER = "{outputs: {level: text}, tree: {set: {level: four}}}"


def measured(output: str, leaf: str) -> Diagnostic:
    """Return the only problem of a subtree with the output 'level'."""
    (problem,) = problems_of(agent, "subtree: measure", MEASURE.format(output, leaf, INNER))
    return problem


def test_number_output_cannot_come_from_a_text():
    problem = measured("number", "ask: x, outputs: {level: answer}")
    assert problem.message == "output 'level': expected a number, but 'ask' gives it a text"
    assert "declare it as it is, {level: text}, or give it another value" in problem.hint
    problem = measured("number", "subtree: inner")
    assert problem.message == "output 'level': expected a number, but 'subtree' gives it a text"


@pytest.mark.parametrize(
    ("output", "value", "message", "hint"),
    [
        ("number", "four", "'level': expected a number, found 'four'", ""),
        ("boolean", "flase", "'level': expected true or false, found 'flase'", "write false"),
        ("boolean", "'${1 + 1}'", "expected true or false, but '1 + 1' gives a number", ""),
        ("duration", "3 m", "'level'", ""),
    ],
)
def test_set_value_is_read_as_declared_output_type(output, value, message, hint):
    problem = measured(output, f"set: {{level: {value}}}")
    assert message in problem.message
    assert hint in problem.hint


def test_number_set_into_text_output_becomes_text():
    spec = tree("subtree: measure", MEASURE.format("text", "set: {level: 12}", INNER))
    assert spec.children[0].fields["level"] == Literal(value="12")


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        (
            "sequence: [set: {came: false}, set: {came: flase}]",
            "'came' gets a text here, but true or false from 'set' in line 8",
            "did you mean 'false'?",
        ),
        (
            "sequence:\n  - set: {answer: 1}\n  - ask: x\n",
            "'answer' gets a text here, but a number from 'set' in line 9",
            "",
        ),
    ],
)
def test_second_type_for_name_is_rejected(text, message, hint):
    (problem,) = problems_of(agent, text)
    assert message in problem.message
    assert hint in problem.hint


def test_skills_may_share_output_name_across_types():
    tree("sequence: [ask: x, {drive: x, outputs: {answer: remaining}}]")
