# SPDX-License-Identifier: Apache-2.0
"""Laws of the readers: whatever is in a file is accepted or refused by name, and never crashes."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from functools import partial
from pathlib import Path

from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import FieldType
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.expression.quantities import QuantityError, integer, number, quantity
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.model.specs import AgentSpec, NodeSpec
from bt_agents_language.reference.codes import codes
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence, read_yaml
from file_texts import read_agent_text, read_scene_text, read_skills_text
from tree_harness import SPACE, SYMBOLS, TREES

EVERYTHING = """\
format: 1
agent: everything
profile: {age: 3, familiarity: 3, mood: 3}
tunables: {t: {default: true}, n: {default: 2.0, min: 1, max: 3}, s: {default: x}}
tree:
  selector:
    memory: false
    children:
      - action: {name: /a, type: b/action/C, goal: {x: [1, {y: "${n}"}]}, outputs: {o: result.v},
                 succeed_when: result.ok and t}
      - service: {name: b, type: b/srv/C}
      - publish: {topic: c, type: b/msg/C, message: {data: "${o}"}}
      - set: {k: 3, l: "${o}", m: 5 s}
        when: k * 2 > -1 or not (s == 'x')
      - wait: ${m}
        invert: true
        repeat: 3
      - subtree: inner
        with: {count: "${k}"}
subtrees:
  inner:
    inputs: {count: {type: integer, default: 3}}
    tree: {say: "${count}", retry: "${count}", timeout: 5 s, on_failure: {say: >
      sorry, $${really}}}
"""
EXPERIMENT = """\
format: 1
rounds: 3
seed: 1
scenes: [{age: 1, familiarity: 1, mood: 1}]
feedback: {each: {a: {age: 1}}, sequence: [{mood: 2}], repeat: true}
"""


def agent(text: str) -> object:
    return read_agent_text(text, "a.yaml", SYMBOLS)


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


SEEDS: list[tuple[str, Callable[[str], object]]] = [
    (EVERYTHING, agent),
    *((text_of(path), agent) for path in sorted((TREES / "agents").glob("*.yaml"))),
    (text_of(TREES / "skills" / "robot.yaml"), lambda text: read_skills_text(text, "a.yaml")),
    (text_of(TREES / "scene.yaml"), lambda text: read_scene_text(text, "a.yaml")),
    (text_of(TREES / "scenes" / "faces.yaml"), lambda text: read_scene_text(text, "a.yaml")),
    (
        text_of(TREES / "scripts" / "airport_morning.yaml"),
        lambda text: read_script(Source("a.yaml", text), SPACE),
    ),
    (EXPERIMENT, lambda text: read_experiment(Source("a.yaml", text), SPACE)),
]
PIECES = [
    "${", "}", "{", "[", "]", ": ", "- ", "\n", "  ", "'", '"', "|", ">", "&a ", "*a",
    "!!x ", "<<: ", "? ", "~", "yes", "010", "1e999", ".nan", "-1", "1:30", "${x}",
    "scene.age", "say", "sequence", "subtree", "with", "when", "@", "%", "\t", "\r", "\0",
    "\u2028", "é", "👋", "#", " #", "---\n", "[]", "{}", "''", "=", "and", "not", "(",
    "9" * 30, "5 s", "5 m", "name: x\n", "\\", "",
]  # fmt: skip
WORD = re.compile(r"[\w.${}]+")
LINE = re.compile(r"a\.yaml:(\d+):(\d+): error\[([a-z0-9-]+)\]: .+", re.DOTALL)


@st.composite
def mutants(draw: st.DrawFn) -> tuple[str, Callable[[str], object]]:
    """A good file with a few words replaced, pieces inserted, and lines moved or lost."""
    text, reader = draw(st.sampled_from(SEEDS))
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(text)))
        match draw(st.sampled_from(["word", "insert", "delete", "line", "indent"])):
            case "word":
                words = list(WORD.finditer(text))
                assume(words)
                old, other = draw(st.sampled_from(words)), draw(st.sampled_from(words))
                new = draw(st.sampled_from([*PIECES, other[0]]))
                text = text[: old.start()] + new + text[old.end() :]
            case "insert":
                text = text[:at] + draw(st.sampled_from(PIECES)) + text[at:]
            case "delete":
                text = text[:at] + text[at + draw(st.integers(1, 12)) :]
            case "line":
                lines = text.split("\n")
                moved = lines.pop(draw(st.integers(0, len(lines) - 1)))
                lines.insert(draw(st.integers(0, len(lines))), moved)
                text = "\n".join(lines)
            case "indent":
                start = text.rfind("\n", 0, at) + 1
                text = text[:start] + " " * draw(st.integers(1, 4)) + text[start:]
    return text, reader


def check_refusal(error: ReadError, text: str) -> None:
    """Check that every line of a refusal names a code, and a place that is in the file."""
    assert error.lines
    assert error.report
    places = []
    for line in error.lines:
        match = LINE.fullmatch(line)
        if match is None:
            assert "more other errors" in line
            continue
        assert match[3] in codes()
        places.append((int(match[1]), int(match[2])))
    assert places == sorted(places)
    lines = re.split("\r\n|\n|\r", text.removeprefix("\ufeff"))
    for number_, column in places:
        assert 1 <= number_ <= len(lines)
        assert 1 <= column <= len(lines[number_ - 1]) + 1


def check_node(spec: NodeSpec, seen: set[str]) -> None:
    """Check that a node that was accepted has everything that the engine will ask it for."""
    assert spec.path not in seen
    seen.add(spec.path)
    needed = {
        "check": {"condition"},
        "wait": {"duration"},
        "when": {"condition", "otherwise"},
        "retry": {"attempts"},
        "repeat": {"times"},
        "timeout": {"limit"},
        "sequence": {"memory"},
        "selector": {"memory"},
        "parallel": {"succeed_on"},
    }
    if spec.skill is not None:
        assert set(spec.fields) == {one.name for one in spec.skill.inputs}
    assert needed.get(spec.kind, set()) <= set(spec.fields)
    if spec.kind in ("when", "retry", "repeat", "timeout", "invert", "subtree"):
        assert len(spec.children) == 1
    if spec.kind == "on_failure":
        assert len(spec.children) == 2
    for child in spec.children:
        check_node(child, seen)


@settings(max_examples=1000, deadline=None)
@given(mutants())
def test_mutated_file_is_accepted_or_rejected_with_code(mutant):
    text, reader = mutant
    try:
        spec = reader(text)
    except ReadError as error:
        check_refusal(error, text)
    else:
        if isinstance(spec, AgentSpec):
            check_node(spec.tree, set())


@settings(max_examples=300, deadline=None)
@given(st.text() | st.lists(st.sampled_from(PIECES)).map("".join))
@example("\ufeff")
@example("{? a}")
@example('"\\ud800"')
def test_any_text_is_accepted_or_rejected_with_code(text):
    for _, reader in SEEDS[-5:]:
        try:
            reader(text)
        except ReadError as error:
            check_refusal(error, text)


scalars = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=8)
plain = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(scalars.filter(bool), inner, max_size=4)
    ),
    max_leaves=12,
)


def written(value: object) -> str:
    """Return a value in flow style, every text in double quotes."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{written(k)}: {written(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    return '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'


