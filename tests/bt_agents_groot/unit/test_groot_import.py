# SPDX-License-Identifier: Apache-2.0
"""Import from BehaviorTree.CPP: the result of each node, and remarks about the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
import yaml

from bt_agents_groot.agent_import import ImportedAgent, import_agent, skills_file
from bt_agents_groot.catalogue import BUILTINS
from bt_agents_groot.controls import CONTROLS
from bt_agents_groot.nav2_nodes import NAV2_NODES
from bt_agents_groot.simple_nodes import SIMPLE_NODES
from bt_agents_groot.translation import RemarkLevel
from bt_agents_language.model.specs import SkillSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.source import Source
from file_texts import read_agent_text, read_skills_text
from tree_harness import SYMBOLS

S, F = "<AlwaysSuccess/>", "<AlwaysFailure/>"
YES, NO = "check: true", "check: false"
TWICE = "Repeat num_cycles='2'"
UP = "set: {k: '${k + 1}'}"
HOT, COLD = "<ScriptCondition code='hot'/>", "<ScriptCondition code='!hot'/>"
KNOWN = "<Script code=\"hot := true; k := 1; t := 'x'\"/>"


def xml(start: str, *inner: str) -> str:
    """Return an element; ``start`` is its tag with its attributes."""
    return f"<{start}>{''.join(inner)}</{start.split()[0]}>"


def imported(inner: str, more: str = "", symbols: SymbolTable = SYMBOLS) -> ImportedAgent:
    """Return the agent, checked by the reader, for a tree and additional elements."""
    text = f"""<root BTCPP_format="4" main_tree_to_execute="T">
    <BehaviorTree ID="T">{inner}</BehaviorTree>{more}</root>"""
    made = import_agent(Source("folder/t.xml", text), "a", symbols)
    read_agent_text(made.text, "a.yaml", symbols.with_skills(own_skills(made)))
    return made


def own_skills(made: ImportedAgent) -> Mapping[str, SkillSpec]:
    """Return the skills in the file of an imported agent."""
    return read_skills_text(skills_file(made.missing), "new.yaml") if made.missing else {}


def document(made: ImportedAgent) -> dict:
    return yaml.safe_load(made.text)


def tree(inner: str) -> dict:
    return document(imported(inner))["tree"]


def said(made: ImportedAgent, weight: RemarkLevel) -> str:
    return "\n".join(remark.message for remark in made.remarks if remark.level is weight)


@pytest.mark.parametrize(
    ("inner", "expected"),
    [
        (xml("Fallback", S, F), "selector: [check: true, check: false]"),
        (xml("ForceFailure", F), "{fail: true, check: false}"),
        (xml("Repeat num_cycles='{k}'", S), "{repeat: '${k}', check: true}"),
        (xml("KeepRunningUntilFailure", S), "{repeat: forever, check: true}"),
        ("<Sleep msec='250'/>", "wait: 250 ms"),
        ("<Sleep msec='2500'/>", "wait: 2.5 s"),
        ("<Sleep msec='120000'/>", "wait: 2 min"),
        ("<Sleep msec='{k}'/>", "wait: '${k / 1000}'"),
        (xml("Timeout msec='0'", S), "check: true"),
        (xml("Delay delay_msec='500'", S), "sequence: [wait: 500 ms, check: true]"),
        (xml("Parallel", S, F), "parallel: [check: true, check: false]"),
        (
            xml("Parallel success_count='1' failure_count='-1'", S, F),
            "parallel: {succeed_on: one, children: [check: true, check: false]}",
        ),
        (
            xml("Parallel success_count='2' failure_count='2'", S, S, F),
            "parallel: {succeed_on: 2, children: [check: true, check: true, check: false]}",
        ),
        (xml("TryCatch", S, F), f"{{sequence: [{YES}], on_failure: {{fail: true, {NO}}}}}"),
        (xml("Control ID='random' _uid='7' _collapsed='true'", S, F), f"random: [{YES}, {NO}]"),
        (
            xml("Control ID='random' repeats='false'", S, F),
            "random: {repeats: false, children: [check: true, check: false]}",
        ),
        ("<ScriptCondition code='k > 0 && k <3'/>", "check: k > 0 and k < 3"),
        ("<ScriptCondition code='k > 0 &amp;&amp; k &lt; 3'/>", "check: k > 0 and k < 3"),
        (
            f"<IfThenElse>{HOT}{S}<IfThenElse>{COLD}{F}{S}</IfThenElse></IfThenElse>",
            "choose: {children: [{name: case_1, when: hot, check: true}, "
            "{name: case_2, when: not hot, check: false}], otherwise: {check: true}}",
        ),
        (
            f"<WhileDoElse>{HOT}{S}{F}</WhileDoElse>",
            "selector: {memory: false, children: [{while: hot, check: true}, "
            "{while: not hot, check: false}]}",
        ),
        (xml("Precondition if='hot'", F), "sequence: [check: hot, check: false]"),
        (xml("Precondition if='hot' else='SKIPPED'", S), "{when: hot, check: true}"),
        (xml("Precondition if='hot' else='SUCCESS'", S), f"selector: [check: not hot, {YES}]"),
        (xml("Precondition if='hot' else='RUNNING'", F), f"sequence: [wait_for: hot, {NO}]"),
        ("<AlwaysSuccess _failureIf='hot'/>", "sequence: [check: not hot, check: true]"),
        ("<AlwaysSuccess _successIf='hot'/>", "selector: [check: hot, check: true]"),
        (
            "<AlwaysSuccess _failureIf='k == 1' _skipIf='hot'/>",
            "{when: k == 1 or not hot, sequence: [check: not k == 1, check: true]}",
        ),
        ("<AlwaysSuccess _onSuccess='k += 1'/>", f"sequence: [{YES}, {UP}]"),
        ("<AlwaysSuccess _onFailure='k += 1'/>", f"{{{YES}, on_failure: {{fail: true, {UP}}}}}"),
        (
            "<AlwaysSuccess _post='k += 1'/>",
            f"sequence: [{{{YES}, on_failure: {{fail: true, {UP}}}}}, {UP}]",
        ),
        ("<SetBlackboard value='3' output_key='count'/>", "set: {count: 3}"),
        ("<SetBlackboard value='three' output_key='{word}'/>", "set: {word: three}"),
        ("<SetBlackboard value='{t}' output_key='word'/>", "set: {word: '${t}'}"),
        ("<Script code='a := 1; b := a + 1'/>", "sequence: [set: {a: 1}, set: {b: '${a + 1}'}]"),
        ("<Script code=\"a := 'Hello ' .. t .. '!'\"/>", "set: {a: 'Hello ${t}!'}"),
        ("<Script code=\"a := 'Hello ' + t\"/>", "set: {a: 'Hello ${t}'}"),
        ("<Script code=\"a := '${x}'\"/>", "set: {a: '$${x}'}"),
        (
            "<Script code='a := k > 2 ? 1 : 2'/>",
            "choose: {children: [{name: then, when: k > 2, set: {a: 1}}], "
            "otherwise: {set: {a: 2}}}",
        ),
        ("<Action ID='Say' text='Hello.' name='greet'/>", "{name: greet, say: Hello.}"),
        ("<Ask text='Well?' answer='{=}'/>", "ask: Well?"),
        ("<Ask text='Well?' choices='json:[\"a\", 2]'/>", "ask: {text: 'Well?', choices: [a, 2]}"),
        (xml("ForceFailure", xml(TWICE, S)), "{fail: true, repeat: 2, check: true}"),
        (xml(TWICE, xml("ForceFailure", S)), "{repeat: 2, sequence: [{fail: true, check: true}]}"),
        (
            "<Inverter><Timeout msec='9000'><AlwaysSuccess _skipIf='hot'/></Timeout></Inverter>",
            "{when: not hot, invert: true, sequence: [{timeout: 9 s, check: true}]}",
        ),
    ],
)
def test_node_becomes_its_equivalent(inner, expected):
    made = imported(f"<Sequence>{KNOWN}{inner}</Sequence>")
    assert document(made)["tree"]["sequence"][1:] == [yaml.safe_load(expected)]
    assert not made.remarks


@pytest.mark.parametrize(
    ("inner", "note"),
    [
        (xml("SequenceWithMemory", S), "starts again at the first child"),
        (xml("ParallelAll", S), "stops the other children"),
        (xml("Parallel success_count='1'", S, S), "fails after 1 failure;"),
        (xml("RecoveryNode number_of_retries='0'", F, S), "tried once"),
        (xml("RunOnce then_skip='0'", S), "the second time"),
        (xml("Switch2 variable='{k}' case_1='1' case_2='2'", S, S, S), "stays with"),
        ("<AlwaysSuccess _while='hot'/>", "a stopped node has failed here"),
        (xml("WhileDoElse", "<IsClear/>", S, F), "run meanwhile"),
        (xml("ReactiveSequence", "<IsClear/>", "<Sleep msec='9000'/>"), "run meanwhile"),
        (xml("NonblockingSequence", S, S), "do not run again"),
        (xml("RateController hz='2'", S), "every time that it is reached"),
        ("<Repeat num_cycles='2'><Sleep msec='1' _skipIf='hot'/></Repeat>", "left out"),
        ("<Sequence><Sleep msec='1' _skipIf='hot'/></Sequence>", "each of its children is left"),
        (f"<IfThenElse>{HOT}<Sleep msec='1' _skipIf='hot'/></IfThenElse>", "Groot's is left out"),
        (f"<IfThenElse>{S}<Sleep msec='1' _skipIf='hot'/></IfThenElse>", "Groot's is left out"),
        ("<Delay delay_msec='1'><Sleep msec='1' _skipIf='hot'/></Delay>", "Groot's is left out"),
        (xml("RunOnce _failureIf='hot'", S), "Groot's is left out"),
        (
            xml("Precondition if='hot' else='SKIPPED'", "<Sleep msec='1' _skipIf='hot'/>"),
            "left out",
        ),
        ("<Inverter name='a'><AlwaysSuccess name='b'/></Inverter>", "the name 'a'"),
        (f"<Sequence name='{'x' * 70}'>{S}</Sequence>", "shortened"),
        ("<AlwaysSuccess _colour='red'/>", "'_colour' is not read"),
        ("<Say text='Hello ${t}'/>", "taken as a name of our language"),
        ("<Wait seconds='3'/>", "'wait' is a word of our language"),
        (f"<Sequence>text{S}</Sequence>", "the text inside of <Sequence>"),
    ],
)
def test_small_difference_becomes_note_in_file(inner, note):
    made = imported(f"<Sequence>{KNOWN}{inner}</Sequence>")
    assert note in said(made, RemarkLevel.NOTE)
    assert not said(made, RemarkLevel.LOST)
    assert "# note: " in made.text


@pytest.mark.parametrize(
    ("inner", "lost"),
    [
        ("<UnsetBlackboard key='t'/>", '<UnsetBlackboard key="t">'),
        ("<WasEntryUpdated entry='{t}'/>", "<WasEntryUpdated"),
        (xml("LoopInt queue='{list}' value='{v}'", S), "its child comes after a node that fails"),
        (xml("LoopDouble queue='1;inf' value='{v}'", S), "has no equivalent"),
        (xml("WaitValueUpdate entry='{t}'", S), "its child comes after a node that fails"),
        (xml("Decorator ID='Rate' hz='2'", S), '<Rate hz="2"> has no equivalent'),
        (xml("Control ID='Pick'", S, F), "its children come after a node that fails"),
        ("<Script code='k := k &amp; 4'/>", "no operator '&'"),
        ("<Script code='{t}'/>", "is in a blackboard entry"),
        ("<ScriptCondition code='~k &gt; 2'/>", "no operator '~'"),
        ("<AlwaysSuccess _skipIf='k ^ 2'/>", '_skipIf="k ^ 2" is left out'),
        ("<AlwaysSuccess _onHalted='k := 1'/>", "_onHalted"),
        (xml("TryCatch catch_on_halt='true'", S, F), "on_cancel"),
        (xml("Parallel success_count='{k}'", S, F), "'success_count' is {k}"),
        (xml("Precondition if='hot' else='{t}'", S), "FAILURE is assumed"),
        ("<Say text='Hello' volume='3'/>", "our skill 'say' has no field 'volume'"),
        ("<Say text='json:{'/>", "is not JSON"),
        (xml("Control ID='random' weights='json:{'", S), "is not JSON"),
        ("<Script code='scene__age := 4'/>", "'scene.age' cannot be given a value"),
        ("<Script code='x := @t'/>", "the entry '@t' of all trees"),
    ],
)
def test_node_without_equivalent_is_listed_and_commented(inner, lost):
    made = imported(f"<Sequence>{KNOWN}{inner}</Sequence>")
    assert lost in said(made, RemarkLevel.LOST)
    assert "# not translated: " in made.text
    assert "# Not everything could be translated; " in made.text


@pytest.mark.parametrize("node", ["Decorator ID='Rate' hz='2'", "SingleTrigger"])
def test_untranslatable_node_fails_before_its_children_run(node):
    failing, child = tree(xml(node, S))["sequence"]
    assert (failing["fail"], child) == (True, {"check": True})


@pytest.mark.parametrize(
    ("cases", "compared"),
    [
        (("1", "1.5"), ("1", "1.5")),
        (("on", "off"), ("'on'", "'off'")),
        (("1", "off"), ("'1'", "'off'")),
        (("true", "1"), ("'true'", "'1'")),
    ],
)
def test_switch_compares_all_cases_as_one_kind(cases, compared):
    attributes = " ".join(f"case_{number}='{text}'" for number, text in enumerate(cases, 1))
    _, switch = tree(xml(f"Switch2 variable='{{k}}' {attributes}", S, S, F))["sequence"]
    assert [case["when"] for case in switch["choose"]["children"]] == [
        f"k == {text}" for text in compared
    ]


@pytest.mark.parametrize(
    ("loop", "result"), [("Repeat num_cycles", True), ("RetryUntilSuccessful num_attempts", False)]
)
def test_loop_of_zero_iterations_does_nothing(loop, result):
    made = imported(xml(f"{loop}='0'", S))
    assert document(made)["tree"] == {"check": result}
    assert "never done" in said(made, RemarkLevel.NOTE)


@pytest.mark.parametrize(
    ("loop", "values"),
    [
        ("LoopInt queue='1;-2'", [1, -2]),
        ("LoopDouble queue='0.5;2'", [0.5, 2.0]),
        ("LoopBool queue='true;0'", [True, False]),
        ("LoopString queue='hall;gate 2'", ["hall", "gate 2"]),
    ],
)
def test_loop_assigns_values_to_name_in_turn(loop, values):
    _, repeated, empty = tree(xml(f"{loop} value='{{v}}' if_empty='FAILURE'", S))["sequence"]
    counted, choice, child = repeated["sequence"]
    assert [case["set"] for case in choice["choose"]] == [{"v": value} for value in values]
    assert (list(counted["set"]), child, empty) == (["turn_1"], {"check": True}, {"check": False})


def test_controller_in_pipeline_keeps_its_ports():
    made = imported(xml("PipelineSequence", xml("DistanceController distance='1.5'", S), F))
    assert "- distance_controller:\n                  distance: 1.5\n" in made.text
    assert not made.remarks


def test_nested_pipeline_is_written_once():
    assert not imported(xml("PipelineSequence", xml("RateController hz='0.5'", S), F)).remarks
    inner = "<Plan/>"
    for _ in range(4):
        inner = f"<PipelineSequence>{inner}<Follow/></PipelineSequence>"
    assert imported(inner).text.count("plan: {}") == 1


def test_goal_updater_becomes_skill_before_its_child():
    updater = xml("GoalUpdater input_goal='{t}' output_goal='{new}'", "<Go goal='{new}'/>")
    assert tree(f"<Sequence>{KNOWN}{updater}</Sequence>")["sequence"][1] == yaml.safe_load(
        "sequence: [{goal_updater: {input_goal: '${t}'}, outputs: {new: output_goal}}, "
        "go: {goal: '${new}'}]"
    )


def test_longer_path_is_checked_before_the_child():
    made = imported(xml("PathLongerOnApproach prox_len='3.0'", F))
    longer = {"invert": True, "path_longer_on_approach": {"prox_len": 3.0}}
    assert document(made)["tree"] == {"selector": [longer, {"check": False}]}


def test_nav2_ports_have_their_nav2_direction():
    made = imported(
        "<Sequence><IsGoalNearby path='{path}'/>"
        "<ComputePathToPose goal='here' path='{path}' error_code_id='{code}'/>"
        "<WouldAPlannerRecoveryHelp error_code='{code}'/></Sequence>"
    )
    assert {one.name: (list(one.inputs), list(one.outputs)) for one in made.missing} == {
        "is_goal_nearby": (["path"], []),
        "compute_path_to_pose": (["goal"], ["path", "error_code_id"]),
        "would_a_planner_recovery_help": (["error_code"], []),
    }
    assert document(made)["tree"]["sequence"][0]["set"] == {"path": "", "code": 0}


def test_port_omitted_in_one_use_is_optional():
    made = imported("<Sequence><Turn angle='90' speed='0.5'/><Turn angle='30'/></Sequence>")
    assert yaml.safe_load(skills_file(made.missing))["skills"]["turn"]["inputs"] == {
        "angle": "integer",
        "speed": {"type": "number", "default": 0.0},
    }


def test_port_with_default_is_optional():
    model = """<TreeNodesModel><Action ID="Turn">
      <input_port name="angle" type="int"/><input_port name="speed" type="double" default="0.5"/>
      <input_port name="mode" type="int" default="fast"/><output_port name="seen" default="{s}"/>
      </Action></TreeNodesModel>"""
    made = imported("<Turn angle='90'/>", model)
    assert yaml.safe_load(skills_file(made.missing))["skills"]["turn"]["inputs"] == {
        "speed": {"type": "number", "default": 0.5},
        "mode": {"type": "any", "default": "fast"},
        "angle": "integer",
    }


def test_copied_value_has_type_of_its_use():
    made = imported(
        "<Sequence><Script code='a := LIMIT; b := a'/><ScriptCondition code='b > 3'/></Sequence>"
    )
    assert document(made)["tree"]["sequence"][0] == {"set": {"limit": 0.0}}


@pytest.mark.parametrize("before", [" \n ", "// a comment\n", ' <?xml version="1.0"?>\n'])
def test_prolog_before_first_element_is_skipped(before):
    text = f"{before}<root BTCPP_format='4'><BehaviorTree ID='T'>{S}</BehaviorTree></root>"
    assert document(import_agent(Source("t.xml", text), "a", SYMBOLS))["tree"] == {"check": True}


def test_only_trees_called_by_main_tree_are_imported():
    text = f"""<root BTCPP_format="4">
    <BehaviorTree ID="Wanted"><SubTree ID="Part"/></BehaviorTree>
    <BehaviorTree ID="Part">{S}</BehaviorTree>
    <BehaviorTree ID="OnCancel">{F}</BehaviorTree>
    <BehaviorTree ID="Other"><SubTree ID="Nowhere"/></BehaviorTree></root>"""
    made = import_agent(Source("t.xml", text), "a", SYMBOLS, main="Wanted")
    assert document(made)["tree"] == {"subtree": "part"}
    assert list(document(made)["subtrees"]) == ["part"]
    assert document(made)["on_cancel"] == {"check": False}


def test_port_has_one_direction_in_whole_file():
    made = imported(
        "<Sequence><Pick kind='a' job='{j}'/><Do job='{j}'/>"
        "<Pick kind='b' job='{j}'/><Do job='{j}'/></Sequence>"
    )
    pick, do = sorted(made.missing, key=lambda one: one.name, reverse=True)
    assert (list(pick.inputs), list(pick.outputs)) == (["kind"], ["job"])
    assert (list(do.inputs), list(do.outputs)) == (["job"], [])


def test_port_with_reserved_name_is_renamed():
    made = imported("<Announce msg='hello' times='2'/>")
    [announce] = made.missing
    assert list(announce.inputs) == ["msg_value", "times"]
    assert "so it is called 'msg_value'" in said(made, RemarkLevel.NOTE)


def test_untranslated_leaf_fails_with_message():
    assert tree("<UnsetBlackboard key='x'/>") == {
        "fail": True,
        "log": {"message": 'not translated: <UnsetBlackboard key="x">', "level": "error"},
    }


def test_every_builtin_node_has_a_translator():
    assert CONTROLS.keys() | SIMPLE_NODES.keys() | NAV2_NODES.keys() == BUILTINS.keys()


def test_descriptions_become_comments():
    made = imported(xml("Sequence _description='first&#10;second'", S))
    assert "tree:\n  # first\n  # second\n  sequence:\n" in made.text


def test_externally_set_names_are_initialised_first():
    made = imported(
        "<Sequence><Say text='{greeting}' rate='{speed}'/>"
        "<ScriptCondition code='battery &gt; 20 &amp;&amp; ready'/></Sequence>"
    )
    assert document(made)["tree"]["sequence"][0] == {
        "set": {"greeting": "", "speed": 0.0, "battery": 0.0, "ready": False}
    }


@pytest.mark.parametrize(
    "inner",
    [
        f"<IfThenElse>{S}<Script code='x := 1'/><ScriptCondition code='x > 1'/></IfThenElse>",
        "<AlwaysSuccess _onSuccess='x := 1' _post='y := x + 1'/>",
        "<Script code='x := hot ? 1 : x + 1'/>",
    ],
)
def test_name_written_in_another_case_is_initialised(inner):
    made = imported(f"<Sequence>{inner}<ScriptCondition code='x > 1'/></Sequence>")
    assert document(made)["tree"]["sequence"][0]["set"]["x"] == 0


def test_names_are_converted_and_stay_distinct():
    assert tree("<Script code='Goal := 1; goal := 2; myGoal := 3; result := 4'/>")["set"] == {
        "goal": 1, "goal_2": 2, "my_goal": 3, "result_2": 4,
    }  # fmt: skip


SUB = """<BehaviorTree ID="GoThere"><Sequence>
    <Say text="{place}"/><Script code="count += 1; done := true"/></Sequence></BehaviorTree>"""


def test_subtree_gets_inputs_and_outputs_from_uses():
    made = imported(
        "<Sequence><Script code='tries := 1'/>"
        "<SubTree ID='GoThere' place='hall' count='{tries}' done='{arrived}'/>"
        "<ScriptCondition code='arrived'/></Sequence>",
        SUB,
    )
    assert document(made)["tree"]["sequence"][1] == {
        "subtree": "go_there",
        "with": {"place": "hall", "count_in": "${tries}"},
        "outputs": {"tries": "count", "arrived": "done"},
    }
    assert document(made)["subtrees"]["go_there"] == yaml.safe_load(
        """
        inputs: {place: any, count_in: any}
        outputs: {count: any, done: any}
        tree:
          sequence:
            - set: {count: "${count_in}"}
            - say: ${place}
            - set: {count: "${count + 1}", done: true}
        """
    )


def test_autoremap_passes_all_names_to_subtree():
    made = imported(
        "<Sequence><Script code=\"place := 'hall'; count := 0\"/>"
        "<SubTree ID='GoThere' _autoremap='true'/></Sequence>",
        SUB,
    )
    assert document(made)["tree"]["sequence"][1] == {
        "subtree": "go_there",
        "with": {"place": "${place}", "count_in": "${count}"},
        "outputs": {"count": "count", "done": "done"},
    }


def test_subtree_models_give_types_and_defaults():
    model = """<TreeNodesModel><SubTree ID="GoThere">
      <input_port name="place" type="std::string" default="desk"/></SubTree></TreeNodesModel>"""
    made = imported("<SubTree ID='GoThere' count='2'/>", SUB + model)
    assert document(made)["subtrees"]["go_there"]["inputs"]["place"] == {
        "type": "text",
        "default": "desk",
    }
    assert document(made)["tree"]["with"] == {"count_in": 2}


def test_stale_type_in_subtree_model_is_ignored():
    model = """<TreeNodesModel><SubTree ID="GoThere"><input_port name="count" type="std::string"/>
      <output_port name="done" type="int"/></SubTree></TreeNodesModel>"""
    made = imported("<SubTree ID='GoThere' place='hall' count='2' done='{d}'/>", SUB + model)
    assert document(made)["tree"]["with"] == {"place": "hall", "count_in": 2}
    assert document(made)["subtrees"]["go_there"]["outputs"] == {"done": "any"}


ASKS = """<BehaviorTree ID="Asks"><ScriptCondition code="way == 'true' &amp;&amp; lid == 'shut'"/>
    </BehaviorTree>"""


def test_value_compared_with_text_is_text():
    model = """<TreeNodesModel>
      <SubTree ID="Asks"><input_port name="way" default="false"/></SubTree>
      <SubTree ID="T"><input_port name="lid" default="true"/></SubTree></TreeNodesModel>"""
    made = imported(
        "<Sequence><ScriptCondition code=\"lid != 'shut'\"/>"
        "<SubTree ID='Asks' way='true' lid='3'/><SubTree ID='Asks' lid='{lid}'/></Sequence>",
        ASKS + model,
    )
    first, _, call, _ = document(made)["tree"]["sequence"]
    assert first == {"set": {"lid": "true"}}
    assert call["with"] == {"way": "true", "lid": "3"}
    assert document(made)["subtrees"]["asks"]["inputs"]["way"]["default"] == "false"


def test_subtree_port_default_may_reference_outer_name():
    model = """<TreeNodesModel><SubTree ID="Asks"><input_port name="way" default="{road}"/>
      <input_port name="lid" default="{=}"/></SubTree></TreeNodesModel>"""
    made = imported("<SubTree ID='Asks' lid='shut'/>", ASKS + model)
    assert document(made)["tree"]["sequence"][1]["with"] == {"way": "${road}", "lid": "shut"}


def test_models_of_several_files_are_merged():
    first = "<TreeNodesModel><Action ID='Go'><input_port name='x'/></Action></TreeNodesModel>"
    second = "<TreeNodesModel><Action ID='Go'><input_port name='y'/></Action></TreeNodesModel>"
    assert list(imported("<Go x='1' y='2'/>", first + second).missing[0].inputs) == ["x", "y"]


def test_plus_of_text_names_joins_texts():
    made = imported("<Script code=\"a := 'x'; b := '1'; c := a + b\"/>")
    assert document(made)["tree"]["sequence"][1] == {"set": {"c": "${a}${b}"}}


def test_missing_and_unused_subtree_inputs_are_listed():
    made = imported("<SubTree ID='GoThere' count='2' Speed='3'/>", SUB)
    assert "nothing says what 'place' is" in said(made, RemarkLevel.LOST)
    assert "'Speed' is not passed on" in said(made, RemarkLevel.NOTE)


def test_subtree_that_can_be_left_out_is_noted():
    part = f"<BehaviorTree ID='Part'><Sequence _skipIf='true'>{S}</Sequence></BehaviorTree>"
    made = imported("<Fallback><SubTree ID='Part'/></Fallback>", part)
    assert "when the whole tree is left out" in said(made, RemarkLevel.NOTE)


def test_included_file_is_listed():
    made = imported("<SubTree ID='Elsewhere' a='{=}'/>", '<include path="more.xml"/>')
    assert '<include path="more.xml"> is not followed' in said(made, RemarkLevel.LOST)
    assert document(made)["tree"]["sequence"][1] == {"elsewhere": {"a": "${a}"}}


WAVE = """<TreeNodesModel><Action ID="WaveHand">
    <input_port name="side" type="std::string"/><input_port name="times" type="int"/>
    <output_port name="seen" type="bool"/></Action></TreeNodesModel>"""


def test_port_missing_in_model_is_noted():
    made = imported("<WaveHand side='left' speed='3'/>", WAVE)
    assert document(made)["tree"] == {"wave_hand": {"side": "left", "speed": 3}}
    assert said(made, RemarkLevel.NOTE) == "the model of <WaveHand> has no such port"


def test_inout_port_of_declared_skill_stays_connected():
    model = WAVE.replace("input_port", "inout_port")
    made = imported("<WaveHand side='{k}'/>", model)
    again = imported("<WaveHand side='{k}'/>", model, SYMBOLS.with_skills(own_skills(made)))
    assert not imported("<WaveHand side='left'/>", model).missing[0].outputs
    calls = [document(one)["tree"]["sequence"][1] for one in (made, again)]
    assert calls == [
        {"wave_hand": value, "outputs": {"k": "side"}} for value in ({"side": "${k}"}, "${k}")
    ]


def test_undeclared_skills_come_with_declaration_file():
    made = imported(
        "<Sequence><WaveHand side='left' times='{n}' seen='{seen}'/>"
        "<PlayTune melody='happy' volume='3'/><ScriptCondition code='seen'/></Sequence>",
        WAVE,
    )
    assert [skill.name for skill in made.missing] == ["play_tune", "wave_hand"]
    skills = own_skills(made)
    assert [one.name for one in skills["wave_hand"].inputs] == ["side", "times"]
    assert [one.name for one in skills["wave_hand"].outputs] == ["seen"]
    assert "#   wave_hand:" in made.text


def test_unmodelled_port_is_output_if_value_is_used():
    made = imported("<Sequence><FindFace face='{face}'/><Say text='{face}'/></Sequence>")
    assert document(made)["tree"]["sequence"][0] == {
        "find_face": {}, "outputs": {"face": "face"},
    }  # fmt: skip
    assert "'face' is taken as an output" in said(made, RemarkLevel.NOTE)


@pytest.mark.parametrize("line_end", ["&#13;", "&#10;", "&#13;&#10;"])
def test_multiline_description_stays_a_comment(line_end):
    text = f"""<root BTCPP_format="4"><BehaviorTree ID="T" _description="a{line_end}on_cancel: b">
    {S}</BehaviorTree></root>"""
    made = import_agent(Source("t.xml", text), "a", SYMBOLS)
    assert "  # a\n  # on_cancel: b\n" in made.text
    assert "on_cancel" not in document(made)


def test_imported_agent_is_complete_with_default_profile():
    made = imported(S)
    agent = read_agent_text(made.text, "a.yaml", SYMBOLS)
    assert agent.name == "a"
    assert agent.profile == tuple(one.default for one in SYMBOLS.space.parameters)
    assert made.text.startswith("# Made from t.xml by 'bt-agents import groot'.")


def test_imported_profile_has_only_profiled_parameters():
    mood = replace(SYMBOLS.space.parameter("mood"), profiled=False)
    others = (SYMBOLS.space.parameter("age"), SYMBOLS.space.parameter("familiarity"))
    symbols = replace(SYMBOLS, space=replace(SYMBOLS.space, parameters=(mood, *others)))
    text = f"<root BTCPP_format='4'><BehaviorTree ID='T'>{S}</BehaviorTree></root>"
    made = import_agent(Source("t.xml", text), "a", symbols)
    assert list(document(made)["profile"]) == ["age", "familiarity"]
    assert read_agent_text(made.text, "a.yaml", symbols).profile
