# SPDX-License-Identifier: Apache-2.0
"""Marketplace that, while a file exists, dies between storing an end and announcing it."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path

from marketplace_node import node
from marketplace_node.effects import AnnounceRun, SceneEnded
from marketplace_node.hosts.host_effects import Effect
from marketplace_node.outcomes import RunEventKind

DIES_WHILE = "DIES_WHILE"
"""Environment variable with the path of the file, which the market removes when it dies.

The file says what ends, ``run`` or ``scene``.
"""


class DyingMarket(node.MarketplaceNode):
    """Marketplace that kills itself instead of announcing the next end."""

    def _execute_one(self, effect: Effect) -> None:
        file = Path(os.environ[DIES_WHILE])
        if (what := _ending(effect)) and file.exists() and file.read_text() == what:
            file.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        super()._execute_one(effect)


def _ending(effect: Effect) -> str:
    match effect:
        case SceneEnded():
            return "scene"
        case AnnounceRun(event=RunEventKind.ENDED):
            return "run"
        case _:
            return ""


def main(args: Sequence[str] | None = None) -> int:
    """Run it like the real marketplace."""
    node.MarketplaceNode = DyingMarket
    return node.main(args)
