# SPDX-License-Identifier: Apache-2.0
"""Pre-checks before parsing: size, control characters, foreign formats, merge conflicts."""

from __future__ import annotations

import re

from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.source import MAX_BYTES, TOO_LARGE, Source

# Also what breaks lines in some programs only (U+0085, U+2028, U+2029), hides (U+FEFF, tags from
# U+E0000 on) or turns the reading direction: no script needs it, and nobody would see it.
BAD_CHARACTER = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufeff\ufffe\uffff"
    "\u2028\u2029\u202a-\u202e\u2066-\u2069\U000e0000-\U000e007f]"
)
"""Invisible characters that files must not contain."""

UNDECIDED = (
    "two versions of the file were merged, and this place is not decided yet",
    "keep one of the two versions, and delete the lines <<<<<<<, ======= and >>>>>>>",
)
"""Message and hint about two versions of a file in a git merge conflict."""

_PAGE = ("a web page", "save the file itself, not the page that shows it")
_SIGNS = {
    "{\\rtf": ("rich text", "save it as plain text (in the editor: Make plain text)"),
    "<root btcpp_format": (
        "a tree of BehaviorTree.CPP",
        "turn it into an agent file: bt-agents import groot FILE",
    ),
    "<!doctype": _PAGE,
    "<html": _PAGE,
    "<?xml": ("XML", "write YAML: lines with 'key: value'"),
}
"""Start of a file → its format, and what to do."""


def looks_like_yaml(source: Source, problems: Diagnostics) -> bool:
    """Return whether a text can be YAML at all; if not, report why."""
    bad = BAD_CHARACTER.search(source.text)
    foreign = _foreign_format(source.text)
    conflict = _merge_conflict(source.text)
    if len(source.text.encode("utf-8", "replace")) > MAX_BYTES:
        problems.add("too-large", source.position(0), *TOO_LARGE)
    elif bad is not None:
        problems.add(
            "bad-character",
            source.position(bad.start()),
            f"an invisible character (U+{ord(bad[0]):04X}) stands here",
            "delete it; it may have come in by copying from another program",
        )
    elif foreign is not None:
        what, hint = foreign
        problems.add("syntax", source.position(0), f"this is {what}, not YAML", hint)
    elif conflict is not None:
        problems.add("syntax", source.position(conflict), *UNDECIDED)
    else:
        return True
    return False


def _foreign_format(text: str) -> tuple[str, str] | None:
    start = text[:400].lstrip().lower()
    tree = start.find("<root btcpp_format")
    if start.startswith("<?xml") and tree > 0:
        start = start[tree:]
    return next((found for sign, found in _SIGNS.items() if start.startswith(sign)), None)


def _merge_conflict(text: str) -> int | None:
    """Return the start of a git merge conflict with two versions of the file."""
    lines = f"\n{text}"
    start = lines.find("\n<<<<<<< ")
    middle = lines.find("\n=======", start) if start >= 0 else -1
    end = lines.find("\n>>>>>>> ", middle) if middle >= 0 else -1
    return start if end >= 0 else None
