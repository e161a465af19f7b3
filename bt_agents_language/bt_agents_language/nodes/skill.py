# SPDX-License-Identifier: Apache-2.0
"""Skills: what all of them have in common, whatever they are called."""

from __future__ import annotations

from bt_agents_language.nodes.node_type import NodeType
from bt_agents_language.nodes.subtree import OUTPUTS

SKILL = NodeType(key="skill", siblings=(OUTPUTS.key,), idle=True)
"""Type of every skill; its fields are the inputs that the skill declares."""
