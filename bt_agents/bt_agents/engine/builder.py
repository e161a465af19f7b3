# SPDX-License-Identifier: Apache-2.0
"""From a checked spec to a py_trees tree whose nodes know their path in the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from py_trees.behaviour import Behaviour
from py_trees.composites import Composite

from bt_agents.engine.choices import Case, Choose, RandomChoice, Weight
from bt_agents.engine.concurrency import CountingParallel
from bt_agents.engine.context import RunContext
from bt_agents.engine.feedback_leaf import GiveFeedback
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.gates import Cooldown, Once, When
from bt_agents.engine.leaves import Check, Leaf, Log, Set
from bt_agents.engine.light_behaviour import LightSelector, LightSequence
from bt_agents.engine.loops import Repeat, Retry
from bt_agents.engine.modifiers import Fail, Invert, NodeDecorator, Succeed, Timeout, While
from bt_agents.engine.scope import Scope
from bt_agents.engine.skill_leaf import SkillLeaf
from bt_agents.engine.subtree import Subtree, subtree_scope
from bt_agents.engine.waits import Wait, wait_for
from bt_agents.plugins.plugin_leaf import PluginLeaf
from bt_agents_language.gc_pause import gc_paused
from bt_agents_language.model.specs import NodeSpec


def _sequence(
    spec: NodeSpec, context: RunContext, scope: Scope, children: list[Behaviour]
) -> Composite:
    return LightSequence(spec.name, _memory(spec, scope), children)


def _selector(
    spec: NodeSpec, context: RunContext, scope: Scope, children: list[Behaviour]
) -> Composite:
    return LightSelector(spec.name, _memory(spec, scope), children)


def _memory(spec: NodeSpec, scope: Scope) -> bool:
    return bool(NodeFields(spec=spec, names=scope).constant("memory", True))


LeafMaker = Callable[[NodeSpec, RunContext, Scope], Leaf]

LEAVES: Mapping[str, LeafMaker] = {
    "check": Check,
    "set": Set,
    "wait": Wait,
    "wait_for": wait_for,
    "log": Log,
    "give_feedback": GiveFeedback,
    "action": SkillLeaf,
    "service": SkillLeaf,
    "publish": SkillLeaf,
}
"""Kinds without children; skills and plug-ins come on top of these."""

MODIFIERS: Mapping[str, type[NodeDecorator]] = {
    "when": When,
    "once": Once,
    "cooldown": Cooldown,
    "succeed": Succeed,
    "fail": Fail,
    "while": While,
    "retry": Retry,
    "repeat": Repeat,
    "timeout": Timeout,
    "invert": Invert,
    "case": Case,
    "weight": Weight,
}
"""Kinds around one child, which they change."""

COMPOSITES: Mapping[str, Callable[[NodeSpec, RunContext, Scope, list[Behaviour]], Composite]] = {
    "sequence": _sequence,
    "selector": _selector,
    # Handled means: try the node, and after a FAILURE what is written to be done instead.
    "on_failure": _selector,
    "parallel": CountingParallel,
    "choose": Choose,
    "random": RandomChoice,
}
"""Kinds with several children."""

SUBTREE = "subtree"
"""The kind whose child has names of its own."""


@gc_paused()
def build(spec: NodeSpec, context: RunContext, plugins: LeafMaker = PluginLeaf) -> Behaviour:
    """Return the tree of a spec, ready to be ticked; its nodes carry their spec as ``spec``.

    Args:
        spec: The outermost node.
        context: What the nodes share.
        plugins: Makes the leaves whose behaviours come from packages.
    """
    return _build(spec, context, context.scope, plugins)


def _build(spec: NodeSpec, context: RunContext, scope: Scope, plugins: LeafMaker) -> Behaviour:
    if spec.plugin is not None:
        return plugins(spec, context, scope)
    if spec.skill is not None:
        return SkillLeaf(spec, context, scope)
    if spec.kind in LEAVES:
        return LEAVES[spec.kind](spec, context, scope)
    if spec.kind == SUBTREE:
        inside = subtree_scope(spec, context, scope)
        tree = _build(spec.children[0], context, inside, plugins)
        return Subtree(spec, context, scope, inside, tree)
    children = [_build(child, context, scope, plugins) for child in spec.children]
    if spec.kind in MODIFIERS:
        return MODIFIERS[spec.kind](spec, context, scope, children[0])
    composite = COMPOSITES[spec.kind](spec, context, scope, children)
    composite.spec = spec
    return composite
