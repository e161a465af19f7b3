# SPDX-License-Identifier: Apache-2.0
"""Set: gives names values."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.leaf import Leaf
from bt_agents.engine.light_behaviour import SUCCESS


class Set(Leaf):
    """Gives names values, one after the other; always SUCCESS."""

    def step(self) -> Status:
        for name in self.spec.fields:
            self.scope.write(name, self.fields.value(name))
        return SUCCESS


BEHAVIOURS = {"set": Set}
