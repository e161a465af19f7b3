# SPDX-License-Identifier: Apache-2.0
"""Nodes of plug-ins: what all of them have in common, whatever they are called."""

from __future__ import annotations

from bt_agents_language.nodes.node_type import NodeType

PLUGIN = NodeType(key="plugin", takes_time=True)
"""Type of every checked node of a plug-in; its fields are those of its class."""
