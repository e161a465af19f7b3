# SPDX-License-Identifier: Apache-2.0
"""Warnings about valid agents."""

from __future__ import annotations

import time

import pytest

from bt_agents_language.tools.lint import cut_texts, lint
from bt_agents_language.yaml.source import Source
from tree_harness import agent


def found(tree: str, head: str = "") -> list[str]:
    """Return the warnings as 'code line:column'; the first line of the tree is the eighth."""
    warnings = lint(agent(tree, head))
    return [f"{w.code} {w.position.line}:{w.position.column}" for w in warnings]


def warnings_of(tree: str, head: str = "") -> list[str]:
    return [warning.code for warning in lint(agent(tree, head))]


LONG = "say: Put your bag on the platform, wait until it is weighed, and take your receipt."

WARNED = {
    "never-reached": [
        "sequence:\n  - say: A.\n    fail: true\n  - say: B.",
        "sequence:\n  - check: false\n  - say: B.",
        "sequence:\n  - wait: 1 s\n    repeat: forever\n  - say: B.",
        "sequence: [{drive: a, retry: forever, invert: true, fail: true}, {say: B.}]",
        "selector:\n  - set: {tries: 1}\n  - say: B.",
        "selector:\n  - say: A.\n    succeed: true\n  - say: B.",
        "selector:\n  - drive: gate 4\n    retry: forever\n  - say: B.",
        "selector:\n  - say: A.\n    on_failure: {log: silent}\n  - say: B.",
        "selector:\n  - sequence: [{wait: 1 s}, {log: here}]\n  - say: B.",
        "selector:\n  - parallel: [{wait: 1 s}, {wait: 2 s}]\n  - say: B.",
        "selector:\n  - random: [{wait: 1 s}, {log: here}]\n  - say: B.",
        "selector:\n  - check: 1 < 2\n  - say: B.",
        "choose: [{name: a, when: true, say: A.}, {name: b, when: live.person, say: B.}]",
        "random:\n  - say: A.\n  - say: B.\n    weight: 0",
        "sequence:\n  - say: A.\n  - say: B.\n    when: false",
        "say: B.\nwhile: 2 < 1",
    ],
    "busy-repeat": [
        "log: again\nrepeat: forever",
        "check: live.person\nretry: forever",
        "repeat: {until: live.person}\nset: {tries: 1}",
        "repeat: forever\nsequence: [{sound: chirp}, {log: again}]",
    ],
    "endless-wait": ["wait_for: {topic: a, type: std_msgs/msg/Bool}"],
    "cut-speech": [
        f"sequence: [{{say: Hello.}}, {{{LONG.replace(',', '')}}}]\ntimeout: 5 s",
        "sequence: [{wait: 4 s}, {say: Hello.}]\ntimeout: 4 s",
        "choose: [{name: a, when: live.person, sequence: [wait: 4 s, say: A.]}]\ntimeout: 4 s",
    ],
    # A timeout inside a loop does not end the loop.
    "endless-speech": ["say: Hello.\nretry: forever\ntimeout: 5 s"],
}
"""Code → trees with only this warning."""

SOUND = {
    "never-reached": [
        "selector: [{check: 0 / 0 > 1}, {say: B.}]",
        "selector: [{wait: 1 s, when: live.person, invert: true}, {say: B.}]",
        "sequence:\n  - say: A.\n  - say: B.\n    fail: true",
        "selector:\n  - wait: 1 s\n    when: live.person\n  - say: B.",
        "selector:\n  - log: here\n    timeout: 5 s\n  - say: B.",
        "selector:\n  - set: {tries: '${live.age}'}\n  - say: B.",
        "selector:\n  - wait: 1 s\n    while: live.person\n  - say: B.",
        "selector:\n  - wait: 1 s\n    once: true\n  - say: B.",
        "selector:\n  - choose:\n      - {name: a, when: live.person, log: here}\n  - say: B.",
        "sequence:\n  - wait: 1 s\n    repeat: {until: live.person}\n  - say: B.",
        "selector: [{parallel: {succeed_on: one, children: [wait: 1 s, wait: 2 s]}}, {say: B.}]",
        "sequence:\n  - check: false\n    when: live.person\n  - say: B.",
        "choose:\n  children: [{name: a, when: live.person, say: A.}]\n  otherwise: {say: B.}",
    ],
    "busy-repeat": [
        "repeat: forever\nsequence: [{log: again}, {wait: 1 s}]",
        "repeat: forever\nlight: green",
        "repeat: 3\nlog: again",
        "repeat: forever\nsequence: [{log: again, repeat: {times: 2, pause: 1 s}}]",
    ],
    "endless-wait": [
        "sequence: [{wait_for: live.person}]\ntimeout: 5 s",
        "sequence: [{wait_for: live.mood > 3}]\nwhile: live.person",
        "parallel: {succeed_on: one, children: [{wait_for: live.person}, {wait: 5 s}]}",
    ],
    "cut-speech": [
        f"{LONG}\ntimeout: 20 s",
        "wait: 4 s\ntimeout: 2 s",
        f"parallel: [{{{LONG.replace(',', '')}}}, {{wait: 4 s}}]\ntimeout: 6 s",
        "selector: [{say: Hello.}, {wait: 10 s}]\ntimeout: 4 s",
    ],
    "endless-speech": [
        "say: Hello.\nretry: 3",
        "say: Hello.\nrepeat: {times: 2, until: live.person}",
        "sequence: [{say: Hello., once: true}, {drive: gate 4}]\nretry: forever",
        "sequence: [{sequence: [say: A., drive: gate 4], retry: forever}]\ntimeout: 60 s",
        "sequence: [{sequence: [say: A., wait: 2 s], repeat: forever}]\nwhile: live.person",
        "sequence: [{show: Hello., retry: forever}]",
    ],
}
"""Code → similar trees without any warning."""


