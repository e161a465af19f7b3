# SPDX-License-Identifier: Apache-2.0
"""The exceptions of the project, under one root."""

from __future__ import annotations

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize


class BtAgentsError(Exception):
    """Root of every error that this project raises on purpose."""


class NodeMustEnd(BtAgentsError):
    """Reason for a node to end; unlike other exceptions of a callback, it ends the process.

    Attributes:
        exit_code: Of the process; ``os.EX_CONFIG`` if the node must not run here.
    """

    def __init__(self, reason: str, exit_code: int = 1) -> None:
        super().__init__(reason)
        self.exit_code = exit_code


LONGEST_REASON = 500
"""Longest reason in characters; texts from outside may have any length."""


class Refusal(BtAgentsError):
    """Refusal with a code.

    Attributes:
        code: Kind of the refusal, for programs.
        reason: The same in words: what was found, what was expected, how to fix it.
    """

    def __init__(self, code: str, reason: str) -> None:
        self.code = code
        self.reason = ellipsize(reason, LONGEST_REASON)
        super().__init__(f"{code}: {self.reason}")


class Refused(Refusal):
    """Refusal of an input; nothing has changed."""

    code: RefusalCode

    def __init__(self, code: RefusalCode, reason: str) -> None:
        super().__init__(code, reason)


class RefusedElsewhere(Refusal):
    """Refusal by another process, passed on as received; its version may have other codes."""


class ReadError(BtAgentsError):
    """A file that could not be read completely, with every problem found in it.

    Attributes:
        report: All problems as text, one block each, ready for a terminal.
        lines: One line per problem: ``file:line:col: error[code]: message``.
        diagnostics: The problems as data, for other renderings.
    """

    def __init__(
        self, report: str, lines: tuple[str, ...], diagnostics: tuple[Diagnostic, ...]
    ) -> None:
        super().__init__(report)
        self.diagnostics = diagnostics
        self.report = report
        self.lines = lines
