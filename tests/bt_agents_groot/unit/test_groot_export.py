# SPDX-License-Identifier: Apache-2.0
"""Export to BehaviorTree.CPP: the result of each node, declarations, and remarks."""

from __future__ import annotations

import textwrap
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_groot.agent_export import ExportedAgent, export_agent
from bt_agents_groot.agent_import import ImportedAgent, import_agent
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.source import Source
from file_texts import read_agent_text, read_skills_text
from tree_harness import SYMBOLS, TREES
from tree_shape import shape

HEAD = "format: 1\nagent: my_agent\nprofile: {age: 3, familiarity: 3, mood: 3}\n"

S = "<AlwaysSuccess/>"
PERSON = '<ScriptCondition code="live__person"/>'


def exported(tree: str, more: str = "") -> ExportedAgent:
    """Return the file for a tree and additional keys of its agent."""
    text = f"{HEAD}{textwrap.dedent(more)}tree:\n{textwrap.indent(textwrap.dedent(tree), '  ')}"
    return export_agent(Source("a.yaml", text), SYMBOLS)


def round_trip(
    text: str, symbols: SymbolTable = SYMBOLS
) -> tuple[str, AgentSpec, ImportedAgent, AgentSpec]:
    """Return the exported file of an agent, the agent, its import, and the imported agent."""
    there = export_agent(Source("a.yaml", text), symbols).text
    made = import_agent(Source("t.xml", there), "my_agent", symbols)
    before, after = (read_agent_text(one, "a.yaml", symbols) for one in (text, made.text))
    return there, before, made, after


def element(tree: str) -> str:
    """Return the element of a tree on one line."""
    main = ET.fromstring(exported(tree).text).find("BehaviorTree")
    assert main is not None
    text = ET.tostring(main[0], encoding="unicode")
    return "".join(line.strip() for line in text.split("\n")).replace(" />", "/>")


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        ("sequence: [check: true, check: false]", f"<Sequence>{S}<AlwaysFailure/></Sequence>"),
        ("selector: {memory: false, children: [check: true, check: false]}",
         "<ReactiveFallback><AlwaysSuccess/><AlwaysFailure/></ReactiveFallback>"),
        ("sequence: {memory: false, children: [say: Hi, check: true]}",
         '<sequence memory="false"><Say text="Hi"/><AlwaysSuccess/></sequence>'),
        ("sequence: {memory: false, children: [check: true, say: Hi]}",
         '<ReactiveSequence><AlwaysSuccess/><Say text="Hi"/></ReactiveSequence>'),
        ("parallel: [check: true, check: true]",
         f'<Parallel success_count="-1" failure_count="1">{S}{S}</Parallel>'),
        ("parallel: {succeed_on: one, children: [check: true, check: true]}",
         f'<Parallel success_count="1" failure_count="2">{S}{S}</Parallel>'),
        ("check: scene.age >= 4 and not live.person",
         '<ScriptCondition code="scene__age &gt;= 4 &amp;&amp; !live__person"/>'),
        ("set: {x: 1, y: it is, z: true}", "<Script code=\"x := 1; y := 'it is'; z := true\"/>"),
        ("wait: 1.5 s", '<Sleep msec="1500"/>'),
        ("wait_for: live.person",
         f'<Precondition if="live__person" else="RUNNING">{S}</Precondition>'),
        ("say: Hello", '<Say text="Hello"/>'),
        ("{name: greet, say: {text: Hello, rate: 0.8}}",
         '<Say name="greet" text="Hello" rate="0.8"/>'),
        ("{ask: Well, outputs: {reply: answer}}", '<Ask text="Well" answer="{reply}"/>'),
        ("{ask: Well, retry: 3}",
         '<RetryUntilSuccessful num_attempts="3"><Ask text="Well" answer="{answer}"/>'
         "</RetryUntilSuccessful>"),
        ("sound: chirp", '<Sound name_="chirp"/>'),
        ("{check: true, repeat: forever, timeout: 5 s}",
         '<Repeat num_cycles="-1"><Timeout msec="5000"><AlwaysSuccess/></Timeout></Repeat>'),
        ("{check: true, invert: true, succeed: true, once: true}",
         "<RunOnce><ForceSuccess><Inverter><AlwaysSuccess/></Inverter></ForceSuccess></RunOnce>"),
        ("{check: true, when: live.person}", '<AlwaysSuccess _skipIf="!live__person"/>'),
        ("{check: true, when: not live.person}", '<AlwaysSuccess _skipIf="live__person"/>'),
        ("{check: true, while: live.person}", f"<WhileDoElse>{PERSON}{S}</WhileDoElse>"),
        ("{check: true, on_failure: {wait: 1 s}}",
         '<Fallback name="on_failure"><AlwaysSuccess/><Sleep msec="1000"/></Fallback>'),
        ("choose: [{name: a, when: live.person, check: true}]",
         f'<IfThenElse>{PERSON}<AlwaysSuccess name="a"/></IfThenElse>'),
        ("log: Hello", '<log message="Hello"/>'),
        ("{check: true, cooldown: 30 s}", f'<cooldown duration="30 s">{S}</cooldown>'),
        ("{check: true, retry: {attempts: 3, pause: 1 s}}",
         '<retry attempts="3" pause="1 s"><AlwaysSuccess/></retry>'),
        ("{check: true, repeat: {until: live.person}}",
         f'<repeat until="live.person">{S}</repeat>'),
        ("{check: true, when: 'max(scene.age, 2) > 3'}",
         '<when condition="max(scene.age, 2) &gt; 3"><AlwaysSuccess/></when>'),
        ("check: scene.age % 2 == 0", '<check condition="scene.age % 2 == 0"/>'),
        ("random: [{weight: 2, say: Hi}, say: Hello]",
         '<random weights="json:[2, 1]"><Say text="Hi"/><Say text="Hello"/></random>'),
        ("random: {repeats: false, children: [say: Hi, say: Hello]}",
         '<random repeats="false"><Say text="Hi"/><Say text="Hello"/></random>'),
        ("publish: {topic: /lamp, type: std_msgs/msg/Bool, message: {data: true}}",
         '<publish topic="/lamp" type="std_msgs/msg/Bool" '
         'message="json:{&quot;data&quot;: true}"/>'),
        ("say: '{who}'", '<Say text="json:&quot;{who}&quot;"/>'),
    ],
)  # fmt: skip
def test_node_becomes_builtin_or_custom_groot_node(tree, expected):
    assert element(tree) == expected


