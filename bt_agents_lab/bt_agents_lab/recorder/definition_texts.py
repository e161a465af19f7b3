# SPDX-License-Identifier: Apache-2.0
"""The texts of installed message types, as their authors wrote them."""

from __future__ import annotations

import re

from bt_agents_ros.types import prefixes

_MESSAGE = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")


def definition_text(type_name: str) -> str | None:
    """Return the text of an installed message type as its author wrote it; None without one.

    Args:
        type_name: Full name, for example ``std_msgs/msg/Bool``.
    """
    if not _MESSAGE.fullmatch(type_name):
        return None
    for prefix in prefixes():
        try:
            return (prefix / "share" / f"{type_name}.msg").read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            continue
    return None