def each(table: dict[str, list[str]]) -> list[tuple[str, str]]:
    return [(code, tree) for code, trees in table.items() for tree in trees]


@pytest.mark.parametrize(("code", "tree"), each(WARNED))
def test_rarely_intended_tree_is_warned_about(code, tree):
    assert warnings_of(tree) == [code]


@pytest.mark.parametrize(("code", "tree"), each(SOUND))
def test_sound_tree_is_not_warned_about(code, tree):
    assert warnings_of(tree) == [], code


@pytest.mark.parametrize(
    "loop", ["retry: forever", "repeat: forever", "repeat: {until: live.mood > 4}"]
)
@pytest.mark.parametrize("speech", ["say: Please clear the way.", "ask: Could you move?"])
def test_speech_in_endless_loop_is_warned_about(loop, speech):
    assert warnings_of(f"sequence: [{{{speech}}}, {{drive: gate 4}}]\n{loop}") == [
        "endless-speech"
    ]


def test_warning_points_at_speech_and_names_loop():
    tree = "retry: forever\nsequence:\n  - drive: gate 4\n  - say: Mind the robot."
    (warning,) = lint(agent(tree))
    assert (warning.position.line, warning.position.column) == (11, 7)
    assert warning.end == warning.position._replace(column=10)
    assert "(line 8)" in warning.message
    assert "{attempts: 3, …}" in warning.hint


def test_hint_for_busy_repeat_keeps_its_until():
    (warning,) = lint(agent("repeat: {until: live.mood > 4}\nlog: again"))
    assert warning.message.endswith("again at every tick, without a pause")
    assert warning.hint == "add a pause: repeat: {until: …, pause: 1 s}"


@pytest.mark.parametrize(
    ("loop", "warned"),
    [
        ("retry: 20", False),
        ("retry: 21", True),
        ("repeat: {times: 1000000, pause: 1 s}", True),
        ("repeat: 20", False),
    ],
)
def test_speech_in_very_long_loop_is_warned_about(loop, warned):
    assert warnings_of(f"say: Hello.\n{loop}") == ["endless-speech"] * warned


def test_unused_subtree_input_is_warned_at_its_declaration():
    head = "subtrees:\n  greet:\n    inputs: {who: text}\n    tree: {say: Hello.}\n"
    (warning,) = lint(agent("subtree: greet\nwith: {who: Ann}", head))
    assert (warning.code, warning.position.line) == ("unused-input", 8)
    assert warning.end == warning.position._replace(column=warning.position.column + 3)


def test_only_first_unreachable_node_is_named():
    assert found("selector:\n  - wait: 1 s\n  - say: B.\n  - say: C.") == ["never-reached 10:7"]


def test_parallel_branches_speaking_together_are_warned_about():
    tree = "parallel:\n  - say: A.\n  - sequence: [{wait: 1 s}, {ask: B?}]\n  - show: C."
    assert found(tree) == ["two-voices 10:32"]


TUNABLE = "tunables:\n  patience: {default: 8 s, min: 2 s, max: 30 s}\n"


@pytest.mark.parametrize(
    "tree",
    [
        "wait: ${patience}",
        "say: Wait ${patience}, please.",
        "say: {one_of: [Wait., 'Wait ${patience}.']}",
        "wait: ${patience * 2}",
        "check: patience > 3",
        "wait: 1 s\ntimeout: ${patience}",
        "ask: {text: A?, choices: ['${patience}']}",
        "publish: {topic: a, type: std_msgs/msg/String, message: {data: '${patience}'}}",
        "service: {name: a, type: std_srvs/srv/Trigger, succeed_when: patience > 3}",
    ],
)
def test_used_tunable_is_not_warned_about(tree):
    assert warnings_of(tree, TUNABLE) == []


def test_unused_tunable_is_warned_at_its_declaration():
    (warning,) = lint(agent("wait: 1 s", TUNABLE))
    assert warning.code == "unread-tunable"
    assert (warning.position.line, warning.position.column) == (7, 3)


def test_subtree_or_on_cancel_use_counts_for_tunable():
    head = TUNABLE + "on_cancel: {wait: '${patience}'}\n"
    assert warnings_of("wait: 1 s", head) == []
    head = TUNABLE + "subtrees: {pause: {tree: {wait: '${patience}'}}}\n"
    assert warnings_of("subtree: pause", head) == []


