# SPDX-License-Identifier: Apache-2.0
"""Hostile files: they run, or are refused with a code and a place in the file."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, example, given, note, settings
from hypothesis import strategies as st

import file_readers
from agent_texts import HEAD
from bt_agents.engine.environment import GoalState
from bt_agents.engine.run import Run
from bt_agents.engine.scripted_environment import ScriptedEnvironment, ScriptedReply
from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import FieldType
from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent
from bt_agents_groot.translation import RemarkLevel
from bt_agents_language.diagnostics.renderers import MAX_SHOWN
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.testing.scenarios import Scenario
from bt_agents_language.files.testing.test_reader import read_test
from bt_agents_language.model.specs import AgentSpec, iter_nodes
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES, SIBLINGS
from bt_agents_language.nodes.node_type import Children, Content, NodeField
from bt_agents_language.reference.codes import codes
from bt_agents_language.tools.drawing.mermaid import mermaid
from bt_agents_language.tools.drawing.outline import outline
from bt_agents_language.tools.lint import lint
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_tools.rehearsal.rehearsal import Limits, rehearse
from bt_agents_tools.rehearsal.transcript import transcript
from file_readers import Reader, check_memory, read_quickly
from memory_folder import memory_folder
from tree_harness import SPACE, SYMBOLS, TREES, scene

CORPUS = Path(__file__).parents[2] / "corpus"
AGENTS = read_trees(TREES).agents
WIDEST = 200
MEASURED = 20
"""The memory of one in this many files is measured, which is slow."""
TICKS = 5
USED_ONE_IN = 12
"""One in this many changed agents is also shown, exported, imported, run and rehearsed."""
LINE = re.compile(r".*?:(\d+):(\d+): error\[([a-z0-9-]+)\]: .+")
CRASHED = re.compile(r"\b(?!MissingValue)[A-Z]\w*(Error|Exception)\b")

NASTY = [
    "${", "}", "{", "[", "]", ": ", "- ", "\n", "  ", "'", '"', "|", ">", "&a ", "*a", "!!x ",
    "<<: ", "? ", "~", "null", "yes", "010", "1e999", ".nan", "-1", "0", "1:30", "${x}", "${1/0}",
    "${len(1)}", "scene.age", "live.person", "mood.change", "msg.data", "result.ok", "say",
    "sequence", "choose", "random", "parallel", "subtree", "with: {a: 1}", "outputs: {a: b}",
    "when: true", "while: false", "retry: forever", "repeat: {until: true}", "once: true",
    "weight: 0", "forever", "all", "one", "[a, b]", "{a: b}", "@", "%", "`", "\t", "\r", "\0",
    "\u2028", "\u00a0", "\ufeff", "\u202e", "é", "👋", "#", " #", "---\n", "...\n", "[]", "{}",
    "''", "=", "==", "and", "not", "(", "between", "in [1]", "9" * 30, "5 s", "5 m", "90 deg",
    "name: x\n", "\\", "", "a" * 300, "../x.yaml", "/a//b", "__class__", "2 ** 9", "0x10",
]  # fmt: skip


def valid_files(folder: str) -> list[bytes]:
    """Return the valid files of the corpus."""
    return [path.read_bytes() for path in sorted((CORPUS / folder).glob("valid_*.yaml"))]


def shipped(pattern: str) -> list[bytes]:
    """Return files of the shipped trees."""
    return [path.read_bytes() for path in sorted(TREES.glob(pattern))]


TESTS = shipped("agents/*.test.yaml")
FILES: Mapping[str, list[bytes]] = {
    "agent": [f for f in shipped("agents/*.yaml") if f not in TESTS] + valid_files("agents"),
    "skills": shipped("skills/*.yaml") + valid_files("skills"),
    "library": shipped("libraries/*.yaml") + valid_files("imports/libraries"),
    "scene": shipped("scene.yaml") + shipped("scenes/*.yaml") + valid_files("scenes"),
    "market": shipped("market.yaml") + valid_files("markets"),
    "script": shipped("scripts/*.yaml") + valid_files("scripts"),
    "texts": [b"format: 1\ntexts:\n  hello: Hallo ${who}.\n  bye: {one_of: [Ade., Bis bald.]}\n"],
    "preset": valid_files("presets"),
    "experiment": valid_files("experiments"),
    "test": TESTS,
}


READERS: Mapping[str, Reader] = {
    **file_readers.READERS,
    "test": lambda path: read_test(path, AGENTS, SYMBOLS),
}


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """Path of the current file; on a disk, writing it takes as long as reading it."""
    with memory_folder() as folder:
        (folder / "libraries").mkdir()
        yield folder / "libraries" / "a.yaml"


def check(kind: str, content: bytes, place: Path) -> None:
    """Check the law for one file."""
    place.write_bytes(content)
    if zlib.crc32(content) % MEASURED == 0:
        check_memory(READERS[kind], place)
    note(content.decode("utf-8", "replace"))
    spec = read_quickly(READERS[kind], place)
    if isinstance(spec, ReadError):
        check_refusal(spec, content, place)
    elif isinstance(spec, AgentSpec):
        nodes = [(node.path, node.kind) for node in iter_nodes(spec.tree)]
        assert len(set(nodes)) == len(nodes)
        check_run(spec)


def check_refusal(error: ReadError, content: bytes, place: Path) -> None:
    """Check that every line of a refusal has a code, and a place in the file."""
    assert error.lines
    assert len(error.lines) <= MAX_SHOWN + 1
    report = error.report.replace(str(place.parent), "trees").splitlines()
    assert max(map(len, report)) <= WIDEST, max(report, key=len)
    text = content.decode("utf-8-sig", "replace").removeprefix("\ufeff")
    lines = re.split("\r\n|\n|\r", text)
    places = []
    for line in error.lines[:MAX_SHOWN]:
        match = LINE.fullmatch(line.removeprefix(str(place.parent)))
        assert match is not None, line
        assert match[3] in codes()
        assert match[3] != "reader-fault"
        places.append((int(match[1]), int(match[2])))
    assert places == sorted(places)
    for number, column in places:
        assert 1 <= number <= len(lines)
        assert 1 <= column <= len(lines[number - 1]) + 1


def check_use(spec: AgentSpec, source: Source) -> None:
    """Check that an agent can be shown, exported and imported again, run and rehearsed."""
    outline(spec, SPACE, 80)
    mermaid(spec)
    exported = export_agent(source, SYMBOLS)
    imported = import_agent(Source("tree.xml", exported.text), spec.name, SYMBOLS)
    if not any(remark.level is RemarkLevel.LOST for remark in imported.remarks):
        read_agent(Source("imported.yaml", imported.text), SYMBOLS)
    check_run(spec, ticks=50)
    scenario = Scenario(scene={"age": 3, "familiarity": 3, "mood": 3}, seed=1)
    limits = Limits(duration_s=600.0, ticks=200)
    rehearsed = rehearse(spec, SPACE, scenario, limits=limits, force=True)
    assert not CRASHED.search(transcript(rehearsed.events))


def check_run(spec: AgentSpec, ticks: int = TICKS) -> None:
    """Check that an agent's tree can be built and ticked without an exception."""
    aborted = ScriptedReply(state=GoalState.ABORTED, message="no")
    failing = [ScriptedReply(), aborted, ScriptedReply(after_s=1.5)]
    world = ScriptedEnvironment(
        {"say": failing, "show": failing},
        result={"message": "", "answer": "yes", "accepted": True},
    )
    awarded = scene(age=3, familiarity=3, mood=3)
    run = Run(
        spec,
        space=SPACE,
        scene=awarded,
        profile=spec.profile,
        live=lambda: awarded,
        tunables={tunable.name: tunable.default for tunable in spec.tunables},
        environment=world,
        steady=world.clock,
    )
    for _ in range(ticks):
        for change in run.tick():
            assert not CRASHED.search(change.message), change
        world.clock.advance(1.0)
    run.cancel("enough")
    run.tick()


