# SPDX-License-Identifier: Apache-2.0
"""Instrumented agents: skills that reach the script of a rehearsal, and replaced nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from bt_agents_core.field_types import BindingKind
from bt_agents_language.files.testing.path_patterns import matches
from bt_agents_language.files.testing.scenarios import REPLACED, Replacement
from bt_agents_language.model.specs import (
    AgentSpec,
    Binding,
    MapValue,
    NodeSpec,
    Reference,
    SkillSpec,
)


def with_replacements(agent: AgentSpec, replacements: Iterable[Replacement]) -> AgentSpec:
    """Return the agent with replacements in place of some nodes."""
    every = tuple(replacements)
    if not every:
        return agent
    return _changed(agent, lambda root: _with_replacements(root, every))


def with_open_bindings(agent: AgentSpec) -> AgentSpec:
    """Return the agent with skills that send their inputs unchanged.

    The binding decides what a skill sends on a robot, and differs between robots; a rehearsal
    compares with the author's text.
    """
    return _changed(agent, _with_open_bindings)


def replaced(path: str, replacements: Iterable[Replacement]) -> Replacement | None:
    """Return the replacement of a node; None if it has none."""
    return next((one for one in replacements if matches(one.pattern, path)), None)


def _changed(agent: AgentSpec, change: Callable[[NodeSpec], NodeSpec]) -> AgentSpec:
    on_cancel = agent.on_cancel
    return replace(
        agent, tree=change(agent.tree), on_cancel=None if on_cancel is None else change(on_cancel)
    )


def _with_replacements(node: NodeSpec, replacements: tuple[Replacement, ...]) -> NodeSpec:
    other = replaced(node.path, replacements)
    if other is not None:
        return _at_path(replace(other.node, name=f"{other.node.name} (replaced)"), node.path)
    children = tuple(_with_replacements(child, replacements) for child in node.children)
    return replace(node, children=children)


def _at_path(node: NodeSpec, path: str) -> NodeSpec:
    children = tuple(_at_path(child, path) for child in node.children)
    return replace(node, path=path + node.path.removeprefix(REPLACED), children=children)


def _with_open_bindings(node: NodeSpec) -> NodeSpec:
    return replace(
        node,
        children=tuple(map(_with_open_bindings, node.children)),
        skill=None if node.skill is None else _bound(node.skill),
    )


def _bound(skill: SkillSpec) -> SkillSpec:
    binding = skill.binding
    if binding is None:
        binding = Binding(
            kind=BindingKind.ACTION,
            name=skill.name,
            type="",
            fields=MapValue(items={}),
            outputs={output.name: output.name for output in skill.outputs},
        )
    inputs = {one.name: Reference(name=one.name, type=one.type) for one in skill.inputs}
    fields = MapValue(items=inputs) if inputs else binding.fields
    open_binding = replace(binding, fields=fields, succeed_when=None, error_code=None, place="")
    return replace(skill, binding=open_binding)
