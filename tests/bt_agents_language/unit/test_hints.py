# SPDX-License-Identifier: Apache-2.0
"""Hints: following them leads to a valid file, or to a final answer."""

from __future__ import annotations

import re

import pytest

from agent_texts import HEAD, agent_of, problems_of, refusal
from bt_agents_core.diagnostic import Diagnostic
from bt_agents_language.expression.expression_hints import ABSENT_HINT
from bt_agents_language.expression.expression_tokens import HINTS
from bt_agents_language.expression.expressions import parse_expression
from file_texts import read_agent_text
from tree_harness import SYMBOLS


def problems(text: str) -> tuple[Diagnostic, ...]:
    return problems_of(agent_of, text)


def hints(text: str) -> list[str]:
    return [one.hint for one in problems(text)]


def of_condition(condition: str) -> list[str]:
    return hints(f"tree:\n  sequence:\n    - ask: Shall we?\n    - check: {condition}\n")


@pytest.mark.parametrize(
    "condition",
    ["answer is missing", "answer is null", "answer == missing", "answer == null",
     "scene.age is unknown", "scene.age == 'unknown'", "scene.age == unknown"],
)  # fmt: skip
def test_comparison_with_missing_gets_absent_hint(condition):
    assert of_condition(condition) == [ABSENT_HINT]


@pytest.mark.parametrize(
    ("condition", "hint"),
    [
        ("scene.mood == happy", "'scene.mood' is a number: compare it with a number"),
        ("live.person == yes", "'live.person' is true or false: compare it with true or false"),
        ("answer == happy", "if it is meant as a text, put it in quotation marks: 'happy'"),
        ("answer is not 'happy'", "write !="),
    ],
)
def test_quotation_hint_appears_only_for_possible_texts(condition, hint):
    assert of_condition(condition) == [hint]


@pytest.mark.parametrize(
    ("word", "hint"),
    [(word, hint) for word, hint in HINTS["operators"].items() if hint.startswith("write ")],
)
def test_operator_hint_for_foreign_word_parses(word, hint):
    sign = hint.removeprefix("write ")
    between = " and c" if sign == "between" else ""
    parse_expression(sign if " " in sign else f"a {sign} b{between}")


def test_mood_hint_in_rule_suggests_live_mood():
    assert hints("feedback: [{when: mood < 2, give: negative}]\ntree: {say: Hello.}") == [
        "did you mean 'live.mood'?"
    ]
    assert of_condition("mood < 2") == ["did you mean 'scene.mood'?"]


@pytest.mark.parametrize(
    ("tree", "wanted"),
    [
        ("{if: live.person, then: {say: Hello.}}", ["'when: …'", "its node itself"]),
        ("{say: Hello., unless: live.person}", ["'when: not (…)'"]),
        ("{sequence: [{say: Hello.}, {stop: true}]}", ["check: false"]),
        ("{random: [Hello., Good day.]}", ["'say: Hello.'", "'say: Good day.'"]),
        ("{say: [Hello., Good day.]}", ["{one_of: […]}"]),
        ("{choose: [{otherwise: {say: Hello.}}]}", ["'choose: {children: …, otherwise: …}'"]),
        (
            "{choose: [{name: a, when: live.person, say: Hi.}], otherwise: {say: Hello.}}",
            ["'choose: {children: [ … ], otherwise: … }'"],
        ),
    ],
)
def test_foreign_node_word_hint_names_own_word(tree, wanted):
    found = hints(f"tree: {tree}")
    assert len(found) == len(wanted)
    assert all(word in hint for word, hint in zip(wanted, found, strict=True)), found


@pytest.mark.parametrize(
    ("condition", "hint"),
    [
        ("time > 22:00", "write clock.hour >= 22"),
        ("clock.hour < 08:30", "write clock.hour < 8"),
        ("clock.hour > 12am", "compare clock.hour, from 0 to 23: write 0"),
        ("at night", "write clock.hour >= 22 or clock.hour < 6"),
        ("mood falls by 1", "write mood.change <= -1"),
        ("scene.age in 2..4", "write scene.age between 2 and 4"),
        ("live.mood > 50%", "write live.mood > 3, which is 50 % of the way from 1 to 5"),
        ("scene.age > 60 dB", "write 60; join conditions"),
        ("scene.mood is upset", "write label(scene.mood) == 'upset'"),
        ("scene.mood == 'upset'", "write label(scene.mood) == 'upset'"),
        ("scene.mood != 'upset'", "write label(scene.mood) != 'upset'"),
        ("scene.mood == upset", "compare label(scene.mood) with 'upset'"),
    ],
)
def test_natural_language_condition_hint_is_valid(condition, hint):
    (found,) = of_condition(condition)
    assert hint in found
    write = re.match(r"write (.+?)(?:, which|;|$)", found)
    if write is not None and write[1] != "60":
        assert of_condition(write[1]) == []


