# SPDX-License-Identifier: Apache-2.0
"""Full definitions of message types with all types that they use, for readers of a journal."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache

from bt_agents_core.errors import Refused

_RULE = "=" * 80
_FIELD = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_/]*)(?:\[[^\]]*\])?\s+[A-Za-z_]")
_PRIMITIVE = re.compile(r"(?:bool|byte|char|w?string|(?:u?int(?:8|16|32|64))|float(?:32|64))\b")
_LONGEST = 1_000_000

Lookup = Callable[[str], str | None]
"""Returns the text of a type by its full name; None when there is none."""


def definition(type_name: str, lookup: Lookup) -> str:
    """Return the text of a type, followed by those of the types in it.

    They are separated as rosbag2 and Foxglove expect it: a line of 80 ``=``, ``MSG: pkg/Name``.

    Raises:
        Refused: ``NO_DEFINITION``.
    """
    known = cache(lookup)
    parts: list[str] = []
    seen = [type_name]
    # It grows while it is walked through.
    for name in seen:
        text = known(name)
        if text is None or len(text) > _LONGEST:
            raise Refused(
                "NO_DEFINITION",
                f"there is no definition of {name}, which {type_name} needs; is its package "
                "installed with its msg files?",
            )
        package, _, short = name.split("/")
        parts.append(f"{_RULE}\nMSG: {package}/{short}\n{text}" if parts else text)
        seen += [used for used in _used(text, package) if used not in seen]
    return "\n".join(part.rstrip("\n") for part in parts) + "\n"


def _used(text: str, package: str) -> list[str]:
    """Return the full names of the types of the fields of a text."""
    found: dict[str, None] = {}
    for line in text.splitlines():
        match = _FIELD.match(line.partition("#")[0])
        if match is None or _PRIMITIVE.match(match[1]):
            continue
        parts = match[1].split("/")
        home = package if len(parts) == 1 else parts[0]
        found[f"{home}/msg/{parts[-1]}"] = None
    return list(found)
