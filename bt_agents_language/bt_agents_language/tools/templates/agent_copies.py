# SPDX-License-Identifier: Apache-2.0
"""Agents to start from: the shipped patterns, and copies of any agent under another name."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.diagnostics.collection import did_you_mean

_TEST = ".test.yaml"
_FOLDER = Path(str(files("bt_agents_language"))) / "tools" / "templates" / "patterns"


def pattern_names() -> tuple[str, ...]:
    """Return the names of all patterns."""
    return tuple(sorted(file.name.removesuffix(_TEST) for file in _FOLDER.glob(f"*{_TEST}")))


def pattern_file(name: str) -> Path:
    """Return the agent file of a pattern; its test is next to it.

    Raises:
        BtAgentsError: There is no such pattern.
    """
    known = pattern_names()
    if name not in known:
        hint = did_you_mean(name, known) or f"there are {', '.join(known)}"
        raise BtAgentsError(f"there is no pattern '{name[:100]}'; {hint}")
    return _FOLDER / f"{name}.yaml"


def tests_beside(agent: Path) -> Path:
    """Return the path of the tests next to an agent file."""
    return agent.with_name(f"{agent.stem}{_TEST}")


def renamed(text: str, before: str, after: str) -> str:
    """Return the text of an agent file or of its tests for an agent of another name."""
    text = re.sub(
        rf"^((?:agent|test): *){before}\b(?!\.)", rf"\g<1>{after}", text, flags=re.MULTILINE
    )
    # Comments and tests also name the file.
    return re.sub(rf"\bagents/{before}(?=\.(?:test\.)?yaml\b)", f"agents/{after}", text)
