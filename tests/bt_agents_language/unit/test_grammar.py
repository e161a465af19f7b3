# SPDX-License-Identifier: Apache-2.0
"""Composites, decorators and leaves of the language, and the nodes that they become."""

from __future__ import annotations

import textwrap

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_language.model.specs import Computed, Literal, NodeSpec, Reference, iter_nodes
from tree_harness import agent


def tree(text: str, head: str = "") -> NodeSpec:
    return agent(text, head).tree


def problems(text: str, head: str = "") -> list[str]:
    """Return 'code: message' of every error of a tree."""
    with pytest.raises(ReadError) as caught:
        agent(text, head)
    return [line.split("error[")[1].replace("]:", ":", 1) for line in caught.value.lines]


def test_parallel_accepts_count_or_child_names():
    text = "parallel: {{succeed_on: {0}, children: [{{say: a, name: one}}, {{say: b}}]}}"
    assert tree(text.format("1")).fields["succeed_on"] == Literal(value=1)
    assert tree(text.format("[one]")).fields["succeed_on"] == Literal(value=(0,))
    assert tree(text.format("all")).fields["succeed_on"] == Literal(value="all")
    assert problems(text.format("3")) == ["out-of-range: 'succeed_on' is 3, expected 1 to 2"]
    assert problems(text.format("[two]")) == ["unknown-name: no child is called 'two'"]
    assert problems(text.format("some"))[0].startswith("bad-choice: 'succeed_on' is 'some'")


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
    assert [case.name for case in cases] == ["young", "old", "otherwise"]
    assert [case.path for case in cases] == [
        "tree/0.young@when", "tree/1.old@when", "tree/2.say@when",
    ]  # fmt: skip
    conditions = [case.fields.get("condition") for case in cases]
    assert [str(getattr(c, "text", "")) for c in conditions] == [
        "scene.age < 2", "scene.age > 4", "",
    ]  # fmt: skip
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


@pytest.mark.parametrize(
    ("case", "missing"), [("{say: x}", "'name', 'when'"), ("{say: x, when: true}", "'name'")]
)
def test_a_case_needs_a_name_and_a_condition(case, missing):
    found = problems(f"choose: [{case}]")
    assert len(found) == 1
    assert found[0].startswith("missing-key: a case of 'choose' needs the key")
    assert missing in found[0]


def test_random_has_weights():
    children = "[{say: a, weight: 3}, {say: b}, {fail: true, say: c}]"
    spec = tree(f"random: {{seed: 7, children: {children}}}")
    assert spec.fields == {"seed": Literal(value=7)}
    assert [c.kind for c in spec.children] == ["weight"] * 3
    assert [c.fields["weight"] for c in spec.children] == [
        Literal(value=3.0), Literal(value=1.0), Literal(value=1.0),
    ]  # fmt: skip
    assert spec.children[0].path == "tree/0.say@weight"
    assert problems("{say: a, weight: 3}")[0].startswith("misplaced-key: 'weight' stands beside")
    assert problems("random: [{say: a, weight: -1}]")[0].startswith("out-of-range: ")


def test_retry_and_repeat_have_long_forms():
    retry = tree("{say: x, retry: {attempts: forever, pause: 2 s}}")
    assert retry.fields == {"attempts": Literal(value="forever"), "pause": Literal(value=2.0)}
    repeat = tree("{say: x, repeat: {until: live.mood > 4, pause: 1 s}}")
    assert repeat.fields["times"] == Literal(value="forever")
    assert getattr(repeat.fields["until"], "text", "") == "live.mood > 4"
    assert tree("{say: x, repeat: forever}").fields == {"times": Literal(value="forever")}
    assert problems("{say: x, repeat: {pause: 1 s}}") == [
        "missing-key: 'repeat' needs the key 'times' or 'until'"
    ]
    assert problems("{say: x, retry: always}")[0].startswith("bad-number: ")


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
    assert problems("{say: x, once: 3}")[0].startswith("wrong-type: 'once': expected true")


def test_wait_for_accepts_condition_or_message():
    assert getattr(tree("wait_for: live.person").fields["condition"], "text", "") == "live.person"
    held = tree("wait_for: {condition: live.mood >= 3, for: 2 s}")
    assert held.fields["for"] == Literal(value=2.0)
    spec = tree(
        """
        wait_for: {topic: go, type: std_msgs/msg/String, until: msg.data != '', outputs: {w: data}}
        """
    )
    assert spec.outputs == {"w": "data"}
    assert problems("wait_for: {topic: go}") == [
        "missing-key: 'wait_for' needs a condition, or the keys 'topic', 'type'"
    ]
    both = "wait_for: {condition: live.person, topic: go, type: std_msgs/msg/Bool}"
    assert problems(both)[0].startswith("misplaced-key: 'topic' is about a message")


