# SPDX-License-Identifier: Apache-2.0
"""From a checked spec to a py_trees tree whose nodes know their path in the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy
from py_trees.composites import Composite, Parallel, Selector, Sequence

from bt_agents.engine.context import RunContext
from bt_agents.engine.leaves import Check, Leaf, Set, SkillLeaf, Wait, WaitFor
from bt_agents.engine.modifiers import Invert, Modifier, Repeat, Retry, Timeout, When
from bt_agents.engine.scope import InputScope, Scope
from bt_agents.language.expressions import Expression
from bt_agents.language.specs import Literal, NodeSpec

_LEAVES: Mapping[str, type[Leaf]] = {"check": Check, "set": Set, "wait": Wait, "wait_for": WaitFor}

_MODIFIERS: Mapping[str, type[Modifier]] = {
    "when": When,
    "retry": Retry,
    "repeat": Repeat,
    "timeout": Timeout,
    "invert": Invert,
}


def build(spec: NodeSpec, context: RunContext) -> Behaviour:
    """Return the tree of a spec, ready to be ticked; its nodes carry their spec as ``spec``."""
    return _build(spec, context, context.scope)


def _build(spec: NodeSpec, context: RunContext, scope: Scope) -> Behaviour:
    if spec.skill is not None:
        return SkillLeaf(spec, context, scope)
    if spec.kind in _LEAVES:
        return _LEAVES[spec.kind](spec, context, scope)
    if spec.kind == "subtree":
        inputs = {k: v for k, v in spec.fields.items() if not isinstance(v, Expression)}
        scope = InputScope(inputs=inputs, caller=scope)
    children = [_build(child, context, scope) for child in spec.children]
    if spec.kind in _MODIFIERS:
        return _MODIFIERS[spec.kind](spec, context, scope, children[0])
    composite = _COMPOSITES[spec.kind](spec)
    composite.spec = spec
    composite.add_children(children)
    return composite


def _option(spec: NodeSpec, name: str, default: object) -> object:
    value = spec.fields.get(name)
    return value.value if isinstance(value, Literal) else default


def _sequence(spec: NodeSpec) -> Composite:
    return Sequence(spec.name, memory=bool(_option(spec, "memory", True)))


def _selector(spec: NodeSpec) -> Composite:
    return Selector(spec.name, memory=bool(_option(spec, "memory", True)))


def _parallel(spec: NodeSpec) -> Composite:
    one = _option(spec, "succeed_on", "all") == "one"
    policy = ParallelPolicy.SuccessOnOne() if one else ParallelPolicy.SuccessOnAll()
    return Parallel(spec.name, policy=policy)


_COMPOSITES: Mapping[str, Callable[[NodeSpec], Composite]] = {
    "sequence": _sequence,
    "selector": _selector,
    "parallel": _parallel,
    # Handled means: try the node, and after a FAILURE what is written to be done instead.
    "on_failure": _selector,
    # A subtree has one child, so a sequence passes its status on.
    "subtree": _sequence,
}
