# SPDX-License-Identifier: Apache-2.0
"""Installed ROS types, where there are any, for what is read without a running system."""

from __future__ import annotations

from dataclasses import replace

from bt_agents_language.fields.interfaces import Interfaces, OfInstalledPackages
from bt_agents_language.nodes.symbols import SymbolTable


def installed_types() -> Interfaces | None:
    """Return the installed ROS types; None without ROS, where types stay unchecked."""
    try:
        from bt_agents_ros.installed import InstalledInterfaces
    except ImportError:
        return None
    return InstalledInterfaces()


def with_installed_types(symbols: SymbolTable) -> SymbolTable:
    """Return the symbols of a rehearsal, in which messages are checked against their types.

    Types of packages that are not installed, such as those of a robot elsewhere, stay unchecked.
    """
    types = installed_types()
    return replace(symbols, interfaces=None if types is None else OfInstalledPackages(types))