def test_nodes_unknown_to_groot_are_declared_and_listed():
    made = exported("sequence: [say: Hi, log: x, {wait: 1 s, cooldown: 2 s}]")
    models = ET.fromstring(made.text).find("TreeNodesModel")
    assert models is not None
    assert [(one.tag, one.get("ID")) for one in models] == [
        ("Action", "Say"),
        ("Decorator", "cooldown"),
        ("Action", "log"),
    ]
    ports = [(one.tag, one.get("name"), one.get("type"), one.get("default")) for one in models[0]]
    assert ports == [
        ("input_port", "text", "std::string", None),
        ("input_port", "rate", "double", "1.0"),
    ]
    listed = [remark.message for remark in made.remarks if "has no node" in remark.message]
    assert [message.split("'")[1] for message in listed] == ["log", "cooldown"]


def test_tunables_are_ports_of_the_main_tree():
    made = exported(
        "say: {text: Hi, rate: '${speed}'}",
        "tunables: {speed: {default: 0.8, min: 0.5, max: 1.5}, patience: {default: 8 s}}\n",
    )
    ports = ET.fromstring(made.text).findall("TreeNodesModel/SubTree[@ID='MyAgent']/input_port")
    assert [(one.get("name"), one.get("type"), one.get("default")) for one in ports] == [
        ("speed", "double", "0.8"),
        ("patience", "duration", "8 s"),
    ]


def test_subtree_gets_its_tunables_from_callers():
    subtrees = "a: {tree: {subtree: b}}, b: {tree: {wait: '${rest}', timeout: 9 s}}"
    tree = f"tree: {{subtree: a}}\nsubtrees: {{{subtrees}}}\n"
    text, _, made, _ = round_trip(f"{HEAD}tunables: {{rest: {{default: 2 s}}}}\n{tree}")
    assert text.count('<SubTree ID="A" rest="{rest}"/>') == 1
    assert text.count('<SubTree ID="B" rest="{rest}"/>') == 1
    assert not made.remarks


