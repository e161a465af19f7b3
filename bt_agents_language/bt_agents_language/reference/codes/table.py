# SPDX-License-Identifier: Apache-2.0
"""The table of all codes, for readers, tests, the terminal and the page that documents them."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_language.reference.codes.entry import Code
from bt_agents_language.reference.codes.of_dangers import DANGER_CODES
from bt_agents_language.reference.codes.of_text import TEXT_CODES
from bt_agents_language.reference.codes.of_trees import TREE_CODES
from bt_agents_language.reference.codes.of_values import VALUE_CODES
from bt_agents_language.reference.codes.of_xml import XML_CODES

GROUPS: Mapping[str, tuple[Code, ...]] = {
    "Files and YAML": TEXT_CODES,
    "Keys, values and names": VALUE_CODES,
    "Trees, skills and references between files": TREE_CODES,
    "Warnings": DANGER_CODES,
    "Import from Groot2": XML_CODES,
}
"""Heading → its codes."""

CODES: Mapping[str, Code] = {entry.code: entry for codes in GROUPS.values() for entry in codes}
"""Every code that a problem can have."""
