# SPDX-License-Identifier: Apache-2.0
"""Warnings about agents that can be read: what is legal, but rarely meant by its author."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, pairwise

from bt_agents_language.files.testing.scenarios import SPOKEN
from bt_agents_language.gc_pause import gc_paused
from bt_agents_language.model.specs import (
    AgentSpec,
    BindingKind,
    Literal,
    NodeSpec,
    Position,
    UnusedInput,
)
from bt_agents_language.model.walking import iter_nodes
from bt_agents_language.nodes import KINDS
from bt_agents_language.tools.linting.outcomes import (
    NodeOutcome,
    Outcomes,
    constant,
    endless,
    every_outcome,
)
from bt_agents_language.tools.linting.reads import names_read, texts_of
from bt_agents_language.yaml.diagnostics import Diagnostic, shown

_TAKING_TIME = ("wait", "wait_for", "action", "service")
_GUARDS = ("timeout", "while")
_COUNTS = {"retry": "attempts", "repeat": "times"}
_PATIENCE = 20
"""Oftener than that nobody wants to hear the same."""
_WRITTEN_BESIDE = ("case", "weight")
"""Wrappers that no key of their own stands for."""

_UNMARKED = re.compile(r"(?<![$\w])(?:\$([^\W\d]\w*)|\{([^\W\d]\w*)\})")

Found = Iterator[Diagnostic]


class _Tree:
    """A tree as the rules look at it.

    Attributes:
        root: Its outermost node.
        nodes: All its nodes, parents before children.
        kinds: What kinds there are among them.
    """

    def __init__(self, root: NodeSpec) -> None:
        self.root = root
        self.nodes = list(iter_nodes(root))
        self.kinds = {spec.kind for spec in self.nodes}

    def of(self, *kinds: str) -> list[NodeSpec]:
        """Return the nodes of some kinds."""
        if self.kinds.isdisjoint(kinds):
            return []
        return [spec for spec in self.nodes if spec.kind in kinds]


@gc_paused()
def lint(agent: AgentSpec) -> tuple[Diagnostic, ...]:
    """Return the warnings about an agent, in the order of its file."""
    found: dict[tuple[Position, str], Diagnostic] = {}
    trees = [_Tree(root) for root in (agent.tree, agent.on_cancel) if root is not None]
    for tree in trees:
        for rule in _RULES:
            for one in rule(tree):
                # A subtree that is used twice is written once.
                found.setdefault((one.position, one.code), one)
    nodes = [node for tree in trees for node in tree.nodes]
    named = (
        _unread_tunables(agent, nodes),
        unused_inputs(agent.unused_inputs),
        _unmarked_names(agent, nodes),
    )
    for one in chain(*named):
        found[(one.position, one.code)] = one
    return tuple(sorted(found.values(), key=lambda one: (one.position.line, one.position.column)))


def _endless_speech(tree: _Tree) -> Found:
    if all(_rounds(spec) <= _PATIENCE for spec in tree.of(*_COUNTS)):
        return iter(())

    def walk(spec: NodeSpec, loop: NodeSpec | None, guarded: bool) -> Found:
        if spec.kind == "once":
            loop = None
        elif spec.kind in _GUARDS:
            # Inside of a loop it ends one round only.
            guarded = guarded or loop is None
        elif (endless(spec) or _rounds(spec) > _PATIENCE) and not guarded:
            loop = loop if loop is not None and _rounds(loop) > _rounds(spec) else spec
        elif loop is not None and _speaks(spec):
            key = _COUNTS[loop.kind]
            rounds = _rounds(loop)
            many = f"{rounds} {key} are for ever for whoever stands there"
            end = "without end" if math.isinf(rounds) else f"of {rounds} {key}"
            fewer = "a number" if math.isinf(rounds) else "a smaller number"
            says = "the robot may say this for ever" if math.isinf(rounds) else many
            yield _at(
                spec,
                "endless-speech",
                f"'{spec.kind}' stands inside a '{loop.kind}' {end} (line "
                f"{loop.position.line}): {says}",
                f"give '{loop.kind}' {fewer}: {{{key}: 3, …}}",
            )
        for child in spec.children:
            yield from walk(child, loop, guarded)

    return walk(tree.root, None, False)


def _rounds(spec: NodeSpec) -> float:
    """Return how often a loop does its node at most; 1 when nothing is known."""
    count = spec.fields.get(_COUNTS.get(spec.kind, ""))
    if endless(spec):
        return math.inf
    number = count.value if isinstance(count, Literal) else 1
    return number if isinstance(number, int) else 1


def _endless_waits(tree: _Tree) -> Found:
    def walk(spec: NodeSpec, ended: bool) -> Found:
        if spec.kind == "parallel":
            ended = ended or spec.fields.get("succeed_on") != Literal(value="all")
        ended = ended or spec.kind in _GUARDS
        if spec.kind == "wait_for" and not ended:
            yield _at(
                spec,
                "endless-wait",
                "nothing ends this wait if what it waits for never comes",
                "write 'timeout: 30 s' beside it, or around what it is part of",
            )
        for child in spec.children:
            yield from walk(child, ended)

    return walk(tree.root, False) if "wait_for" in tree.kinds else iter(())


def _never_reached(tree: _Tree) -> Found:
    ways = every_outcome(tree.nodes)
    for spec in tree.of("sequence", "selector", "choose", "random", "when", "while"):
        match spec.kind:
            case "sequence":
                yield from _behind(spec, NodeOutcome.SUCCESS, ways)
            case "selector":
                yield from _behind(spec, NodeOutcome.FAILURE, ways)
            case "choose":
                yield from _cases(spec)
            case "random":
                yield from (
                    _unreached(child, "its 'weight' is 0", "give it a weight above 0")
                    for child in spec.children
                    if child.fields.get("weight") == Literal(value=0.0)
                )
            case "when" | "while" if constant(spec.fields.get("condition")) is False:
                hint = "use a name in it, such as live.person, or remove the node"
                yield _unreached(spec, f"its '{spec.kind}' is never true", hint)


def _behind(composite: NodeSpec, goes_on: NodeOutcome, ways: Mapping[int, Outcomes]) -> Found:
    """Find the first child behind one that never lets it come to that."""
    for before, after in pairwise(composite.children):
        ends = ways[id(before)]
        if goes_on in ends:
            continue
        how = " or ".join(sorted(outcome.value for outcome in ends))
        yield _unreached(
            after,
            f"'{before.kind}' in line {before.position.line} {how}, and '{composite.kind}' goes "
            f"on only when a child {goes_on.value}",
            "move it before that node, or remove it",
        )
        return


def _cases(choose: NodeSpec) -> Found:
    first: NodeSpec | None = None
    for case in choose.children:
        says = constant(case.fields.get("condition"))
        if first is not None:
            where = f"the 'when' of the case in line {first.position.line} is always true"
            yield _unreached(case, where, "move it before that case, or remove it")
            return
        if says is False:
            yield _unreached(case, "its 'when' is never true", "use a name in it, or remove it")
        first = case if says else None


def _busy_repeats(tree: _Tree) -> Found:
    for spec in tree.of(*_COUNTS):
        if (
            endless(spec)
            and "pause" not in spec.fields
            and not any(map(_takes_time, iter_nodes(spec)))
        ):
            key = _COUNTS[spec.kind]
            yield _at(
                spec,
                "busy-repeat",
                f"this '{spec.kind}' starts its node again at every tick, without end and without "
                "a pause",
                f"add a pause: {spec.kind}: {{{key}: forever, pause: 1 s}}",
            )


def _two_voices(tree: _Tree) -> Found:
    for spec in tree.of("parallel"):
        spoken = [next(filter(_speaks, iter_nodes(child)), None) for child in spec.children]
        first, *others = [one for one in spoken if one is not None] or [spec]
        for other in others:
            yield _at(
                other,
                "two-voices",
                f"this '{other.kind}' and the one in line {first.position.line} are in different "
                "branches of a 'parallel': the robot may say both at the same time",
                "put what is said into one branch, as a sequence",
            )


def _not_offered(tree: _Tree) -> Found:
    for spec in tree.nodes:
        if spec.skill is not None and spec.skill.binding is None:
            yield _at(
                spec,
                "skill-not-offered",
                f"no robot offers '{spec.kind}' here: {spec.skill.unoffered}",
                "bind it under 'bindings:' of a skills file; until then the agent does not bid",
            )


def _unmarked_names(agent: AgentSpec, nodes: Sequence[NodeSpec]) -> Found:
    """Find ``$place`` and ``{place}`` in texts, where ``${place}`` is meant."""
    candidates = [
        (node, match)
        for node in nodes
        if node.fields
        for text in texts_of(node)
        if "$" in text or "{" in text
        for match in _UNMARKED.finditer(text)
    ]
    if not candidates:
        return
    known = {tunable.name for tunable in agent.tunables}
    known |= {name for node in nodes for name in (*node.outputs, *node.feedback)}
    known |= {name for node in nodes if node.kind == "set" for name in node.fields}
    for node, match in candidates:
        name = match[1] or match[2]
        if name in known:
            yield _at(
                node,
                "unmarked-name",
                f"'{match[0]}' in a text of '{node.kind}' stays as it is, though there is a "
                f"'{name}'",
                f"write ${{{name}}} for its value",
            )


def unused_inputs(inputs: Iterable[UnusedInput]) -> Found:
    """Return the warnings about inputs of subtrees, of an agent or of a library."""
    for one in inputs:
        yield _warning(
            "unused-input",
            one.position,
            len(one.name),
            f"subtree {shown(one.subtree)} never uses its input {shown(one.name)}",
            f"write ${{{one.name}}} where it is needed, or remove the input",
        )


def _unread_tunables(agent: AgentSpec, nodes: Sequence[NodeSpec]) -> Found:
    unread = {tunable.name for tunable in agent.tunables}
    for node in nodes:
        if not unread:
            return
        # The trees of a library see its own names only.
        if node.position.file == agent.file:
            unread.difference_update(names_read(node))
    for tunable in agent.tunables:
        if tunable.name in unread:
            yield _warning(
                "unread-tunable",
                tunable.position,
                len(tunable.name),
                f"nothing uses the tunable {shown(tunable.name)}: turning it changes nothing",
                f"write ${{{tunable.name}}} where it belongs, or remove it",
            )


_RULES: tuple[Callable[[_Tree], Found], ...] = (
    _endless_speech,
    _endless_waits,
    _never_reached,
    _busy_repeats,
    _two_voices,
    _not_offered,
)


def _speaks(spec: NodeSpec) -> bool:
    return spec.skill is not None and spec.skill.name in SPOKEN


def _takes_time(spec: NodeSpec) -> bool:
    if spec.plugin is not None or spec.kind in _TAKING_TIME or "pause" in spec.fields:
        return True
    if spec.skill is None or spec.kind in KINDS:
        return False
    return spec.skill.binding is None or spec.skill.binding.kind is not BindingKind.TOPIC


def _unreached(spec: NodeSpec, why: str, hint: str) -> Diagnostic:
    key = spec.children[0] if spec.kind in _WRITTEN_BESIDE else spec
    return _at(key, "never-reached", f"this is never done: {why}", hint)


def _at(spec: NodeSpec, code: str, message: str, hint: str) -> Diagnostic:
    return _warning(code, spec.position, len(spec.kind), message, hint)


def _warning(code: str, position: Position, width: int, message: str, hint: str) -> Diagnostic:
    end = position._replace(column=position.column + width)
    return Diagnostic(code=code, position=position, message=message, hint=hint, end=end)
