# SPDX-License-Identifier: Apache-2.0
"""Which nodes and branches of an agent's trees its tests have been through, and which not."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

from bt_agents_language.model.specs import AgentSpec, NodeSpec, Position
from bt_agents_language.tools.linting.outcomes import NodeOutcome, outcomes


class Mark(Enum):
    """What a node has been seen to do."""

    TICKED = "ticked"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    LEFT_OUT = "left out"
    BROKEN_OFF = "broken off"


Marks = Mapping[str, frozenset[Mark]]
"""Path of a node → what it has been seen to do."""

_NOT_TICKED = ("case", "weight")
"""What only says when or how often its child is picked."""

_BRANCHES: Mapping[str, tuple[tuple[Mark, str], ...]] = {
    "check": ((Mark.SUCCEEDED, "never true"), (Mark.FAILED, "never false")),
    "timeout": ((Mark.BROKEN_OFF, "never ran out of time"),),
    "while": ((Mark.BROKEN_OFF, "never broken off"),),
    **dict.fromkeys(("when", "once", "cooldown"), ((Mark.LEFT_OUT, "never left out"),)),
}


_OUTCOMES = {Mark.SUCCEEDED: NodeOutcome.SUCCESS, Mark.FAILED: NodeOutcome.FAILURE}


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Something that no test has been through.

    Attributes:
        path: Path of the node.
        position: Where it stands.
        words: What never happened: ``never ticked``.
    """

    path: str
    position: Position
    words: str

    def __str__(self) -> str:
        return f"{self.words}: {self.path} ({self.position.file}:{self.position.line})"


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """How much of one agent's trees has been tested.

    Attributes:
        agent: Name of the agent.
        total: Nodes and branches that there are.
        missed: How many of them no test has been through.
        gaps: The same, in the order of the trees; what lies below a gap is not listed again.
    """

    agent: str
    total: int
    missed: int
    gaps: tuple[Gap, ...]

    @property
    def percent(self) -> int:
        """Part that was tested, rounded down, so that only a whole one is 100."""
        return 100 * (self.total - self.missed) // self.total


def coverage(agent: AgentSpec, marks: Iterable[Marks]) -> Coverage:
    """Return how much of an agent's trees several rehearsals have been through together.

    Every node counts once for having been ticked. Where the tree decides, both ways count: a
    ``check`` true and false, a ``when``, ``once`` or ``cooldown`` left out, a ``timeout`` or
    ``while`` broken off, every alternative of a ``selector`` and what comes before an
    ``on_failure`` succeeding; what can only succeed or fail by its words counts one way.
    """
    seen: defaultdict[str, set[Mark]] = defaultdict(set)
    for one in marks:
        for path, found in one.items():
            seen[path] |= found
    total = missed = 0
    gaps: list[Gap] = []
    waiting = [(root, True) for root in (agent.on_cancel, agent.tree) if root is not None]
    while waiting:
        node, reached = waiting.pop()
        if node.kind in _NOT_TICKED:
            waiting += [(child, reached) for child in reversed(node.children)]
            continue
        ticked = Mark.TICKED in seen[node.path]
        if reached and not ticked:
            gaps.append(_gap(node, "never ticked"))
        branches = list(_branches(node))
        open_branches = [branch for branch in branches if branch[1] not in seen[branch[0].path]]
        gaps += [
            _gap(where, words)
            for where, _, words in open_branches
            if Mark.TICKED in seen[where.path]
        ]
        total += 1 + len(branches)
        missed += len(open_branches) + (not ticked)
        waiting += [(child, ticked) for child in reversed(node.children)]
    return Coverage(agent=agent.name, total=total, missed=missed, gaps=tuple(gaps))


def _branches(node: NodeSpec) -> Iterator[tuple[NodeSpec, Mark, str]]:
    """Return what must have been seen of a node besides a tick, as far as it is possible."""
    possible = outcomes(node)
    for mark, words in _BRANCHES.get(node.kind, ()):
        if _OUTCOMES.get(mark, NodeOutcome.FAILURE) in possible or mark is Mark.LEFT_OUT:
            yield node, mark, words
    if node.kind in ("selector", "on_failure"):
        for child in node.children[: 1 if node.kind == "on_failure" else None]:
            if NodeOutcome.SUCCESS in outcomes(child):
                yield child, Mark.SUCCEEDED, "never succeeded"


def _gap(node: NodeSpec, words: str) -> Gap:
    return Gap(path=node.path, position=node.position, words=words)
