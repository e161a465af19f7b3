# SPDX-License-Identifier: Apache-2.0
"""An agent made ready for a rehearsal: its skills reach the script, some nodes are replaced."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from bt_agents.language.expressions import parse_expression
from bt_agents.language.path_patterns import matches
from bt_agents.language.scenarios import Replacement
from bt_agents.language.specs import (
    AgentSpec,
    Binding,
    BindingKind,
    MapValue,
    NodeSpec,
    Reference,
    SkillSpec,
)


def prepared(agent: AgentSpec, replacements: Iterable[Replacement]) -> AgentSpec:
    """Return the agent with replaced nodes, and with skills that send their inputs as they are.

    What a skill sends on the robot is a matter of its binding, which differs between robots; a
    rehearsal is about the words of the author.
    """
    every = tuple(replacements)
    on_cancel = agent.on_cancel
    return replace(
        agent,
        tree=_node(agent.tree, every),
        on_cancel=None if on_cancel is None else _node(on_cancel, every),
    )


def replaced(path: str, replacements: Iterable[Replacement]) -> Replacement | None:
    """Return the replacement of a node, None when it stays as it is."""
    return next((one for one in replacements if matches(one.pattern, path)), None)


def _node(node: NodeSpec, replacements: tuple[Replacement, ...]) -> NodeSpec:
    other = replaced(node.path, replacements)
    if other is not None:
        condition = parse_expression("true" if other.succeed else "false")
        name = f"{node.name} (replaced)"
        fields = {"condition": condition}
        return NodeSpec(
            path=node.path, position=node.position, kind="check", name=name, fields=fields
        )
    return replace(
        node,
        children=tuple(_node(child, replacements) for child in node.children),
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
    return replace(skill, binding=replace(binding, fields=fields, succeed_when=None))
