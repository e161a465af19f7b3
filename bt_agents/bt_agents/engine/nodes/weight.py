# SPDX-License-Identifier: Apache-2.0
"""Weight: a child of ``random`` with the weight of its draw."""

from __future__ import annotations

from bt_agents.engine.decorator import Decorator


class Weight(Decorator):
    """Passes on the status of its child."""

    def weight(self) -> float:
        """Return how often it is drawn, compared with the others; may raise."""
        return self.fields.number("weight")


BEHAVIOURS = {"weight": Weight}
