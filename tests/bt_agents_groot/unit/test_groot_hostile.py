# SPDX-License-Identifier: Apache-2.0
"""Files that are not trees of Groot2, or bad ones: every problem has a code and a place."""

from __future__ import annotations

import random
import time

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_groot.agent_import import import_agent
from bt_agents_language.reference.codes import codes
from bt_agents_language.yaml.source import Source
from tree_harness import SYMBOLS


def problems(text: str) -> list[str]:
    """Return ``code line:column`` of every error of an XML text."""
    try:
        import_agent(Source("t.xml", text), "a", SYMBOLS)
    except ReadError as error:
        return [
            f"{one.code} {one.position.line}:{one.position.column}" for one in error.diagnostics
        ]
    return []


def tree(inner: str, head: str = "") -> str:
    """Return a file with one tree; its contents are in line 3."""
    return f'<root BTCPP_format="4"{head}>\n<BehaviorTree ID="T">\n{inner}\n</BehaviorTree></root>'


BOMB = (
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;">]>'
    '<root BTCPP_format="4"><BehaviorTree ID="&c;"><AlwaysSuccess/></BehaviorTree></root>'
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ["empty-file 1:1"]),
        ("no XML at all", ["xml-syntax 1:1"]),
        ("<root", ["xml-syntax 1:1"]),
        ("<root>", ["xml-syntax 1:7"]),
        ("<root></rot>", ["xml-syntax 1:9"]),
        ("<root/><root/>", ["xml-syntax 1:8"]),
        ('<root a="1" a="2"/>', ["xml-syntax 1:13"]),
        ('<root a="<"/>', ["xml-root 1:1"]),
        ("<root>&nbsp;</root>", ["xml-syntax 1:7"]),
        (BOMB, ["xml-doctype 1:1"]),
        ('<?x <!-- ?><!DOCTYPE r [<!ENTITY a "b">]><root/>', ["xml-doctype 1:12"]),
        ("<html><body/></html>", ["xml-root 1:1"]),
        ('<root BTCPP_format="4"/>', ["xml-root 1:1"]),
        (tree("<AlwaysSuccess/>").replace('"4"', '"3"'), ["wrong-format 1:7"]),
        (
            f"<root>{'<BehaviorTree><AlwaysSuccess/></BehaviorTree>' * 2}</root>",
            ["missing-attribute 1:7", "missing-attribute 1:52"],
        ),
        (tree(""), ["wrong-children 2:1"]),
        (tree("<AlwaysSuccess/><AlwaysFailure/>"), ["wrong-children 2:1"]),
        (tree("<Sequence/>"), ["wrong-children 3:1"]),
        (tree("<Sleep msec='1'><AlwaysSuccess/></Sleep>"), ["wrong-children 3:1"]),
        (tree("<IfThenElse><AlwaysSuccess/></IfThenElse>"), ["wrong-children 3:1"]),
        (tree("<Sleep/>"), ["missing-attribute 3:1"]),
        (tree("<SubTree/>"), ["missing-attribute 3:1"]),
        (tree("<Sleep msec='soon'/>"), ["bad-attribute 3:8"]),
        (tree("<Sleep msec='-1'/>"), ["bad-attribute 3:8"]),
        (tree("<Sleep msec='99999999999999999999'/>"), ["bad-attribute 3:8"]),
        (tree("<Repeat num_cycles='-2'><AlwaysSuccess/></Repeat>"), ["bad-attribute 3:9"]),
        (tree("<RunOnce then_skip='no'><AlwaysSuccess/></RunOnce>"), ["bad-attribute 3:10"]),
        (tree("<Sleep msec='1' sec='2'/>"), ["unknown-attribute 3:17"]),
        (tree("<Script code='x :='/>"), ["bad-script 3:19"]),
        (tree("<Sleep msec='1' _skipIf='a &amp;&amp; &lt; b'/>"), ["bad-script 3:39"]),
        (tree("<SubTree ID='T'/>"), ["recursion 3:10"]),
        (tree("<AlwaysSuccess/>", " main_tree_to_execute='U'"), ["unknown-subtree 1:24"]),
        (tree("<Say text='a\u202eb'/>"), ["bad-character 3:12"]),
        (tree("<Say text='a&#x202e;b'/>"), ["bad-character 3:12"]),
        (tree(f"<Say text='{'a' * 20001}'/>"), ["too-long 3:12"]),
        (tree("<Inverter>" * 70), ["too-deep 3:621"]),
        (tree("<Sequence>" + "<AlwaysSuccess/>" * 10_000), ["too-many-values 3:159963"]),
        (tree("<Say text='" + "a" * 2**20 + "'/>"), ["too-large 1:1"]),
    ],
)
def test_invalid_file_is_rejected_with_code_and_position(text, expected):
    assert problems(text) == expected


