# SPDX-License-Identifier: Apache-2.0
"""Catalogue of all node types, decorators and sibling keys of the language."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules

from bt_agents_core.field_types import FieldType
from bt_agents_language import nodes
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType, Role, SiblingKey
from bt_agents_language.nodes.plugin import PLUGIN
from bt_agents_language.nodes.skill import SKILL
from bt_agents_language.nodes.subtree import OUTPUTS, WITH
from bt_agents_language.nodes.weight import WEIGHT_KEY

_BUILD_ON_IT = ("catalogue", "plugin_discovery", "symbols")
"""Files of this folder that need the catalogue."""


def find_node_types(*roles: Role) -> Mapping[str, NodeType]:
    """Return the types with these roles by key, in order, from all files of this folder."""
    found: dict[str, NodeType] = {}
    for module in iter_modules(nodes.__path__):
        if module.name not in _BUILD_ON_IT:
            values = vars(import_module(f"{nodes.__name__}.{module.name}")).values()
            found |= {one.key: one for one in values if isinstance(one, NodeType)}
    del found[SKILL.key], found[PLUGIN.key]
    types = sorted(found.values(), key=lambda one: (one.order, one.key))
    return {one.key: one for one in types if one.role in roles}


NODE_TYPES = find_node_types(Role.COMPOSITE, Role.LEAF)
"""Composites and leaves by key, in the order of the documentation; skills and plug-ins come on
top of these."""

DECORATORS = find_node_types(Role.DECORATOR)
"""Decorators by key, in the order that they wrap a node: the first one is the outermost."""

BRANCHES = find_node_types(Role.BRANCH)
"""Wrappers of the children of some composites, by the kind of their nodes."""

NAME = SiblingKey(
    field=NodeField(
        name="name", content=Content.CONSTANT, type=FieldType.TEXT, description="Name for people."
    ),
    where="any node",
    example="""\
tree:
  sequence:
    - name: greeting
      say: Hello.
""",
)

SIBLINGS: Mapping[str, SiblingKey] = {one.key: one for one in (NAME, WITH, OUTPUTS, WEIGHT_KEY)}
"""Other keys next to a node."""

SIBLING_KEYS = (*DECORATORS, *SIBLINGS)
"""All keys that are allowed next to a node."""

WORDS = frozenset((*NODE_TYPES, *SIBLING_KEYS, "children"))
"""Words of the language, which are not allowed as names of skills and plug-ins."""


def type_of(spec: NodeSpec) -> NodeType:
    """Return the type of a checked node."""
    if spec.plugin is not None:
        return PLUGIN
    found = NODE_TYPES.get(spec.kind)
    if found is not None:
        return found
    if spec.skill is not None:
        return SKILL
    return DECORATORS.get(spec.kind) or BRANCHES[spec.kind]
