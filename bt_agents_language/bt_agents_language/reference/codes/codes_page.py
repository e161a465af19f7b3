# SPDX-License-Identifier: Apache-2.0
"""Markdown page of all codes."""

from __future__ import annotations

from bt_agents_language.reference.codes.table import Code, code_groups

_TOP = """\
# Errors and warnings

Made by `scripts/generate` from the table that the tests use; `bt-agents explain CODE` shows the
same in the terminal.

`bt-agents check` prints each problem as `file:line:column: error[code]: what was found and what is
expected`, with the line it is about and a hint. A file with an error is not used; an agent whose
file had no errors before keeps running as it was. A warning is about something that works, but
rarely as it was meant. Errors make the exit code 1, warnings do so with `--strict`.

With `--format json` it prints one object: `version` (1), `agents` (names of those without errors),
`files` (how many were checked), `unchecked` (files that need a scene or skills that are broken),
`errors`, `warnings` and `problems`, a list of `code`, `severity` (`error` or `warning`), `file`,
`line`, `column`, `end_line`, `end_column`, `message` and `hint` (may be empty). Lines and columns
count from 1, the end is the character behind the last one. With `--format github` each problem is
an annotation of a workflow.

Each example is the smallest file with the problem, and the same file without it. Examples of agent
and test files leave out what does not matter. `⟨…⟩` stands for what cannot be shown.
"""


def codes_page() -> str:
    """Return the page."""
    parts = [_TOP]
    for heading, codes in code_groups().items():
        parts.append(f"## {heading}")
        parts += [_section(code) for code in codes]
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


def _section(code: Code) -> str:
    language = code.kind.language
    return "\n\n".join(
        [
            f"### {code.code}",
            f"{code.meaning} Shown as {code.kind.value}:",
            f"~~~{language}\n{code.wrong}~~~",
            "Right:",
            f"~~~{language}\n{code.right}~~~",
        ]
    )