def content(node: Node) -> object:
    match node:
        case Scalar():
            return node.text
        case Sequence():
            return [content(item) for item in node.items]
        case Mapping():
            return {entry.key.text: content(entry.value) for entry in node.entries}


@settings(deadline=None)
@given(plain)
def test_written_values_are_read_back_with_span(value):
    text = f"k: {written(value)}\n"
    problems = Diagnostics(None)
    root = read_yaml(Source("a.yaml", text), problems)
    assert not len(problems)
    assert isinstance(root, Mapping)
    assert content(root) == {"k": value}
    (entry,) = root.entries
    assert text[slice(*entry.value.span)] == written(value)


@given(st.text(max_size=30))
def test_quantities_are_finite_or_rejected(text):
    duration = partial(quantity, field_type=FieldType.DURATION)
    for read, low in ((number, -1e308), (integer, -(2**63)), (duration, 0.0)):
        with suppress(QuantityError):
            assert low <= read(text) <= 1e308


@given(
    st.integers(0, 500_000), st.sampled_from([("ms", Fraction(1, 1000)), ("s", 1), ("min", 60)])
)
def test_time_is_number_times_unit(amount, unit):
    name, seconds = unit
    assert quantity(f"{amount} {name}", FieldType.DURATION) == float(amount * seconds)


NUMBERS = {"a": 2.0, "b.c": -3.5, "n": 4}
BOOLEANS = {"t": True, "f": False}
ORDER = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
    "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
ARITHMETIC = {"+": operator.add, "-": operator.sub, "*": operator.mul}

Pair = tuple[str, object]
numbers: st.SearchStrategy[Pair] = st.recursive(
    st.sampled_from([*NUMBERS.items()]) | st.integers(0, 9).map(lambda n: (str(n), n)),
    lambda inner: (
        st.tuples(inner, st.sampled_from([*ARITHMETIC]), inner).map(
            lambda x: (f"({x[0][0]} {x[1]} {x[2][0]})", ARITHMETIC[x[1]](x[0][1], x[2][1]))
        )
        | inner.map(lambda x: (f"-({x[0]})", -x[1]))
    ),
    max_leaves=4,
)
conditions: st.SearchStrategy[Pair] = st.recursive(
    st.sampled_from([*BOOLEANS.items()])
    | st.tuples(numbers, st.sampled_from([*ORDER]), numbers).map(
        lambda x: (f"{x[0][0]} {x[1]} {x[2][0]}", ORDER[x[1]](x[0][1], x[2][1]))
    ),
    lambda inner: (
        st.tuples(inner, st.sampled_from(["and", "or"]), inner).map(
            lambda x: (
                f"({x[0][0]}) {x[1]} ({x[2][0]})",
                (x[0][1] and x[2][1]) if x[1] == "and" else (x[0][1] or x[2][1]),
            )
        )
        | inner.map(lambda x: (f"not ({x[0]})", not x[1]))
    ),
    max_leaves=5,
)


@given(conditions)
def test_condition_means_the_same_as_its_parts(pair):
    text, value = pair
    assert parse_expression(text).evaluate({**NUMBERS, **BOOLEANS}.__getitem__) is value


@given(
    st.lists(
        st.sampled_from(
            ["a", "b.c", "1", "'x'", "(", ")", "-", "not", "and", "<", "==", "+", "=", "$"]
        )
    )
)
def test_word_sequence_parses_or_is_rejected_with_position(words):
    text = " ".join(words)
    column = 1
    try:
        parse_expression(text)
    except ExpressionError as error:
        column = error.column
    assert 1 <= column <= len(text) + 1
