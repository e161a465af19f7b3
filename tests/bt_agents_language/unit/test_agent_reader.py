# SPDX-License-Identifier: Apache-2.0
"""Agent files, the specs that they become, and how economically they are read."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from dataclasses import replace

import pytest

from agent_texts import agent_of, problems_of, refusal
from bt_agents_core.errors import ReadError
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import BindingKind
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.mood_rule import MoodAction
from bt_agents_language.model.specs import (
    AgentSpec,
    ListValue,
    Literal,
    MapValue,
    NodeSpec,
    Reference,
    Text,
    iter_nodes,
)
from bt_agents_language.nodes.catalogue import DECORATORS
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tree.subtrees import MAX_NODES
from fake_interfaces import FakeInterfaces
from file_texts import read_agent_text
from tree_harness import SPACE, SYMBOLS, agent


def errors(text: str, symbols: SymbolTable = SYMBOLS) -> list[str]:
    found = refusal(agent_of, text, symbols)
    return [line.removeprefix("a.yaml:") for line in found.lines]


def test_agent_head_is_read():
    spec = read_agent_text(
        """\
format: 1
agent: guide
title: A guide
description: >
  Two
  lines.
tags: [airport, 24]
profile: {mood: 3, age: 4.5, familiarity: 1}
learning_rate: 0.3
requires: scene.person and scene.age >= 2
feedback:
  - {when: mood.change <= -1, for: 500 ms, give: negative, then: cancel}
  - {when: live.age > scene.age, give: positive}
