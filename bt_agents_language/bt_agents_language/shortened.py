# SPDX-License-Identifier: Apache-2.0
"""How much of a found text a message shows."""

from __future__ import annotations

LONGEST = 40
"""Characters of a found text that a message shows."""


def shortened(text: str, longest: int = LONGEST) -> str:
    """Return a text, or its start and "…" when it has more than so many characters."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"
