# SPDX-License-Identifier: Apache-2.0
"""Catalogue of all node types, decorators and sibling keys of the language."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.field_types import FieldType
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.action import ACTION
from bt_agents_language.nodes.case import CASE
from bt_agents_language.nodes.check import CHECK
from bt_agents_language.nodes.choose import CHOOSE
from bt_agents_language.nodes.cooldown import COOLDOWN
from bt_agents_language.nodes.fail import FAIL
from bt_agents_language.nodes.give_feedback import GIVE_FEEDBACK
from bt_agents_language.nodes.invert import INVERT
from bt_agents_language.nodes.log import LOG
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType, SiblingKey
from bt_agents_language.nodes.on_failure import ON_FAILURE
from bt_agents_language.nodes.once import ONCE
from bt_agents_language.nodes.parallel import PARALLEL
from bt_agents_language.nodes.plugin import PLUGIN
from bt_agents_language.nodes.publish import PUBLISH
from bt_agents_language.nodes.random import RANDOM
from bt_agents_language.nodes.repeat import REPEAT
from bt_agents_language.nodes.retry import RETRY
from bt_agents_language.nodes.selector import SELECTOR
from bt_agents_language.nodes.sequence import SEQUENCE
from bt_agents_language.nodes.service import SERVICE
from bt_agents_language.nodes.set import SET
from bt_agents_language.nodes.skill import SKILL
from bt_agents_language.nodes.subtree import OUTPUTS, SUBTREE, WITH
from bt_agents_language.nodes.succeed import SUCCEED
from bt_agents_language.nodes.timeout import TIMEOUT
from bt_agents_language.nodes.wait import WAIT
from bt_agents_language.nodes.wait_for import WAIT_FOR
from bt_agents_language.nodes.weight import WEIGHT, WEIGHT_KEY
from bt_agents_language.nodes.when import WHEN
from bt_agents_language.nodes.while_ import WHILE

NODE_TYPES: Mapping[str, NodeType] = {
    one.key: one
    for one in (
        SEQUENCE,
        SELECTOR,
        PARALLEL,
        CHOOSE,
        RANDOM,
        CHECK,
        SET,
        WAIT,
        WAIT_FOR,
        ACTION,
        SERVICE,
        PUBLISH,
        LOG,
        GIVE_FEEDBACK,
        SUBTREE,
    )
}
"""Composites and leaves by key, in the order of the documentation; skills and plug-ins come on
top of these."""

DECORATORS: Mapping[str, NodeType] = {
    one.key: one
    for one in (
        WHEN,
        ONCE,
        COOLDOWN,
        SUCCEED,
        FAIL,
        ON_FAILURE,
        WHILE,
        RETRY,
        REPEAT,
        TIMEOUT,
        INVERT,
    )
}
"""Decorators by key, in the order in which they wrap a node: the first one is the outermost."""

BRANCHES: Mapping[str, NodeType] = {one.key: one for one in (CASE, WEIGHT)}
"""What wraps the children of some composites, by the kind of its nodes."""

NAME = SiblingKey(
    field=NodeField(
        name="name",
        content=Content.CONSTANT,
        type=FieldType.TEXT,
        description="A name for people.",
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
"""Other keys beside a node."""

SIBLING_KEYS = (*DECORATORS, *SIBLINGS)
"""Every key that can stand beside a node."""

WORDS = frozenset((*NODE_TYPES, *SIBLING_KEYS, "children"))
"""The words of the language, which no skill and no plug-in can be called."""


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