tree: {wait: 0}
on_cancel: {light: red}
""",
        "guide.yaml",
        SYMBOLS,
    )
    assert (spec.name, spec.title, spec.description) == ("guide", "A guide", "Two lines.")
    assert (spec.tags, spec.profile) == (("airport", "24"), (4.5, 1.0, 3.0))
    assert (spec.learning_rate, spec.requires.text) == (0.3, "scene.person and scene.age >= 2")
    assert [(one.when.text, one.hold_s, one.give, one.action) for one in spec.rules] == [
        ("mood.change <= -1", 0.5, FeedbackKind.NEGATIVE, MoodAction.CANCEL),
        ("live.age > scene.age", 0.0, FeedbackKind.POSITIVE, MoodAction.NONE),
    ]
    assert spec.on_cancel.path == "on_cancel"


def test_omitted_keys_have_defaults():
    spec = agent_of("tree: {wait: 0}\n")
    assert (spec.title, spec.description, spec.tags) == ("a", "", ())
    assert (spec.learning_rate, spec.requires, spec.rules) == (0.2, None, ())
    assert spec.on_cancel is None


@pytest.mark.parametrize(("switch", "other"), [("succeed", "fail"), ("fail", "succeed")])
def test_modifiers_wrap_nodes_in_fixed_order(switch, other):
    tree = f"""
    invert: true
    timeout: 1 min
    repeat: 2
    retry: 3
    on_failure: {{say: sorry}}
    {switch}: true
    while: scene.person
    cooldown: 2 s
    once: true
    when: scene.person
    name: greet them all
    say: x
    """
    spec = agent(tree).tree
    kinds = []
    while spec.kind != "say":
        kinds.append(spec.kind)
        assert spec.path == f"tree@{spec.kind}"
        spec = spec.children[0]
    assert kinds == [key for key in DECORATORS if key != other]
    assert (spec.path, spec.name) == ("tree", "greet them all")


def test_modifiers_carry_their_fields():
    spec = agent(
        "say: x\nretry: ${n}\nrepeat: 2\ntimeout: 1.5 min",
        "tunables: {n: {default: 2, min: 1, max: 3}}",
    )
    retry = spec.tree
    assert retry.fields == {"attempts": Reference(name="n")}
    repeat = retry.children[0]
    assert repeat.fields == {"times": Literal(value=2)}
    assert repeat.children[0].fields == {"limit": Literal(value=90.0)}


def test_paths_are_places_in_the_tree():
    spec = agent(
        """
        sequence:
          - say: x
            name: Say / it @ twice!
          - selector:
              children:
                - wait: 1 s
                  timeout: 2 s
                  on_failure: {sequence: [{say: sorry}]}
              memory: false
          - subtree: greet
            with: {who: Ann}
          - subtree: greet
            with: {who: Bob}
        """,
        head="subtrees: {greet: {inputs: {who: text}, tree: {sequence: [{say: '${who}'}]}}}",
    ).tree
    assert [node.path for node in iter_nodes(spec)] == [
        "tree",
        "tree/0.Say_it_twice",
        "tree/1.selector",
        "tree/1.selector/0.wait@on_failure",
        "tree/1.selector/0.wait@timeout",
        "tree/1.selector/0.wait",
        "tree/1.selector/0.wait@on_failure/0.sequence",
        "tree/1.selector/0.wait@on_failure/0.sequence/0.say",
        "tree/2.subtree",
        "tree/2.subtree/greet",
        "tree/2.subtree/greet/0.say",
        "tree/3.subtree",
        "tree/3.subtree/greet",
        "tree/3.subtree/greet/0.say",
    ]


def test_unnamed_node_is_named_after_its_action():
    spec = agent(
        """
        sequence:
          - say: Hello. I carry your luggage.
          - check: scene.familiarity >= 4
          - wait: 8 s
          - sound: beep
          - set: {a: 1, b: 2}
          - light: {colour: red}
          - service: {name: /reset, type: std_srvs/srv/Trigger}
        """
    ).tree
    assert [child.name for child in spec.children] == [
        'say "Hello. I carry your lug…"',
        "check scene.familiarity >= 4",
        "wait 8 s",
        'sound "beep"',
        "set a, b",
        'light "red"',
        "service /reset",
    ]


@pytest.mark.parametrize(
    ("tree", "fields"),
    [
        ("sequence: [{wait: 1}]", {"memory": True}),
        ("selector: {memory: false, children: [{wait: 1}]}", {"memory": False}),
        ("parallel: [{wait: 1}]", {"succeed_on": "all"}),
        ("say: {text: Hi}", {"text": "Hi", "rate": 1.0}),
    ],
)
def test_omitted_fields_have_defaults(tree, fields):
    found = agent(tree).tree.fields
    assert found == {name: Literal(value=value) for name, value in fields.items()}


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("Hello", Literal(value="Hello")),
        ("true", Literal(value="true")),
        ("${place}", Reference(name="place")),
        ("${ place }", Reference(name="place")),
        ("to ${place}!", Text(parts=("to ", Reference(name="place"), "!"))),
        ("${place}${place}", Text(parts=(Reference(name="place"), Reference(name="place")))),
        # A value that is not a text is spoken as one.
        ("${scene.age}", Text(parts=(Reference(name="scene.age"),))),
        ("$${place}", Literal(value="${place}")),
        ("$$${place}", Literal(value="$${place}")),
        ("5 $", Literal(value="5 $")),
    ],
)
def test_texts_hold_names(written, value):
    spec = agent(f"say: {written}", head="tunables: {place: {default: gate 12}}").tree
    assert spec.fields["text"] == value


def test_any_typed_values_keep_their_types():
    spec = agent(
        "set: {a: 1, b: 1.5, c: yes, d: true, e: [1, x], f: {g: '${scene.age}'}, h: 2 s}"
    ).tree
    assert spec.fields == {
        "a": Literal(value=1),
        "b": Literal(value=1.5),
        "c": Literal(value="yes"),
        "d": Literal(value=True),
        "e": ListValue(items=(Literal(value=1), Literal(value="x"))),
        "f": MapValue(items={"g": Reference(name="scene.age")}),
        "h": Literal(value=2.0),
    }


def test_leaves_that_name_ros_directly_are_unnamed_skills():
    spec = agent(
        """
        sequence:
          - action:
              name: /dock
              type: some_msgs/action/Dock
              goal: {speed: "${scene.age}"}
              outputs: {spot: result.place.name}
              succeed_when: result.ok and scene.person
          - publish: {topic: beep, type: std_msgs/msg/String, message: {data: "${spot}"}}
        """
    ).tree
    dock, beep = spec.children
    assert dock.kind == "action"
    binding = dock.skill.binding
    known = (binding.kind, binding.name, binding.type)
    assert known == (BindingKind.ACTION, "/dock", "some_msgs/action/Dock")
    assert binding.fields == MapValue(items={"speed": Reference(name="scene.age")})
    assert binding.outputs == {"spot": "place.name"}
    assert binding.succeed_when is not None
    assert beep.skill.binding.kind is BindingKind.TOPIC


def test_wait_for_has_condition_over_message():
    spec = agent("wait_for: {topic: a, type: b/msg/C, until: msg.x.y > 1 and scene.person}").tree
    until = spec.fields["until"]
    assert isinstance(until, Expression)
    assert until.names == {"msg.x.y", "scene.person"}


@pytest.mark.parametrize(
    ("tree", "code"),
    [
        ("wait: ${time}", ""),
        ("wait: ${amount}", ""),
        ("wait: ${integer}", ""),
        ("wait: ${flag}", "wrong-value"),
        ("say: {text: x, rate: '${time}'}", ""),
        ("say: {text: x, rate: '${text}'}", "wrong-value"),
        ("say: x\nretry: ${integer}", ""),
        ("light: {colour: red, blink: '${flag}'}", ""),
        ("light: {colour: red, blink: '${integer}'}", "wrong-value"),
        ("say: ${flag}", ""),
        ("check: amount > 1 and flag and text == 'x' and time > 1", ""),
        ("check: text > 1", "bad-expression"),
    ],
)
def test_referenced_name_must_have_fitting_type(tree, code):
    head = """
    tunables:
      time: {default: 2 s}
      amount: {default: 2.0, min: 1, max: 3}
      integer: {default: 2, min: 1, max: 3}
      text: {default: x}
      flag: {default: true}
    """
    assert [one.code for one in problems_of(agent, tree, head)] == [code] * bool(code)


def test_set_gives_name_type_of_its_values():
    with pytest.raises(ReadError, match="expected a time such as '8 s', but 'a' is a text"):
        agent("sequence:\n  - set: {a: x}\n  - wait: ${a}")
    agent("sequence:\n  - set: {a: 1}\n  - set: {a: 2 s}\n  - wait: ${a}")


def test_subtree_inputs_have_defaults():
    spec = agent(
        "subtree: greet",
        "subtrees: {greet: {inputs: {who: {type: text, default: you}}, tree: {say: '${who}'}}}",
    ).tree
    assert spec.kind == "subtree"
    assert spec.fields == {"who": Literal(value="you")}
    assert spec.children[0].fields["text"] == Reference(name="who")


def test_input_is_a_name_only_of_its_subtree():
    subtrees = "subtrees: {g: {inputs: {a: text}, tree: {say: '${a}'}}}\n"
    assert errors(f"tree: {{say: '${{a}}'}}\n{subtrees}") == [
        "4:16: error[unknown-name]: there is no name 'a' here"
    ]
    assert errors(f"tunables: {{a: {{default: x}}}}\ntree: {{say: x}}\n{subtrees}") == [
        "6:25: error[name-taken]: there is a tunable 'a' already"
    ]


def test_broken_tunable_remains_a_known_name():
    assert errors("tunables: {a: {default: 9, min: 1, max: 2}}\ntree: {say: '${a}'}\n") == [
        "4:25: error[out-of-range]: the default of tunable 'a' is 9, expected 1 to 2"
    ]


def test_scene_without_mood_has_no_mood_change():
    space = SceneSpace(
        parameters=(SceneParameter(name="age", minimum=1, maximum=5, default=3),), mood=None
    )
    text = (
        "format: 1\nagent: a\nprofile: {age: 3}\n"
        "feedback: [{when: mood.change > 1, give: positive}]\ntree: {check: mood.change > 1}\n"
    )
    error = refusal(read_agent_text, text, "a.yaml", SymbolTable(space, {}))
    assert [line.split(": ")[0] for line in error.lines] == ["a.yaml:4:19", "a.yaml:5:15"]
    assert "scene.yaml does not say which parameter is the mood" in error.report


def test_all_trees_share_one_node_limit():
    say = "- {say: x}\n" * (MAX_NODES // 2)
    text = f"tree:\n  sequence:\n{say}on_cancel:\n  sequence:\n{say}"
    second = MAX_NODES // 2 + 7
    assert errors(text.replace("- ", "    - "))[0].startswith(f"{second}:3: error[tree-too-large]")


def test_unknown_ros_types_and_fields_are_positioned_errors():
    tree = """\
