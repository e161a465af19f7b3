# SPDX-License-Identifier: Apache-2.0
"""Sequence: ticks its children in order until one fails."""

from __future__ import annotations

from itertools import islice

from py_trees import composites
from py_trees.common import Status

from bt_agents.engine.bases import InOrder
from bt_agents.engine.light_behaviour import INVALID, RUNNING, SUCCESS
from bt_agents.engine.ticker import Ticker


class LightSequence(InOrder, composites.Sequence):
    """Ticks its children in order; the first that does not succeed decides.

    S, F and R are the answers of the children a, b and c; I is INVALID; brackets: not ticked.

    ==== ================== ================= ==================== =================
    tick with memory: a b c status            without memory: a b c status
    ==== ================== ================= ==================== =================
    1    S R (I)            RUNNING           S R (I)              RUNNING
    2    (S) S R            RUNNING           S S R                RUNNING
    3    (S S) R            RUNNING           S R (I), c stopped   RUNNING
    4    (S S) S            SUCCESS           F (I I), b stopped   FAILURE
    5    S F (I)            FAILURE           S S S                SUCCESS
    ==== ================== ================= ==================== =================

    A start (a tick while it is not RUNNING) first makes all children INVALID. Without memory, each
    tick begins at the first child, and the children after the deciding one are stopped.
    """

    def tick_children(self, ticker: Ticker) -> Status:
        ticks, children = ticker.ticks, self.children
        starts = self.status is not RUNNING
        if starts:
            # Forget how the children ended.
            for child in children:
                if child.status is not INVALID:
                    child.stop(INVALID)
            rest = iter(children)
        elif self.memory:
            # Continue with the child that ran.
            status = ticks[self.current_child]()
            if status is not SUCCESS:
                return status
            rest = islice(children, children.index(self.current_child) + 1, None)
        else:
            rest = iter(children)
        # Tick the others until one does not succeed.
        status = SUCCESS
        for child in rest:
            self.current_child = child
            status = ticks[child]()
            if status is not SUCCESS:
                break
        # Stop the children after it; with memory they have not run since the start.
        if status is not SUCCESS and (starts or not self.memory):
            for child in rest:
                if starts or child.status is not INVALID:
                    ticker.reset_child(child)
        return status


BEHAVIOURS = {"sequence": LightSequence}
