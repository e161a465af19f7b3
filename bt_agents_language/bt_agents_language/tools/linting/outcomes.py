# SPDX-License-Identifier: Apache-2.0
"""How a node of a checked tree can end, as far as its words alone say it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

from bt_agents_language.expression.expressions import EvaluationError, Expression, MissingValue
from bt_agents_language.model.specs import Literal, NodeSpec, Value
from bt_agents_language.model.walking import iter_nodes
from bt_agents_language.nodes import FOREVER


class NodeOutcome(Enum):
    """One way in which a node can go."""

    SUCCESS = "succeeds"
    FAILURE = "fails"
    ENDLESS = "never ends"

    # That of Enum is computed anew each time, and these are members of many sets.
    __hash__ = object.__hash__


Outcomes = frozenset[NodeOutcome]

_FOREVER = Literal(value=FOREVER)
_COUNTS = {"retry": "attempts", "repeat": "times"}
_SUCCESS = frozenset({NodeOutcome.SUCCESS})
_FAILURE = frozenset({NodeOutcome.FAILURE})
_ENDLESS = frozenset({NodeOutcome.ENDLESS})
_EITHER = _SUCCESS | _FAILURE


def outcomes(spec: NodeSpec) -> Outcomes:
    """Return every way in which a node can go; a way too many where only a run shows it."""
    return every_outcome(list(iter_nodes(spec)))[id(spec)]


def every_outcome(nodes: Sequence[NodeSpec]) -> dict[int, Outcomes]:
    """Return every way in which each node of a tree can go; as :func:`outcomes`.

    Args:
        nodes: All nodes of a tree, parents before children.

    Returns:
        The ways by the identity of the node.
    """
    found: dict[int, Outcomes] = {}
    for spec in reversed(nodes):
        children = [found[id(child)] for child in spec.children]
        found[id(spec)] = _outcomes(spec, children) if children else _leaf(spec)
    return found


def _outcomes(spec: NodeSpec, children: list[Outcomes]) -> Outcomes:
    match spec.kind:
        case "sequence":
            return _one_after_the_other(children, NodeOutcome.SUCCESS)
        case "selector":
            return _one_after_the_other(children, NodeOutcome.FAILURE)
        case "parallel":
            return _parallel(spec, children)
        case "choose":
            fallback = any("condition" not in case.fields for case in spec.children)
            return _any_of(children) | (frozenset() if fallback else _FAILURE)
        case "random":
            return _any_of(children)
        case _ if spec.skill is None:
            return _wrapper(spec, children)
        case _:
            return _leaf(spec)


def constant(condition: Value | Expression | None) -> bool | None:
    """Return what a condition without names always says; None when only a run shows it."""
    if not isinstance(condition, Expression) or condition.mentions:
        return None
    try:
        return condition.evaluate(_no_name) is True
    except EvaluationError:
        return None


def endless(spec: NodeSpec) -> bool:
    """Return whether a node is a retry or repeat without a number."""
    count = _COUNTS.get(spec.kind)
    return count is not None and spec.fields.get(count) == _FOREVER


def _no_name(name: str) -> object:
    raise MissingValue(name)


def _one_after_the_other(children: list[Outcomes], goes_on: NodeOutcome) -> Outcomes:
    ends: set[NodeOutcome] = set()
    for child in children:
        ends |= child
        if goes_on not in child:
            ends.discard(goes_on)
            return frozenset(ends)
    return frozenset(ends)


def _any_of(children: list[Outcomes]) -> Outcomes:
    return frozenset().union(*children)


def _parallel(spec: NodeSpec, children: list[Outcomes]) -> Outcomes:
    if spec.fields.get("succeed_on") != Literal(value="all"):
        return _any_of(children) | _EITHER
    found = _any_of(children) - _SUCCESS
    return found | _SUCCESS if all(NodeOutcome.SUCCESS in child for child in children) else found


def _wrapper(spec: NodeSpec, children: list[Outcomes]) -> Outcomes:
    inner = children[0]
    match spec.kind:
        case "when" | "once" | "cooldown":
            left_out = _left_out(spec.fields)
            said = constant(spec.fields.get("condition"))
            if said is not None:
                return inner if said else left_out
            return inner | left_out
        case "succeed":
            return _counted_as(inner, NodeOutcome.SUCCESS)
        case "fail":
            return _counted_as(inner, NodeOutcome.FAILURE)
        case "while":
            said = constant(spec.fields.get("condition"))
            if said is not None:
                return inner if said else _FAILURE
            return (inner - _ENDLESS) | _FAILURE
        case "on_failure":
            return (inner - _FAILURE) | children[1] if NodeOutcome.FAILURE in inner else inner
        case "retry":
            return (inner - _FAILURE) | _ENDLESS if endless(spec) else inner
        case "repeat":
            return _repeated(spec, inner)
        case "timeout":
            return (inner - _ENDLESS) | _FAILURE
        case "invert":
            swapped = {
                NodeOutcome.SUCCESS: NodeOutcome.FAILURE,
                NodeOutcome.FAILURE: NodeOutcome.SUCCESS,
            }
            return frozenset(swapped.get(one, one) for one in inner)
    return inner


def _repeated(spec: NodeSpec, inner: Outcomes) -> Outcomes:
    if not endless(spec):
        return inner
    return inner | _ENDLESS if "until" in spec.fields else (inner - _SUCCESS) | _ENDLESS


def _counted_as(inner: Outcomes, outcome: NodeOutcome) -> Outcomes:
    return frozenset(one if one is NodeOutcome.ENDLESS else outcome for one in inner)


def _left_out(fields: Mapping[str, Value | Expression]) -> Outcomes:
    return _FAILURE if fields.get("otherwise") == Literal(value="failure") else _SUCCESS


def _leaf(spec: NodeSpec) -> Outcomes:
    match spec.kind:
        case "check":
            said = constant(spec.fields.get("condition"))
            return _EITHER if said is None else _SUCCESS if said else _FAILURE
        case "wait" | "set" | "log" if spec.skill is None and spec.plugin is None:
            # A name without a value makes them fail.
            plain = all(isinstance(value, Literal) for value in spec.fields.values())
            return _SUCCESS if plain else _EITHER
        case "wait_for":
            return _EITHER | _ENDLESS
    return _EITHER
