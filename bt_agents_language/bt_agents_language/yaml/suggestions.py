# SPDX-License-Identifier: Apache-2.0
"""Suggestions for keys, names and files that do not fit."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping

from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar

_SKILLS = ("a skills file", "put it under skills/ or libraries/")
_FILES = {
    "agent": ("an agent file", "put it under agents/"),
    "skills": _SKILLS,
    "bindings": _SKILLS,
    "parameters": ("a scene.yaml", "name another file"),
    "visits": ("a script", "put it under scripts/"),
    "cases": ("a test file", "let its name end with .test.yaml"),
    "rules": ("a market.yaml", "put it beside scene.yaml"),
    "rounds": ("an experiment", "name another file"),
}
"""Key that only one kind of file has → that kind, and where it belongs."""

_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def other_file(root: Node, known: Collection[str]) -> tuple[MappingEntry, str, str] | None:
    """Return the key that shows that a file is of another kind, that kind, and a hint; or None."""
    if not isinstance(root, MappingNode) or any(e.key.text in known for e in root.entries):
        return None
    for entry in root.entries:
        if entry.key.text in _FILES:
            return entry, *_FILES[entry.key.text]
    return None


def name_meant(text: str) -> str:
    """Return a text as an identifier would be written: ``SetLight`` → ``set_light``."""
    plain = unicodedata.normalize("NFKD", _HUMP.sub("_", text.strip()))
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    return re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")


def without_value(entry: MappingEntry) -> bool:
    """Return whether nothing at all is written behind a key."""
    start, end = entry.value.span
    return isinstance(entry.value, Scalar) and entry.value.plain and start == end


def left_empty(node: MappingNode, entry: MappingEntry, known: Mapping[str, Node]) -> str | None:
    """Return the known key right above an entry when nothing is written behind it."""
    place = node.entries.index(entry)
    above = node.entries[place - 1] if place else None
    if above is None or above.key.text not in known or not without_value(above):
        return None
    return above.key.text
