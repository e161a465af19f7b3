# SPDX-License-Identifier: Apache-2.0
"""The exceptions of the project under one root, so that a caller can catch what it means to."""

from __future__ import annotations

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.text import ellipsize


class BtAgentsError(Exception):
    """Root of every error that this project raises on purpose."""


class NodeMustEnd(BtAgentsError):
    """Reason for which a node ends by itself; a callback that raises it is not survived."""


STORAGE_FULL = "STORAGE_FULL"
"""Code of a refusal because the disk takes no more; the same is taken when there is room."""

LONGEST_REASON = 500
"""Characters of a reason; what comes from outside may be as long as it likes."""


class Refused(BtAgentsError):
    """Input that is not taken; nothing has changed.

    Attributes:
        code: Stable name of the reason in upper case, for example ``NOT_FINITE``.
        reason: The same in words: what was found, what was expected, how to mend it.
    """

    def __init__(self, code: str, reason: str) -> None:
        reason = ellipsize(reason, LONGEST_REASON)
        super().__init__(f"{code}: {reason}")
        self.code = code
        self.reason = reason


class ReadError(BtAgentsError):
    """A file that could not be read as a whole; carries every problem found in it.

    Attributes:
        report: All problems as text, one block each, ready for a terminal.
        lines: One line a problem: ``file:line:col: error[code]: message``.
        diagnostics: The problems themselves, for other ways of showing them.
    """

    def __init__(
        self, report: str, lines: tuple[str, ...], diagnostics: tuple[Diagnostic, ...]
    ) -> None:
        super().__init__(report)
        self.diagnostics = diagnostics
        self.report = report
        self.lines = lines
