# SPDX-License-Identifier: Apache-2.0
"""Linter of checked agents and their files, for legal but rarely intended content."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, pairwise

from bt_agents_core.diagnostic import Diagnostic, Position
from bt_agents_core.field_types import BindingKind
from bt_agents_core.gc_pause import gc_paused
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import Diagnostics, warning
from bt_agents_language.fields.scope import GROUPS
from bt_agents_language.model.specs import AgentSpec, Literal, NodeSpec, UnusedInput, iter_nodes
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.endings import EITHER, Outcomes
from bt_agents_language.nodes.node_type import FOREVER, Role, Waits
from bt_agents_language.nodes.remember import REMEMBER
from bt_agents_language.tools.cut_speech import cut_speech, speaks
from bt_agents_language.tree.names_read import names_read, parts_of
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, read_yaml
from bt_agents_language.yaml.yaml_reader import Sequence as SequenceNode

_PERSON = "person."

_PATIENCE = 20
"""Number of repetitions beyond which the same speech is suspicious."""

_NAME = rf"((?:(?:{'|'.join(GROUPS)}|person)\.)?[^\W\d]\w*)"
_UNMARKED = re.compile(rf"(?<![$\w])(?:\${_NAME}|\{{{{1,2}}\s*{_NAME}\s*\}}{{1,2}})")

# A comment starts with a word; a number, as in "gate #4", is part of the speech.
_NUMBER = re.compile(r"[ \t]+#\d\w*")
_SIGN = re.compile(r"[ \t]#\d")
_COMMA = re.compile(r"\[[^\[\]]*,\s+[^\W\d_A-Z]")

Found = Iterator[Diagnostic]

_Tree = Sequence[NodeSpec]
"""All nodes of a tree, parents before children."""


@gc_paused()
def lint(agent: AgentSpec, *, names_persons: bool = True) -> tuple[Diagnostic, ...]:
    """Return the warnings about an agent, in the order of its file.

    ``names_persons`` states whether anybody is ever known by name.
    """
    found: dict[tuple[Position, str], Diagnostic] = {}
    roots = (root for root in (agent.tree, agent.on_cancel) if root is not None)
    trees = [list(iter_nodes(root)) for root in roots]
    for tree in trees:
        for rule in _RULES:
            for one in rule(tree):
                # A subtree that is used several times is written once.
                found.setdefault((one.position, one.code), one)
    nodes = list(chain(*trees))
    named = (
        _unread_tunables(agent, nodes),
        unused_inputs(agent.unused_inputs),
        agent.warnings,
        cut_speech(agent),
        _unmarked_names(agent, nodes),
        () if names_persons else _nobody_known(agent, nodes),
    )
    for one in chain(*named):
        found[(one.position, one.code)] = one
    return tuple(sorted(found.values(), key=lambda one: (one.position.line, one.position.column)))


def cut_texts(source: Source) -> Found:
    """Yield a warning for each text that was probably meant to continue after a '#' or a comma."""
    suspicious = _SIGN.search(source.text) or _COMMA.search(source.text)
    root = read_yaml(source, Diagnostics(source)) if suspicious else None
    for node in _below(root) if root is not None else ():
        if isinstance(node, SequenceNode):
            yield from _cut_at_commas(source, node)
        if not isinstance(node, Scalar):
            continue
        match = _NUMBER.match(source.text, node.span[1])
        if node.plain and node.text and match is not None:
            lost = match[0].strip()
            yield warning(
                "cut-text",
                source.position(match.end() - len(lost)),
                len(lost),
                f"the text ends before '{lost[:20]}', because ' #' starts a comment",
                'put quotes around the whole text: "…"',
            )


def _cut_at_commas(source: Source, texts: SequenceNode) -> Found:
    """Yield a warning for each sentence in ``[ ]`` that a comma has split into two texts."""
    if source.text[texts.span[0]] != "[":
        return
    for before, text in pairwise(texts.items):
        if not (isinstance(before, Scalar) and isinstance(text, Scalar)):
            continue
        cut = before.text[:1].isupper() and text.text[:1].islower() and " " in text.text
        if cut and before.plain and text.plain:
            yield warning(
                "cut-text",
                text.position,
                len(text.text),
                "this is a text of its own, though it begins with a small letter: a comma in [ ] "
                "ends a text",
                f'put quotes around the whole text: "{before.text}, {text.text}"',
            )


def _below(root: Node) -> Iterator[Node]:
    waiting: list[Node] = [root]
    while waiting:
        node = waiting.pop()
        yield node
        match node:
            case SequenceNode(items=items):
                waiting += reversed(items)
            case Mapping(entries=entries):
                waiting += [entry.value for entry in reversed(entries)]


def outcomes(spec: NodeSpec) -> Outcomes:
    """Return all possible outcomes of a node; perhaps too many if known only at run time."""
    return _every_outcome(list(iter_nodes(spec)))[id(spec)]


def _every_outcome(tree: _Tree) -> dict[int, Outcomes]:
    """Return the outcomes of all nodes of a tree by their identity."""
    found: dict[int, Outcomes] = {}
    for spec in reversed(tree):
        node_type = type_of(spec)
        if spec.children or node_type.role is Role.LEAF:
            children = [found[id(child)] for child in spec.children]
            found[id(spec)] = node_type.outcomes(spec, children)
        else:
            found[id(spec)] = EITHER
    return found


def _endless_speech(tree: _Tree) -> Found:
    if all(_rounds(spec) <= _PATIENCE for spec in tree):
        return iter(())

    def walk(spec: NodeSpec, loop: NodeSpec | None, guarded: bool) -> Found:
        node_type = type_of(spec)
        if node_type.single_round:
            loop = None
        elif node_type.limits:
            # Inside a loop it ends only one round.
            guarded = guarded or loop is None
        elif _rounds(spec) > _PATIENCE and not guarded:
            loop = loop if loop is not None and _rounds(loop) > _rounds(spec) else spec
        elif loop is not None and speaks(spec):
            key = type_of(loop).rounds
            rounds = _rounds(loop)
            if math.isinf(rounds):
                end = "that only 'until' ends" if "until" in loop.fields else "without end"
                fewer = "a number"
                says = "the robot may say this for ever"
            else:
                end, fewer = f"of {rounds} {key}", "a smaller number"
                says = f"{rounds} {key} seem endless to a person who waits"
            yield _at(
                spec,
                "endless-speech",
                f"'{spec.kind}' stands inside a '{loop.kind}' {end} (line "
                f"{loop.position.line}): {says}",
                f"give '{loop.kind}' {fewer}: {{{key}: 3, …}}",
            )
        for child in spec.children:
            yield from walk(child, loop, guarded)

    return walk(tree[0], None, False)


def _rounds(spec: NodeSpec) -> float:
    """Return the maximum number of rounds of a loop; 1 if unknown."""
    count = spec.fields.get(type_of(spec).rounds)
    number = count.value if isinstance(count, Literal) else 1
    if number == FOREVER:
        return math.inf
    return number if isinstance(number, int) else 1


def _endless_waits(tree: _Tree) -> Found:
    def walk(spec: NodeSpec, ended: bool) -> Found:
        node_type = type_of(spec)
        ended = ended or node_type.limits or node_type.stops_children(spec)
        if node_type.waits is Waits.EVENT and not ended:
            yield _at(
                spec,
                "endless-wait",
                "nothing ends this wait if what it waits for never comes",
                "write 'timeout: 30 s' beside it, or around what it is part of",
            )
        for child in spec.children:
            yield from walk(child, ended)

    waits = any(type_of(spec).waits is Waits.EVENT for spec in tree)
    return walk(tree[0], False) if waits else iter(())


def _never_reached(tree: _Tree) -> Found:
    ways = _every_outcome(tree)
    for spec in tree:
        for node, reason, hint in type_of(spec).unreached(spec, ways):
            # A branch has no key.
            key = node.children[0] if type_of(node).role is Role.BRANCH else node
            yield _at(key, "never-reached", f"this is never done: {reason}", hint)


def _busy_repeats(tree: _Tree) -> Found:
    for spec in tree:
        if (
            math.isinf(_rounds(spec))
            and "pause" not in spec.fields
            and not any(map(_takes_time, iter_nodes(spec)))
        ):
            ends = "until" in spec.fields
            end = "until: …" if ends else f"{type_of(spec).rounds}: forever"
            yield _at(
                spec,
                "busy-repeat",
                f"this '{spec.kind}' starts its node again at every tick, "
                f"{'' if ends else 'without end and '}without a pause",
                f"add a pause: {spec.kind}: {{{end}, pause: 1 s}}",
            )


def _two_voices(tree: _Tree) -> Found:
    for spec in tree:
        if not type_of(spec).concurrent:
            continue
        voices = [next(filter(speaks, iter_nodes(child)), None) for child in spec.children]
        first, *others = [one for one in voices if one is not None] or [spec]
        for other in others:
            yield _at(
                other,
                "two-voices",
                f"this '{other.kind}' and the one in line {first.position.line} are in different "
                "branches of a 'parallel': the robot may say both at the same time",
                "put everything that is said into one branch, as a sequence",
            )


def _not_offered(tree: _Tree) -> Found:
    for spec in tree:
        if spec.skill is not None and spec.skill.binding is None:
            yield _at(
                spec,
                "skill-not-offered",
                f"no robot offers '{spec.kind}' here: {spec.skill.unoffered}",
                "bind it under 'bindings:' of a skills file; until then the agent does not bid",
            )


def _unmarked_names(agent: AgentSpec, nodes: Sequence[NodeSpec]) -> Found:
    """Find ``$place`` and ``{place}`` in texts that mean ``${place}``."""
    candidates = [
        (node, match)
        for node in nodes
        if node.fields
        for text in _texts(node)
        if "$" in text or "{" in text
        for match in _UNMARKED.finditer(text)
    ]
    if not candidates:
        return
    known = {tunable.name for tunable in agent.tunables}
    known |= {name for node in nodes for name in (*node.outputs, *node.feedback)}
    known |= {name for node in nodes if type_of(node).assigns for name in node.fields}
    for node, match in candidates:
        name = match[1] or match[2]
        if name in known or "." in name:
            yield _at(
                node,
                "unmarked-name",
                f"'{match[0]}' in a text of '{node.kind}' stays as it is, though there is a "
                f"'{name}'",
                f"write ${{{name}}} for its value",
            )


def unused_inputs(inputs: Iterable[UnusedInput]) -> Found:
    """Return the warnings about unused inputs of subtrees, in an agent or a library."""
    for one in inputs:
        yield warning(
            "unused-input",
            one.position,
            len(one.name),
            f"subtree {quote(one.subtree)} never uses its input {quote(one.name)}",
            f"write ${{{one.name}}} where it is needed, or remove the input",
        )


def _unread_tunables(agent: AgentSpec, nodes: Sequence[NodeSpec]) -> Found:
    unread = {tunable.name for tunable in agent.tunables}
    for node in nodes:
        if not unread:
            return
        # The trees of a library see only its own names.
        if node.position.file == agent.file:
            unread.difference_update(names_read(node))
    for tunable in agent.tunables:
        if tunable.name in unread:
            yield warning(
                "unread-tunable",
                tunable.position,
                len(tunable.name),
                f"nothing uses the tunable {quote(tunable.name)}: turning it changes nothing",
                f"write ${{{tunable.name}}} where it belongs, or remove it",
            )


def _nobody_known(agent: AgentSpec, nodes: Sequence[NodeSpec]) -> Found:
    """Yield one warning if an agent refers to persons who are known by name."""
    required = agent.requires.names if agent.requires is not None else ()
    start = Position(file=agent.file, line=1, column=1)
    uses = [(start, name) for name in sorted(required) if name.startswith(_PERSON)]
    for node in nodes:
        if node.kind == REMEMBER.key:
            uses.append((node.position, node.kind))
        uses += [(node.position, name) for name in names_read(node) if name.startswith(_PERSON)]
    if not uses:
        return
    position, first = uses[0]
    does = f"'{first}' keeps nothing" if first == REMEMBER.key else f"'{first}' is missing"
    yield warning(
        "nobody-known",
        position,
        1,
        f"scene.yaml has no 'persons' with 'known', so no sensor names anybody and {does}",
        "declare 'persons' in scene.yaml; else only persons are known whom "
        "'bt-agents trigger --name' or a script of the scene layer announces",
    )


_RULES: tuple[Callable[[_Tree], Found], ...] = (
    _endless_speech,
    _endless_waits,
    _never_reached,
    _busy_repeats,
    _two_voices,
    _not_offered,
)


def _texts(spec: NodeSpec) -> Iterator[str]:
    for value in parts_of(spec.fields.values()):
        text = value.value if isinstance(value, Literal) else value
        if isinstance(text, str):
            yield text


def _takes_time(spec: NodeSpec) -> bool:
    if type_of(spec).takes_time or "pause" in spec.fields:
        return True
    if spec.skill is None:
        return False
    return spec.skill.binding is None or spec.skill.binding.kind is not BindingKind.TOPIC


def _at(spec: NodeSpec, code: str, message: str, hint: str) -> Diagnostic:
    return warning(code, spec.position, len(spec.kind), message, hint)