@st.composite
def mutants(draw: st.DrawFn, kind: str) -> bytes:
    """A valid file with up to three slips, or with some bytes of it broken."""
    files = FILES[kind]
    content = files[draw(st.integers(0, len(files) - 1))]
    share = st.integers(0, 9999)
    for _ in range(draw(st.integers(1, 3))):
        slip = draw(st.sampled_from(SLIPS))
        content = slip(content, draw(share), draw(share), draw(TOKENS))
    return content


TOKENS = st.sampled_from([token.encode() for token in NASTY])
WORD = re.compile(rb"[\w.${}-]+")
Slip = Callable[[bytes, int, int, bytes], bytes]
"""Content, two numbers below 10,000, a token → other content."""


def _at(length: int, share: int) -> int:
    return length * share // 10_000


def _replaced_word(content: bytes, at: int, other: int, token: bytes) -> bytes:
    words = list(WORD.finditer(content))
    if not words:
        return token
    word = words[_at(len(words), at)]
    return content[: word.start()] + token + content[word.end() :]


def _swapped_words(content: bytes, at: int, other: int, token: bytes) -> bytes:
    words = list(WORD.finditer(content))
    if not words:
        return content
    first, second = sorted((_at(len(words), at), _at(len(words), other)))
    a, b = words[first], words[second]
    if first == second:
        return content
    middle = content[a.end() : b.start()]
    return content[: a.start()] + b[0] + middle + a[0] + content[b.end() :]