CALL = "write 'subtree: greet', and "
FAILS = "write 'check: false' to fail here; or "
INDENT = "indent it like the key of its node, without a '-' of its own"
RANGE = "tunables: {{pause: {{default: 5 s, {}}}}}\ntree: {{wait: '${{pause}}'}}"
SUM = "write one number with one unit, "


@pytest.mark.parametrize(
    ("tree", "wanted"),
    [
        # Words of other programs.
        ("{wait_until: live.person}", "did you mean 'wait_for'?"),
        ("{sleep: 3 s}", "write 'wait: …' as a node of its own"),
        ("{wait: live.person}", "to wait until something is true, write 'wait_for: …'"),
        ("{wait: 2 s // briefly}", "a comment starts with '#'"),
        ("{say: Hello., on_error: {say: Sorry.}}", "did you mean 'on_failure'?"),
        ("{say: A., every: 5 s}", "write 'repeat: {times: forever, pause: …}' beside the node"),
        ("{say: A., until: live.mood > 3}", "write 'repeat: {until: …}' beside the node"),
        ("{say: Hello., comment: first}", "write a comment, a line that starts with '#'"),
        ("{ask: Well?, retry: always}", "did you mean 'forever'?"),
        ("{ask: Tea?, retry: until yes}", "write repeat: {until: answer == 'yes'}"),
        ("{ask: {question: Tea?, options: [yes, no]}}", "did you mean 'text'?"),
        ("{random: [{say: Hello., chance: 2}, {say: Hi.}]}", "did you mean 'weight'?"),
        (
            "{sequence: [set: {x: 1}, set: {x: x + 1}]}",
            "write ${x + 1}, or put the text in quotes",
        ),
        ("{sequence: [set: {x: 1}, set: {x: 'x + 1'}]}", "write ${x + 1}"),
        ("{sequence: [// hello]}", "a comment starts with '#'"),
        ("{check: live.person // now}", "write round(a / b); a comment starts with '#'"),
        # Conditions in natural language.
        ("{fail: I am lost.}", "write 'say: I am lost.', and 'fail: true' beside it"),
        ("{fail: {say: Lost.}}", "write the node itself, and 'fail: true' beside it"),
        ("{fail: true}", FAILS + INDENT),
        ("{sequence: [fail]}", FAILS + INDENT),
        ("{sequence: [{timeout: 5 s}]}", INDENT),
        ("{set: x = 3}", "write {x: 3}"),
        ("{set: 'x := gate 3, left'}", 'write {x: "gate 3, left"}'),
        ("{set: x += 1}", 'write {x: "${x + 1}"}'),
        ("{set: {x = 3}}", "write {x: 3}"),
        ("{say: {text = Hello}}", "write {text: Hello}"),
        ("{wait: five seconds}", "write 5 s"),
        ("{wait: [5 s, 10 s]}", "write one value, without [ ] or '- '"),
        ("{say: Hello., timeout: half an hour}", "write 0.5 h"),
        ("{say: Hello., retry: twice}", "write 2"),
        ("{wait_for: 5 s}", "a condition is expected; to let a time pass, write wait: 5 s"),
        ("{wait: {minutes: 5}}", "write 5 min"),
        ("{wait: {m: 5}}", "write 5 min for minutes, or 5 m for metres"),
        ("{wait: {minutes: a few}}", "did you mean 'duration'? That is missing"),
        ("{wait: 1 min 30 s}", f"{SUM}here 90 s"),
        ("{wait: 2 minutes and 5 seconds}", f"{SUM}here 125 s"),
        ("{wait: 1h30}", f"{SUM}for example 8 s"),
        ("{wait: 2 min 3 apples}", f"{SUM}for example 8 s"),
        ("{wait: 1e308 h 1e308 h}", f"{SUM}for example 8 s"),
    ],
)
def test_slip_in_tree_gets_line_to_write(tree, wanted):
    assert hints(f"tree: {tree}")[0] == wanted


