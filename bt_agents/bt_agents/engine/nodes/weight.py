# SPDX-License-Identifier: Apache-2.0
"""Weight: a child of ``random`` with its weight."""

from __future__ import annotations

from bt_agents.engine.bases import Decorator


class Weight(Decorator):
    """Passes on the status of its child."""


BEHAVIOURS = {"weight": Weight}
