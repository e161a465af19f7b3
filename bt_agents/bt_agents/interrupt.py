# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM as a flag that loops look at, so that everything ends in order."""

from __future__ import annotations

import signal
from types import FrameType


class Interrupt:
    """Becomes true when the user or the system wants the program to end."""

    def __init__(self) -> None:
        self._asked = False
        signal.signal(signal.SIGINT, self._ask)
        signal.signal(signal.SIGTERM, self._ask)

    def _ask(self, _signal: int, _frame: FrameType | None) -> None:
        self._asked = True

    def __bool__(self) -> bool:
        return self._asked