tree:
  sequence:
    - action: {name: a, type: other/action/X}
    - action: {name: a, type: known_msgs/action/X, goal: {good: {bad: 1}}}
    - service: {name: a, type: known_msgs/srv/X, request: {good: [{good: 1}, {bad: 1}]}}
    - service: {name: a, type: known_msgs/srv/X, succeed_when: result.bad}
    - action: {name: a, type: known_msgs/action/X, outputs: {x: result.bad}}
    - publish: {topic: a, type: known_msgs/msg/X, message: {bad: 1}}
    - wait_for: {topic: a, type: known_msgs/msg/X, until: msg.good and msg.bad}
    - wait_for: {topic: a, type: other/msg/X, until: msg.bad}
"""
    assert errors(tree, SymbolTable(SPACE, SYMBOLS.skills, FakeInterfaces())) == [
        "6:31: error[unknown-ros-type]: no ROS type 'other/action/X'",
        "7:66: error[unknown-ros-field]: known_msgs/action/X: no field 'good.bad' in the goal",
        "8:79: error[unknown-ros-field]: known_msgs/srv/X: no field 'good.1.bad' in the request",
        "9:64: error[unknown-ros-field]: no field 'bad' in the response",
        "10:65: error[unknown-ros-field]: no field 'bad' in the result",
        "11:61: error[unknown-ros-field]: known_msgs/msg/X: no field 'bad' in the message",
        "12:72: error[unknown-ros-field]: no field 'bad' in the message",
        "13:34: error[unknown-ros-type]: no ROS type 'other/msg/X'",
    ]


@pytest.mark.parametrize(
    "tree",
    [
        "tree:\n  set: {greeting: {one_of: [Hello., Hi.]}}\n",
        "subtrees: {greet: {inputs: {text: text}, tree: {say: '${text}'}}}\n"
        "tree:\n  subtree: greet\n  with: {text: {one_of: [Hello., Hi.]}}\n",
    ],
)
def test_text_variants_are_allowed_only_as_skill_text(tree):
    (problem,) = [one for one in problems_of(agent_of, tree) if one.code == "wrong-type"]
    assert "only the main text of a skill can be one of several" in problem.message
    assert "'random' with a node for each" in problem.hint


TREE = """\
tree:
  sequence:
    - check: scene.age >= 4
    - say: {text: "You are ${scene.age}."}
      timeout: 5 s
    - choose:
        children:
          - name: old
            when: scene.age >= 4
            say: Hello.
        otherwise: {subtree: part}
