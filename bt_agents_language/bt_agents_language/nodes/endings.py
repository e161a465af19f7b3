# SPDX-License-Identifier: Apache-2.0
"""Outcomes of nodes, as far as their fields determine them, and nodes that never run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

from bt_agents_language.expression.expression_values import EvaluationError
from bt_agents_language.expression.expressions import Expression, MissingValue
from bt_agents_language.model.specs import Literal, NodeSpec, Value


class Outcome(Enum):
    """Possible outcome of a node."""

    SUCCESS = "succeeds"
    FAILURE = "fails"
    ENDLESS = "never ends"

    # Enum computes its hash each time, and these are members of many sets.
    __hash__ = object.__hash__


Outcomes = frozenset[Outcome]

SUCCESS = frozenset({Outcome.SUCCESS})
FAILURE = frozenset({Outcome.FAILURE})
ENDLESS = frozenset({Outcome.ENDLESS})
EITHER = SUCCESS | FAILURE


class Unreached(NamedTuple):
    """Node, or wrapper of one, that never runs."""

    node: NodeSpec
    reason: str
    hint: str


def as_its_child(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    """Return the outcomes of the first child; both for a leaf."""
    return children[0] if children else EITHER


def always_success(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    """Return success, for a leaf that fails only if a name in its fields has no value."""
    plain = all(isinstance(value, Literal) for value in spec.fields.values())
    return SUCCESS if plain else EITHER


def in_sequence(children: Sequence[Outcomes], continues_on: Outcome) -> Outcomes:
    """Return the outcomes of children where each starts after one outcome of the previous."""
    ends: Outcomes = frozenset()
    for child in children:
        ends |= child
        if continues_on not in child:
            return ends - {continues_on}
    return ends


def any_of(children: Sequence[Outcomes]) -> Outcomes:
    """Return the outcomes that at least one child has."""
    return frozenset().union(*children)


def counted_as(inner: Outcomes, outcome: Outcome) -> Outcomes:
    """Return the outcomes of a node whose end always counts as one of them."""
    return frozenset(one if one is Outcome.ENDLESS else outcome for one in inner)


def limited(inner: Outcomes) -> Outcomes:
    """Return the outcomes of a node that fails if it is stopped after some time."""
    return (inner - ENDLESS) | FAILURE


def skippable(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    """Return the outcomes of a decorator that skips its node under its ``condition``."""
    inner = children[0]
    skipped = FAILURE if spec.fields.get("otherwise") == Literal(value="failure") else SUCCESS
    is_true = constant(spec.fields.get("condition"))
    if is_true is not None:
        return inner if is_true else skipped
    return inner | skipped


def constant(condition: Value | Expression | None) -> bool | None:
    """Return the result of a condition without names; None if known only at run time."""
    if not isinstance(condition, Expression) or condition.mentions:
        return None
    try:
        return condition.is_true(_no_name)
    except EvaluationError:
        return None


def unreached_after(
    composite: NodeSpec, continues_on: Outcome, outcomes: Mapping[int, Outcomes]
) -> Iterator[Unreached]:
    """Yield the first child after a child that no other ever follows.

    Each child starts after one outcome of the previous; outcomes are looked up by node identity.
    """
    for before, after in pairwise(composite.children):
        ends = outcomes[id(before)]
        if continues_on in ends:
            continue
        how = " or ".join(sorted(outcome.value for outcome in ends))
        yield Unreached(
            after,
            f"'{before.kind}' in line {before.position.line} {how}, and '{composite.kind}' goes "
            f"on only when a child {continues_on.value}",
            "move it before that node, or remove it",
        )
        return


def never_true(spec: NodeSpec, outcomes: Mapping[int, Outcomes]) -> Iterator[Unreached]:
    """Yield a decorator whose ``condition`` is constant and false."""
    if constant(spec.fields.get("condition")) is False:
        yield Unreached(
            spec,
            f"its '{spec.kind}' is never true",
            "use a name in it, such as live.person, or remove the node",
        )


def _no_name(name: str) -> object:
    raise MissingValue(name)
