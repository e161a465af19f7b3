# SPDX-License-Identifier: Apache-2.0
"""A marketplace that dies between storing an end and announcing it while some file exists."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path

from marketplace_node import node
from marketplace_node.effects import Effect, SceneEnded

DIES_WHILE = "DIES_WHILE"
"""Environment variable with the file, which the market removes when it dies."""


class DyingMarket(node.MarketplaceNode):
    """Marketplace that kills itself in place of its next announcement of an end."""

    def _execute_one(self, effect: Effect) -> None:
        if isinstance(effect, SceneEnded):
            file = Path(os.environ[DIES_WHILE])
            if file.exists():
                file.unlink()
                os.kill(os.getpid(), signal.SIGKILL)
        super()._execute_one(effect)


def main(args: Sequence[str] | None = None) -> int:
    """Run it as the marketplace is run."""
    node.MarketplaceNode = DyingMarket
    return node.main(args)
