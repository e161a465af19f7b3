# SPDX-License-Identifier: Apache-2.0
"""Builds py_trees trees from checked specs; each node knows its path in the file."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules

from py_trees.behaviour import Behaviour

from bt_agents.engine import nodes
from bt_agents.engine.context import NodeMaker, RunContext
from bt_agents.engine.nodes.plugin import PluginLeaf
from bt_agents.engine.nodes.skill import SkillLeaf
from bt_agents.engine.scope import Scope
from bt_agents_core.gc_pause import gc_paused
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.catalogue import type_of


def find_behaviours() -> dict[str, NodeMaker]:
    """Return the makers of all node modules, by key."""
    found: dict[str, NodeMaker] = {}
    for module in iter_modules(nodes.__path__):
        found |= import_module(f"{nodes.__name__}.{module.name}").BEHAVIOURS
    return found


BEHAVIOURS: Mapping[str, NodeMaker] = find_behaviours()
"""Key of a node type → maker of its behaviour, from the ``BEHAVIOURS`` of all node modules."""


@gc_paused()
def build(spec: NodeSpec, context: RunContext) -> Behaviour:
    """Return the tree of a spec, ready to be ticked; its nodes carry their spec as ``spec``."""

    def build_node(spec: NodeSpec, scope: Scope) -> Behaviour:
        scope.declare(spec.outputs)
        if type_of(spec).assigns:
            scope.declare(spec.fields)
        if spec.plugin is not None:
            return PluginLeaf(spec, context, scope)
        maker = SkillLeaf if spec.skill is not None else BEHAVIOURS[spec.kind]
        return maker(spec, context, scope, build_node)

    return build_node(spec, context.scope)
