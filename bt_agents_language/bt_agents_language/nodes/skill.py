# SPDX-License-Identifier: Apache-2.0
"""Common properties of all skills."""

from __future__ import annotations

from bt_agents_language.fields.values import ONE_OF
from bt_agents_language.model.specs import SkillSpec
from bt_agents_language.nodes.node_type import NodeType
from bt_agents_language.nodes.subtree import OUTPUTS

SKILL = NodeType(key="skill", siblings=(OUTPUTS.key,), idle=True)
"""Type of every skill; its fields are the inputs that the skill declares."""


def takes_variants(skill: SkillSpec) -> bool:
    """Return whether its main input may have several texts."""
    return skill.main_is_text and ONE_OF not in skill.input_names