def _inserted(content: bytes, at: int, other: int, token: bytes) -> bytes:
    place = _at(len(content) + 1, at)
    return content[:place] + token + content[place:]


def _cut_out(content: bytes, at: int, other: int, token: bytes) -> bytes:
    place = _at(len(content), at)
    return content[:place] + content[place + 1 + other % 40 :]


def _truncated(content: bytes, at: int, other: int, token: bytes) -> bytes:
    return content[: _at(len(content), at)]


def _flipped_bit(content: bytes, at: int, other: int, token: bytes) -> bytes:
    changed = bytearray(content or b" ")
    changed[_at(len(changed), at)] ^= 1 << other % 8
    return bytes(changed)


def _in_lines(content: bytes, at: int, other: int, token: bytes) -> bytes:
    """Move, double, lose or indent one line; the token says which."""
    lines = content.split(b"\n")
    number = _at(len(lines), at)
    match zlib.crc32(token) % 4:
        case 0:
            line = lines.pop(number)
            lines.insert(_at(len(lines) + 1, other), line)
        case 1:
            lines.insert(_at(len(lines), other), lines[number])
        case 2:
            del lines[number]
        case _:
            bare = lines[number].lstrip(b" ")
            indent = len(lines[number]) - len(bare) + other % 9 - 4
            lines[number] = b" " * max(0, indent) + bare
    return b"\n".join(lines)


def _spliced(content: bytes, at: int, other: int, token: bytes) -> bytes:
    every = [file for files in FILES.values() for file in files]
    second = every[_at(len(every), other)].split(b"\n")
    first = content.split(b"\n")
    return b"\n".join(first[: _at(len(first), at)] + second[_at(len(second), at) :])


SLIPS: list[Slip] = [
    _replaced_word, _replaced_word, _swapped_words, _inserted, _cut_out, _truncated, _flipped_bit,
    _in_lines, _in_lines, _in_lines, _in_lines, _spliced,
]  # fmt: skip


def law(examples: int) -> settings:
    """Return settings under which all runs are the same."""
    return settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )


MUTANTS = {
    "agent": 1500, "skills": 350, "library": 300, "scene": 200, "market": 100, "script": 200,
    "test": 250, "experiment": 100,
}  # fmt: skip
"""Number of files of each kind to try."""


@pytest.mark.parametrize(("kind", "examples"), MUTANTS.items())
def test_mutated_file_is_accepted_or_rejected_with_code(
    place: Path, kind: str, examples: int
) -> None:
    @law(examples)
    @given(mutants(kind))
    def holds(content: bytes) -> None:
        check(kind, content, place)

    holds()


@law(300)
@given(st.text() | st.lists(st.sampled_from(NASTY)).map("".join))
@example("\ufeff")
@example("{? a}")
@example('"\\ud800"')
def test_any_text_is_accepted_or_rejected_with_code(place: Path, text: str) -> None:
    for kind in ("agent", "skills", "scene", "script", "experiment"):
        check(kind, text.encode(), place)


