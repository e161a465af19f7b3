# SPDX-License-Identifier: Apache-2.0
"""Common properties of all nodes of plug-ins."""

from __future__ import annotations

from bt_agents_language.nodes.node_type import NodeType

PLUGIN = NodeType(key="plugin", takes_time=True)
"""Type of every checked node of a plug-in; its class defines the fields."""