def test_one_pass_reports_all_problems():
    text = tree(
        "<Sequence><Sleep/><Sleep msec='x'/><Script code='1 +'/><Inverter/>"
        "<Repeat num_cycles='3' times='3'><AlwaysSuccess/></Repeat></Sequence>"
    )
    assert [problem.split()[0] for problem in problems(text)] == [
        "missing-attribute",
        "bad-attribute",
        "bad-script",
        "wrong-children",
        "unknown-attribute",
    ]


def test_several_trees_need_a_main_tree():
    trees = "".join(f'<BehaviorTree ID="{one}"><AlwaysSuccess/></BehaviorTree>' for one in "AB")
    assert problems(f'<root BTCPP_format="4">{trees}</root>') == ["missing-attribute 1:1"]
    twice = trees.replace('"B"', '"A"')
    assert problems(f'<root BTCPP_format="4">{twice}</root>')[0].startswith("name-taken")


def test_subtree_cycle_is_rejected_with_its_path():
    circle = "".join(
        f'<BehaviorTree ID="{a}"><SubTree ID="{b}"/></BehaviorTree>' for a, b in ("AB", "BC", "CA")
    )
    with pytest.raises(ReadError, match="A → B → C → A"):
        import_agent(
            Source("t.xml", f'<root main_tree_to_execute="A">{circle}</root>'), "a", SYMBOLS
        )


def test_children_are_checked_against_models_of_file():
    model = '<TreeNodesModel><Action ID="Wave"/></TreeNodesModel>'
    text = tree("<Wave><AlwaysSuccess/></Wave>").replace("</root>", f"{model}</root>")
    assert problems(text) == ["wrong-children 3:1"]


def test_declared_xml_encoding_is_ignored():
    text = '<?xml version="1.0" encoding="ISO-8859-1"?>' + tree("<Say text='Grüß Gott'/>")
    assert "Grüß Gott" in import_agent(Source("t.xml", text), "a", SYMBOLS).text


def test_randomly_damaged_file_is_accepted_or_quickly_rejected():
    sound = tree(
        "<Sequence name='s'><Script code=\"x := 1; y := 'a' .. x\"/><Timeout msec='500'>"
        "<Say text='{x}' _skipIf='x > 2'/></Timeout><SubTree ID='U' a='{x}' _autoremap='1'/>"
        "</Sequence></BehaviorTree><BehaviorTree ID='U'><ScriptCondition code='a == 1'/>"
    )
    pieces = ["<", ">", "/", "'", '"', "&", "{", "}", ";", ":=", "\x00", "ü", "<a>", "-1", " ", ""]
    dice = random.Random(7)
    start = time.process_time()
    for _ in range(400):
        at = dice.randrange(len(sound))
        damaged = sound[:at] + dice.choice(pieces) + sound[at + dice.randrange(4) :]
        assert {problem.split()[0] for problem in problems(damaged)} <= set(codes())
    assert time.process_time() - start < 20