CONDITIONS = [
    "true", "live.person", "scene.age > 3", "mood.change <= -1", "a == 'x'", "b", "n != 2",
    "\"a in ['x', 'y']\"", "scene.age between 1 and 3", "not (profile.age < 2 or b)", "len(a) > 2",
    "1 / n > 2", "n % (n - 2) == 0", "e == 1",
]  # fmt: skip
VALUES: Mapping[FieldType, list[str]] = {
    FieldType.DURATION: ["0 s", "1 s", "250 ms", "'${n}'", "'${2 * n}'", "3e7 s", "0.1"],
    FieldType.INTEGER: ["1", "2", "'${n}'", "1000000"],
    FieldType.NUMBER: ["1", "0.5", "'${live.age}'", "'${n / (n - 2)}'", "3"],
    FieldType.BOOLEAN: ["true", "false"],
    FieldType.TEXT: ["Hello.", "'${a} and ${n}'", "'$${x}'", "s0"],
    FieldType.LENGTH: ["1 m", "5 cm", "'${n}'"],
    FieldType.ANGLE: ["90 deg", "1"],
    FieldType.ANY: ["1", "x", "'${a}'", "[1, {x: '${n}'}]", "{y: 2 s}", "'${e}'"],
}
CONTENTS: Mapping[Content, list[str]] = {
    Content.CONDITION: CONDITIONS,
    Content.ROS_NAME: ["/a", "b/c", "~/d"],
    Content.ROS_TYPE: ["std_msgs/msg/Bool"],
    Content.MAP: ["{}", "{data: true}", "{age: 3}", "{age: '${n}', mood: 2}"],
    Content.OUTPUTS: ["{e: data}", "{f: msg.data}", "{g: x.y}", "{}"],
    Content.COUNT: ["all", "one", "1"],
}
ROS_TYPES = {"action": "a/action/B", "service": "a/srv/C"}
SKILLS = [SYMBOLS.skills[name] for name in ("say", "ask", "show", "light", "drive", "sound")]
USED = [
    *(kind for kind in NODE_TYPES.values() if kind.children is Children.LIST),
    *NODE_TYPES.values(),
    *SKILLS,
]
SUBTREES = """
subtrees:
  s0: {tree: {say: x}}
  s1:
    inputs: {i: {type: integer, default: 2}}
    outputs: {c: any}
    tree: {sequence: [{set: {c: '${i + 1}'}}, {subtree: s0}, {say: '${a}'}]}
"""
TUNABLES = "tunables: {n: {default: 2, min: 0, max: 9}, a: {default: x}, b: {default: true}}\n"


def misfits(random: Random) -> bool:
    """Return whether a piece is one of the few invalid ones."""
    return random.randrange(150) == 0


def flips(random: Random) -> bool:
    """Return true for every second piece."""
    return random.randrange(2) == 0


def field_value(random: Random, field: NodeField, depth: int) -> str:
    """A value for a field of a node, usually a valid one."""
    if misfits(random):
        return random.choice(["", "~", "[]", "{}", "x", "-1", "'${'", "'${a}'", ".nan"])
    if field.content is Content.NODE:
        return node(random, depth + 1)
    if field.words and flips(random):
        return random.choice(field.words)
    return random.choice(CONTENTS.get(field.content, VALUES[field.type]))


def mapping(random: Random, key: str, fields: tuple[NodeField, ...], depth: int) -> str:
    """Fields of a node, usually the required ones."""
    pairs = {
        field.name: field_value(random, field, depth)
        for field in fields
        if field.required or random.randrange(3) == 0
    }
    if key in ROS_TYPES:
        pairs["type"] = ROS_TYPES[key]
    if key == "wait_for":
        for name in ("topic", "type", "until", "outputs") if "condition" in pairs else ():
            pairs.pop(name, None)
    return "{" + ", ".join(f"{name}: {value}" for name, value in pairs.items()) + "}"


def body(random: Random, kind: object, depth: int) -> str:
    """The value of a node's key."""
    if kind in SKILLS:
        return random.choice(["x", "'${a}'", "'${n}'", "'${e}'", "x y"])
    assert kind in NODE_TYPES.values()
    table = NODE_TYPES[kind.key]
    if table.key == "subtree":
        return random.choice(["s0", "s1"])
    if table.open:
        value = random.choice(VALUES[FieldType.ANY])
        return f"{{{random.choice('efg')}: {value}}}"
    if table.children is Children.LIST:
        fewest = 0 if misfits(random) else 1
        count = random.randint(fewest, 3 if depth < 3 else 1)
        listed = "[" + ", ".join(node(random, depth + 1, table.key) for _ in range(count)) + "]"
        if flips(random):
            return listed
        options = mapping(random, table.key, table.fields, depth).removeprefix("{")
        return f"{{children: {listed}, {options}"
    if table.main is not None and flips(random):
        field = next(field for field in table.fields if field.name == table.main)
        return field_value(random, field, depth)
    return mapping(random, table.key, table.fields, depth)