@pytest.mark.parametrize(
    "text", ["Are you {scene.age}?", "By {cancel.by}.", "So {{answer}}.", "So $answer."]
)
def test_unmarked_name_in_text_is_warned_about(text):
    tree = f"sequence:\n  - ask: Well?\n  - say: '{text}'"
    assert warnings_of(tree) == ["unmarked-name"]


@pytest.mark.parametrize(
    ("node", "place", "hint"),
    [
        ("say: Hello. // a note", "9:17", "a comment starts with ' #': write 'Hello. # a note'"),
        ("say: Hello. /* note */", "9:17", "a comment starts with ' #': write 'Hello. # note'"),
        ("log: Look here //note", "9:20", "a comment starts with ' #': write 'Look here # note'"),
        ("say: {one_of: [Hi. // a, Ho.]}", "9:24", "write '# …' in a line above"),
        ("ask: {text: Yes?, choices: [yes, no // a]}", "9:41", "write '# …' in a line above"),
        ("set: {place: gate 3 // x}", "9:25", "write '# …' in a line above"),
        ("say: >\n    Hello.\n    /* note */", "11:7", "write '# …' in a line above"),
        ("say: >\n    Hello. # a note\n", "10:14", "write '# …' in a line above"),
    ],
)
def test_comment_in_text_is_warned_about(node, place, hint):
    (warning,) = lint(agent(f"sequence:\n- {node}"))
    assert warning.code == "comment-in-text"
    assert f"{warning.position.line}:{warning.position.column}" == place
    assert warning.hint == f"{hint}, or put the text in quotes"


@pytest.mark.parametrize(
    "text",
    [
        "See https://a.org.",
        "See //server/share.",
        ">\n    We are #1 in C#.",
        "'Say // aloud.'",
        "either//or",
        "5 */ 3",
        "Hello. # note",
    ],
)
def test_text_without_comment_mark_is_not_warned_about(text):
    assert warnings_of(f"sequence:\n- say: Hello.\n- log: {text}") == []


def test_unmarked_expression_is_warned_about():
    tree = "set: {next: live.age + 1, place: gate 7, title: 'live.age + 1'}"
    assert found(tree) == ["unmarked-name 8:15"]


def test_subtree_used_twice_is_warned_about_once():
    head = "subtrees: {await: {tree: {wait_for: live.person}}}\n"
    assert warnings_of("sequence: [{subtree: await}, {subtree: await}]", head) == ["endless-wait"]


def test_warnings_are_sorted_by_position():
    tree = "sequence:\n  - wait_for: live.person\n  - log: a\n    repeat: forever\n  - wait: 1 s"
    assert found(tree, TUNABLE) == [
        "unread-tunable 7:3",
        "endless-wait 11:7",
        "busy-repeat 13:7",
        "never-reached 14:7",
    ]


SORRY = "I am sorry that this did not help you, and I leave you alone now."


def test_on_cancel_speech_must_fit_its_time_limit():
    (warning,) = lint(agent("wait: 1 s", f"on_cancel: {{say: '{SORRY}'}}"))
    assert warning.code == "cut-speech"
    assert warning.message == (
        "'on_cancel' ends after 3 s, but what it holds takes about 4.3 s with 'say' in line 6"
    )
    assert warning.hint == "say less, or give it more time with 'on_cancel_within'"
    assert warnings_of("wait: 1 s", "on_cancel: {say: Good-bye.}") == []


def test_on_cancel_within_extends_clean_up_time():
    head = "on_cancel: {{say: '{}'}}\non_cancel_within: {}"
    assert warnings_of("wait: 1 s", head.format(SORRY, "5 s")) == []
    (warning,) = lint(agent("wait: 1 s", head.format(SORRY * 3, "10 s")))
    assert (warning.code, warning.hint) == ("cut-speech", "say less")


def test_speech_duration_follows_rate_tunable():
    head = "tunables: {{rate: {{default: {}, min: 0.1, max: 3.0}}}}\n"
    tree = 'say: {text: "Put your bag on the platform.", rate: "${rate}"}\ntimeout: 3 s'
    assert warnings_of(tree, head.format(1.0)) == []
    assert warnings_of(tree, head.format(0.5)) == ["cut-speech"]


@pytest.mark.parametrize(
    ("texts", "cut"),
    [
        ("[Guten Tag., Schön, dass Sie da sind.]", True),
        ('[Guten Tag., "Schön, dass Sie da sind."]', False),
        ("[Guten Tag., Auf Wiedersehen.]", False),
        ("[Tea, coffee, water]", False),
        ("[where to, when then]", False),
    ],
)
def test_unquoted_text_split_by_comma_is_warned_about(texts, cut):
    source = Source("a.yaml", f"format: 1\ntexts:\n  hello: {{one_of: {texts}}}\n")
    found = [*cut_texts(source)]
    assert [one.code for one in found] == ["cut-text"] * cut
    if cut:
        assert found[0].hint == 'put quotes around the whole text: "Schön, dass Sie da sind."'


def test_brackets_cost_linear_time():
    begin = time.process_time()
    assert [*cut_texts(Source("a.yaml", "tree: " + "[" * 200_000))] == []
    assert time.process_time() - begin < 10.0
