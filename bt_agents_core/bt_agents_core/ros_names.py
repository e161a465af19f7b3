# SPDX-License-Identifier: Apache-2.0
"""Fully qualified names of ROS nodes, topics, services and actions, and their types."""

from __future__ import annotations

import re
from collections.abc import Collection

from bt_agents_core.text import join_first

LONGEST_NAME = 180
"""Longest fully qualified name in characters."""

_NAME = re.compile(r"(/(?!\w*__)[A-Za-z_][A-Za-z0-9_]*)+", re.ASCII)


def is_full_name(name: str) -> bool:
    """Return whether this is a valid full name, such as ``/library/agents``."""
    return len(name) <= LONGEST_NAME and _NAME.fullmatch(name) is not None


def other_types(expected: str, shown: Collection[str]) -> str:
    """Return the types on the graph and the expected one; empty if that is among them, or none."""
    if not shown or expected in shown:
        return ""
    return f"{join_first(sorted(shown))}, expected {expected}"