def node(random: Random, depth: int, parent: str = "") -> str:
    """A node with decorators, as written by an author who has read half of the manual."""
    kind = random.choice(USED[:5] if depth == 0 else USED if depth < 4 else USED[-10:])
    key = kind.name if kind in SKILLS else kind.key
    written = key[:2] + key[3:] if misfits(random) else key
    pairs = {written: body(random, kind, depth)}
    if parent == "choose" and not misfits(random):
        pairs["name"] = random.choice(["s0", "s1"])
        pairs["when"] = random.choice(CONDITIONS)
    if parent == "random" and flips(random):
        pairs["weight"] = random.choice(["0", "2", "'${n}'"])
    for decorator in random.choices([*DECORATORS.values()], k=random.randint(0, 2)):
        if decorator.handler:
            value = node(random, depth + 2)
        elif not decorator.fields:
            value = "yes" if misfits(random) else "true"
        elif flips(random):
            value = mapping(random, decorator.key, decorator.fields, depth)
        else:
            value = field_value(random, decorator.fields[0], depth)
        pairs.setdefault(decorator.key, value)
    if misfits(random):
        words = ["s0", "2", "'${n}'", "{a: x}", "{e: c}", "{d: answer}", "{i: 3, a: '${a}'}"]
        pairs[random.choice([*SIBLINGS])] = random.choice(words)
    return "{" + ", ".join(f"{word}: {value}" for word, value in pairs.items()) + "}"


@law(2000)
@given(st.randoms(use_true_random=True))
def test_random_tree_runs_or_is_rejected_with_code(place: Path, random: Random) -> None:
    # If drawn piece by piece, a tree would take hypothesis ten times as long as its check.
    check("agent", f"{HEAD}{TUNABLES}tree: {node(random, 0)}{SUBTREES}".encode(), place)


HALF_TYPED: list[Any] = [
    None, True, 0, -1.5, "", "say", "${answer}", "8 s", "scene.age > 2", [], {}, [[]], [{}],
    [None], {"": {}}, {"say": None}, {"sequence": {}}, {"children": {}},
]  # fmt: skip
MUTATIONS = {
    "agent": 12_800, "library": 1_000, "test": 1_000, "scene": 1_000, "skills": 1_000,
    "market": 1_400, "script": 1_400, "texts": 200, "preset": 200,
}  # fmt: skip
"""Number of changes to try for the files of each kind, 20,000 in total."""


def places(value: Any) -> list[tuple[Any, Any]]:
    """Return the places of everything below a value: its container, and its key there."""
    keys = [*value] if isinstance(value, dict) else []
    if isinstance(value, list):
        keys = [*range(len(value))]
    return [place for key in keys for place in ((value, key), *places(value[key]))]


def change(document: Any, luck: Random) -> None:
    """Delete, duplicate, move or replace one value of a document."""
    everywhere = places(document)
    holder, key = luck.choice(everywhere)
    other, other_key = luck.choice(everywhere)
    value = deepcopy(holder[key])
    what = luck.randrange(5)
    if what < 2:
        holder[key] = deepcopy(luck.choice(HALF_TYPED))
        return
    if what < 4:
        del holder[key]
    if what > 2:
        if isinstance(other, list):
            other.insert(luck.randrange(len(other) + 1), value)
        else:
            other[other_key if luck.random() < 0.5 else key] = value


@pytest.mark.parametrize(("kind", "mutations"), MUTATIONS.items())
def test_misplaced_nodes_are_accepted_or_rejected_with_code(
    place: Path, kind: str, mutations: int
) -> None:
    documents = [yaml.load(file, Loader=yaml.CSafeLoader) for file in FILES[kind]]
    for number in range(mutations):
        luck = Random(f"{kind} {number}")
        document = deepcopy(luck.choice(documents))
        for _ in range(luck.choice((1, 1, 1, 2, 3))):
            if places(document):
                change(document, luck)
        content = json.dumps(document, ensure_ascii=False, indent=1, default=str).encode()
        place.write_bytes(content)
        found: Iterable[Diagnostic] = ()
        try:
            spec = READERS[kind](place)
            if isinstance(spec, AgentSpec):
                found = lint(spec)
                if number % USED_ONE_IN == 0:
                    check_use(spec, read_source(place))
        except ReadError as error:
            found = error.diagnostics
        assert "reader-fault" not in {one.code for one in found}, content.decode()