subtrees:
  part: {tree: {wait: 1 s}}
"""


def of_kind(agent: AgentSpec, kind: str) -> list[NodeSpec]:
    return [spec for spec in iter_nodes(agent.tree) if spec.kind == kind]


@pytest.fixture
def collector() -> Iterator[None]:
    """Restore the state of the collector."""
    was_on = gc.isenabled()
    yield
    gc.enable() if was_on else gc.disable()


@pytest.mark.usefixtures("collector")
@pytest.mark.parametrize("text", [TREE, TREE.replace("scene.age >= 4", "scene.aeg >= 4")])
def test_reader_leaves_no_reference_cycles(text: str) -> None:
    problems_of(agent_of, text)
    gc.collect()
    gc.disable()
    problems_of(agent_of, text)
    assert gc.collect() == 0


@pytest.mark.usefixtures("collector")
@pytest.mark.parametrize("on", [True, False])
@pytest.mark.parametrize("text", [TREE, "tree: {sya: Hello.}\n"])
def test_reader_restores_garbage_collector_state(text: str, on: bool) -> None:
    gc.enable() if on else gc.disable()
    problems_of(agent_of, text)
    assert gc.isenabled() is on


def test_repeated_condition_is_stored_once() -> None:
    agent = agent_of(TREE)
    (check,) = of_kind(agent, "check")
    (case,) = (one for one in of_kind(agent, "case") if one.fields)
    assert check.fields["condition"] is case.fields["condition"]


def test_same_text_with_other_types_is_another_condition() -> None:
    tree = "tree: {check: x == 'a'}\n"
    assert of_kind(agent_of(f"tunables: {{x: {{default: a}}}}\n{tree}"), "check")
    with pytest.raises(ReadError, match="cannot compare a number with a text"):
        agent_of(f"tunables: {{x: {{default: 1, min: 0, max: 2}}}}\n{tree}")


def test_nodes_share_omitted_defaults() -> None:
    agent = agent_of("tree: {sequence: [{say: Hello.}, {say: Good bye.}]}\n")
    first, second = of_kind(agent, "say")
    assert first.fields["rate"] is second.fields["rate"]
    assert first.outputs is second.outputs


def test_moved_node_changes_only_path_and_children() -> None:
    for spec in iter_nodes(agent_of(TREE).tree):
        assert spec.moved("x", ()) == replace(spec, path="x", children=())