def test_log_and_give_feedback_have_short_forms():
    log = tree("log: hello")
    assert log.fields == {"message": Literal(value="hello"), "level": Literal(value="info")}
    assert tree("give_feedback: positive").fields == {"kind": Literal(value="positive")}
    assert problems("give_feedback: direct") == [
        "missing-key: direct feedback needs the values that the profile moves to"
    ]
    assert problems("give_feedback: {kind: positive, values: {age: 3}}")[0].startswith(
        "misplaced-key: positive feedback takes the scene"
    )
    assert problems("give_feedback: {kind: direct, values: {agee: 3, mood: 9}}") == [
        "unknown-name: there is no scene parameter 'agee'",
        "out-of-range: mood is 9, expected 1 to 5",
    ]


def test_a_reference_can_be_an_expression():
    spec = tree("sequence: [{set: {n: 1}}, {set: {n: '${n + 1}'}}, {say: '${n * 2} times'}]")
    value = spec.children[1].fields["n"]
    assert isinstance(value, Computed)
    assert value.expression.text == "n + 1"
    assert problems("say: '${scene.age + }'")[0].startswith("bad-expression: ")
    assert problems("say: '${agee + 1}'")[0].startswith("unknown-name: there is no name 'agee'")


def test_error_points_at_wrong_token_in_text_expression():
    with pytest.raises(ReadError) as caught:
        agent("say: You are ${scene.agee + 1} years old.")
    assert caught.value.lines[0].startswith("a.yaml:8:18: error[unknown-name]")


def test_skill_outputs_can_be_renamed():
    spec = tree("sequence: [{ask: Who?, outputs: {who: answer}}, {say: 'Hello ${who}.'}]")
    assert spec.children[0].outputs == {"who": "answer"}
    assert spec.children[1].fields["text"].parts[1] == Reference(name="who")  # type: ignore[union-attr]
    assert problems("{ask: Who?, outputs: {who: anser}}") == [
        "unknown-name: skill 'ask' has no output 'anser'"
    ]
    assert problems("{wait: 1 s, outputs: {a: b}}")[0].startswith("misplaced-key: ")


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
    assert problems(text.replace("${name}", "${answer}"), SUBTREE) == [
        "unknown-name: there is no name 'answer' here"
    ]
    renamed = text.replace("with:", "outputs: {who: name}\n    with:").replace("{name}", "{who}")
    assert tree(renamed, SUBTREE).children[0].outputs == {"who": "name"}
    assert problems(text, SUBTREE.replace('name: "$', 'nome: "$')) == [
        "unwritten-output: no node of subtree 'ask_name' gives its output 'name' a value"
    ]


@pytest.mark.parametrize(
    "text",
    [
        "sequence: [{say: '${answer}'}, {ask: Well?}]",
        "{ask: Well?, when: answer == 'yes'}",
        "choose: [{name: a, when: true, ask: x}, {name: b, when: true, say: '${answer}'}]",
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
        "sequence: [{ask: Well?}, {say: '${answer}'}]",
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


def test_duration_in_place_of_length_is_an_error():
    head = """
    subtrees:
      approach: {inputs: {distance: length, turn: angle}, tree: {say: "${distance} ${turn}"}}
    """
    call = "{{subtree: approach, with: {{distance: {0}, turn: {1}}}}}"
    spec = tree(call.format("1.5 m", "90 deg"), head)
    assert spec.fields["distance"] == Literal(value=1.5)
    found = problems(call.format("5 s", "90 deg"), head)
    assert len(found) == 1
    assert "length" in found[0]
    tunables = "tunables: {t: {default: 5 s}}" + textwrap.dedent(head)
    assert problems(call.format('"${t}"', "1"), tunables)[0].startswith("wrong-value: ")


def test_errors_below_misspelt_composite_are_found():
    assert problems("sequnce: [{sya: x}, {say: [1]}]") == [
        "unknown-node: there is no node or skill 'sequnce'",
        "unknown-node: there is no node or skill 'sya'",
        "wrong-type: 'say': expected a text, found a list",
    ]


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
    if expected:
        assert [line.split(":")[0] for line in problems(text, TUNABLES)] == [expected]
    else:
        tree(text, TUNABLES)
