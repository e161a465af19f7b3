# SPDX-License-Identifier: Apache-2.0
"""Coverage of an agent's trees by its tests: nodes ticked and branches taken."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from bt_agents_core.diagnostic import Position
from bt_agents_language.model.specs import AgentSpec, NodeSpec
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.endings import Outcome
from bt_agents_language.nodes.node_type import Mark, Role
from bt_agents_language.tools.lint import outcomes

Marks = Mapping[str, frozenset[Mark]]
"""Path of a node → marks of its behaviour."""

_OUTCOMES = {Mark.SUCCEEDED: Outcome.SUCCESS, Mark.FAILED: Outcome.FAILURE}


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Node or branch that no test covers, with a text such as ``never ticked``."""

    path: str
    position: Position
    text: str

    def __str__(self) -> str:
        return f"{self.text}: {self.path} ({self.position.file}:{self.position.line})"


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """Coverage of one agent's trees.

    Attributes:
        total: Number of nodes and branches.
        missed: Number of those that no test covers.
        gaps: The missed ones in tree order, without those below another gap.
    """

    agent: str
    total: int
    missed: int
    gaps: tuple[Gap, ...]

    @property
    def percent(self) -> int:
        """Percentage covered, rounded down, so that only full coverage is 100."""
        return 100 * (self.total - self.missed) // self.total


def coverage(agent: AgentSpec, marks: Iterable[Marks]) -> Coverage:
    """Return the coverage of an agent's trees by several rehearsals together.

    Every ticked node counts once. At decisions both ways count: a ``check`` true and false, a
    ``when``, ``once`` or ``cooldown`` skipped, a ``timeout`` or ``while`` interrupted, every
    alternative of a ``selector``, and success before an ``on_failure``. A node whose fields allow
    only success or only failure counts one way.
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
        if type_of(node).role is Role.BRANCH:
            # It is never ticked, but decides when or how often its child is selected.
            waiting += [(child, reached) for child in reversed(node.children)]
            continue
        ticked = Mark.TICKED in seen[node.path]
        if reached and not ticked:
            gaps.append(_gap(node, "never ticked"))
        branches = list(_branches(node))
        open_branches = [branch for branch in branches if branch[1] not in seen[branch[0].path]]
        gaps += [
            _gap(where, text)
            for where, _, text in open_branches
            if Mark.TICKED in seen[where.path]
        ]
        total += 1 + len(branches)
        missed += len(open_branches) + (not ticked)
        waiting += [(child, ticked) for child in reversed(node.children)]
    return Coverage(agent=agent.name, total=total, missed=missed, gaps=tuple(gaps))


def _branches(node: NodeSpec) -> Iterator[tuple[NodeSpec, Mark, str]]:
    """Yield the possible branches of a node: the node, its required mark, and the gap as text."""
    node_type = type_of(node)
    possible = outcomes(node) if node_type.to_cover else frozenset()
    for mark, text in node_type.to_cover:
        if _OUTCOMES.get(mark, Outcome.FAILURE) in possible or mark is Mark.LEFT_OUT:
            yield node, mark, text
    for child in node_type.alternatives(node):
        if Outcome.SUCCESS in outcomes(child):
            yield child, Mark.SUCCEEDED, "never succeeded"


def _gap(node: NodeSpec, text: str) -> Gap:
    return Gap(path=node.path, position=node.position, text=text)
