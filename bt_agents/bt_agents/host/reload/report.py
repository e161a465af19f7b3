# SPDX-License-Identifier: Apache-2.0
"""What a look at the files of a host comes to, in words."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_language.diagnostics.renderers import as_hinted_lines
from bt_agents_language.files.folder_reader import Trees


def problems_of(trees: Trees) -> list[str]:
    """Return what somebody has to mend in a folder, one line each."""
    broken = (one.error.diagnostics for one in trees.broken)
    return [*(line for found in broken for line in as_hinted_lines(found)), *trees.problems]


def report(changed: Sequence[str], waits: str, problems: Sequence[str]) -> list[str]:
    """Return the lines of an answer: what has changed, what waits, what is broken.

    Args:
        changed: What this look has changed, one entry an agent.
        waits: What waits for the end of the run; empty for nothing, or when it is dealt with.
        problems: What somebody has to mend.
    """
    lines = list(changed)
    if waits:
        lines.append(f"{waits} for the end of the run; 'bt-agents reload --now' cancels it")
    said = "\n".join(lines)
    lines += [problem for problem in problems if problem not in said]
    return lines or ["nothing has changed"]