@pytest.mark.parametrize(
    ("call", "wanted"),
    [
        ("subtree: greet, with: {text: hi}, rate: 1", "write 'with: {rate: …}' beside 'subtree'"),
        ("subtree: {name: greet, text: hi}", f"{CALL}'with: {{text: hi}}' beside it"),
        ("subtree: {greet: {text: hi}}", f"{CALL}'with: {{text: hi}}' beside it"),
        ("subtree: {name: greet, inputs: {text: hi}}", f"{CALL}'with: {{text: hi}}' beside it"),
        ("subtree: {greet: hi}", f"{CALL}'with: {{…}}' beside it"),
        ("subtree: {name: greet, with: {text: hi}}", "'with' stands beside 'subtree', not in it"),
    ],
)
def test_slip_in_call_gets_line_to_write(call, wanted):
    subtrees = "subtrees: {greet: {inputs: {text: text}, tree: {say: '${text}'}}}\n"
    assert hints(f"{subtrees}tree: {{{call}}}")[0] == wanted


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("range: [0, 9 s]", "write min: 0 s, max: 9 s"),
        ("range: 0..9", "write min: 0, max: 9"),
        ("limits: 1 s to 2 min", "write min: 1 s, max: 2 min"),
        ("min: 0..9", "write min: 0, max: 9"),
        ("range: {min: 0}", "write min: …, max: …"),
        ("minimum: 0 s, max: 9 s", "did you mean 'min'?"),
    ],
)
def test_slip_in_range_gets_line_to_write(written, wanted):
    assert hints(RANGE.format(written))[0] == wanted


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ("parameters: {}", "did you mean 'tunables'?"),
        (
            "requires: [scene.person, scene.age > 3]",
            "write one condition, and join its parts with 'and' or 'or'",
        ),
        ("feedback: [{when: live.mood < 2, give: bad}]", "did you mean 'negative'?"),
        (
            "feedback: [{when: live.mood < 2, for: 2 s, give: negative, then: stop}]",
            "did you mean 'cancel'?",
        ),
    ],
)
def test_slip_beside_tree_gets_line_to_write(keys, wanted):
    assert hints(f"{keys}\ntree: {{say: Hello.}}")[0] == wanted


def test_missing_format_hint_gives_its_number():
    text = HEAD.removeprefix("format: 1\n") + "tree: {say: Hello.}"
    (first, *_) = refusal(read_agent_text, text, "a.yaml", SYMBOLS).diagnostics
    assert first.hint == "add 'format: 1'"


@pytest.mark.parametrize("text", [RANGE.format("min: 0..9"), "tree: {set: {x = 3}}"])
def test_slip_is_one_problem(text):
    assert len(hints(text)) == 1


@pytest.mark.parametrize("tree", ["{cancel: true}", "{return: success}"])
def test_far_words_are_not_offered(tree):
    assert not any(hint.startswith("did you mean") for hint in hints(f"tree: {tree}"))


def test_unknown_member_lists_its_group():
    assert of_condition("clock.time > 3") == ["possible here: clock.hour, clock.weekday"]
    assert of_condition("scene.moot > 3") == ["did you mean 'scene.mood'?"]
    assert of_condition("mood.rise > 3") == ["did you mean 'mood.change'?"]


def test_comma_in_number_gets_the_number_with_point():
    tunables = "tunables: {a: {default: 8,5 s, min: 2 s, max: 9 s}}\n"
    assert hints(tunables + "tree: {say: {text: Hello., rate: 0,9}}\n") == [
        "use a point: 8.5 s",
        "use a point: 0.9",
    ]


def test_unquoted_reference_in_braces_hides_no_errors():
    found = problems(
        "tree:\n  sequence:\n    - {ask: {text: Hello ${name}, choices: [a, b]}}\n"
        "    - {say: ${other}}\n    - sya: Hello.\n"
    )
    assert sorted((one.position.line, one.code) for one in found) == [
        (6, "syntax"), (6, "unknown-name"), (7, "syntax"), (7, "unknown-name"), (8, "unknown-node")
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("mood", "hint"),
    [
        ("upset", "write 1, which scene.yaml calls so"),
        ("three", "write 3"),
        ("3,5", "use a point: 3.5"),
        ("3-5", "write one value, such as 4"),
        ("between 3 and 5", "write one value, such as 4"),
        ("[3, 5]", "write one value, without [ ] or '- '"),
    ],
)
def test_profile_value_hint_gives_number(mood, hint):
    text = HEAD.replace("mood: 3", f"mood: {mood}") + "tree: {say: Hello.}"
    assert refusal(read_agent_text, text, "a.yaml", SYMBOLS).diagnostics[0].hint == hint


@pytest.mark.parametrize(
    ("written", "hint"),
    [
        ("'2 s'", "write it without quotes: 2 s"),
        ("'-5 s'", "a time cannot be negative, found '-5 s'"),
        (
            "1 parsec",
            "'parsec' is not a unit; the units are ms, s, min, h, mm, cm, m, km, deg and rad",
        ),
    ],
)
def test_quoted_quantity_is_fixed_in_one_step(written, hint):
    keys = f"tunables: {{pause: {{default: {written}}}}}\ntree: {{wait: 1 s}}\n"
    (warning,) = agent_of(keys).warnings
    assert (warning.code, warning.hint) == ("quantity-as-text", hint)
