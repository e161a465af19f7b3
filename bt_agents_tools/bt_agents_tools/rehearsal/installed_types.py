# SPDX-License-Identifier: Apache-2.0
"""Installed ROS types, if any, for files that are read without a running system."""

from __future__ import annotations

from dataclasses import replace

from bt_agents_language.fields.interfaces import Interfaces, OfInstalledPackages
from bt_agents_language.nodes.symbols import SymbolTable


def installed_types() -> Interfaces | None:
    """Return the installed ROS types; None without ROS, which leaves types unchecked."""
    try:
        from bt_agents_ros.installed import InstalledInterfaces
    except ImportError:
        return None
    return InstalledInterfaces()


def with_installed_types(symbols: SymbolTable) -> SymbolTable:
    """Return symbols for a rehearsal that checks messages against their types.

    Types of packages that are not installed, such as types of a robot elsewhere, stay unchecked.
    """
    types = installed_types()
    return replace(symbols, interfaces=None if types is None else OfInstalledPackages(types))