def test_unused_ports_of_subtree_survive_round_trip():
    texts = "{a: {type: text, default: ''}, b: {type: text, default: '{b}'}}"
    part = f"{{inputs: {texts}, outputs: {{c: text}}, tree: {{set: {{c: '${{a}}${{b}}'}}}}}}"
    tree = f"tree: {{subtree: part, outputs: {{}}}}\nsubtrees: {{part: {part}}}\n"
    text, _, made, _ = round_trip(HEAD + tree)
    assert '<SubTree ID="Part" c="{unused_c}"/>' in text
    assert 'default: ""' in made.text
    assert 'default: "{b}"' in made.text
    assert not made.remarks


def test_second_name_for_an_output_is_noted():
    made = exported("{ask: Well, outputs: {p: answer, q: answer}}")
    assert '<Ask text="Well" answer="{p}"/>' in made.text
    assert any("'q' gets no value" in one.message for one in made.remarks)


def test_clean_up_time_is_listed_and_canceller_exported():
    clean_up = "on_cancel: {say: Sorry., when: cancel.by == 'operator'}\non_cancel_within: 5 s\n"
    made = exported("say: Hi", clean_up)
    assert "cancel__by == 'operator'" in made.text
    assert any("on_cancel_within" in remark.message for remark in made.remarks)


def test_main_tree_is_named_and_names_differ():
    names = ("say", "sleep", "my_agent")
    calls = ", ".join(f"subtree: {name}" for name in names)
    subtrees = ", ".join(f"{name}: {{tree: {{say: Hi}}}}" for name in names)
    made = exported(f"sequence: [{calls}]", f"subtrees: {{{subtrees}}}\n")
    root = ET.fromstring(made.text)
    assert root.attrib == {"BTCPP_format": "4", "main_tree_to_execute": "MyAgent"}
    ids = [one.get("ID") for one in root.findall("BehaviorTree")]
    assert ids == ["MyAgent", "Say", "sleep", "my_agent"]


def test_invalid_agent_is_rejected_with_its_errors():
    with pytest.raises(ReadError, match="unknown-node"):
        exported("sya: Hello")


AGENTS = sorted(
    path for path in (TREES / "agents").glob("*.yaml") if not path.name.endswith(".test.yaml")
)


@pytest.mark.parametrize("path", AGENTS, ids=lambda path: path.stem)
def test_shipped_agents_survive_round_trip(path):
    _, agent, made, again = round_trip(path.read_text())
    tree = again.tree
    if agent.tunables:
        # Former tunables are set first; everything else is the same.
        first, *rest = tree.children
        assert first.kind == "set"
        tree = replace(tree, children=tuple(rest))
    assert shape(tree) == shape(agent.tree)
    assert shape(again.on_cancel) == shape(agent.on_cancel)
    assert not made.missing


SHIFT = """
format: 1
skills: {shift: {inputs: {speed: number, far: number}, outputs: {speed: {type: number}}}}
"""


def test_input_and_output_sharing_name_survive_round_trip():
    symbols = SYMBOLS.with_skills(read_skills_text(SHIFT, "skills.yaml"))
    tree = "tree: {sequence: [shift: {speed: 0.3, far: 2}, log: 'it was ${speed}']}\n"
    text, agent, made, again = round_trip(HEAD + tree, symbols)
    assert '<Shift speed="0.3" far="2" speed_out="{speed}"/>' in text
    assert '<output_port name="speed_out" type="double"/>' in text
    assert shape(again.tree) == shape(agent.tree)
    assert not made.missing


def test_name_with_fallback_is_not_initialised():
    tree = "tree: {sequence: [set: {tries: '${tries else 0 + 1}'}, check: tries < 3]}\n"
    _, agent, _, again = round_trip(HEAD + tree)
    assert shape(again.tree) == shape(agent.tree)


@pytest.mark.parametrize(
    "text",
    [
        "tunables: {tries: {default: 3, min: 1, max: 5}}\n"
        "tree: {sequence: [{say: 'At most ${tries}.'}, {ask: Well?, retry: '${tries}'}]}\n",
        "subtrees: {tell: {inputs: {count: integer}, tree: {say: '${count}'}}}\n"
        "tree: {subtree: tell, with: {count: 3}}\n",
    ],
)
def test_number_in_text_is_imported_as_number(text: str) -> None:
    _, _, made, _ = round_trip(HEAD + text)
    assert '"3"' not in made.text
