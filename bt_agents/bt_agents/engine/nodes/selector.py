# SPDX-License-Identifier: Apache-2.0
"""Selector: ticks its children in order until one succeeds."""

from __future__ import annotations

from itertools import islice

from py_trees import composites
from py_trees.common import Status

from bt_agents.engine.bases import InOrder
from bt_agents.engine.light_behaviour import FAILURE, INVALID, RUNNING
from bt_agents.engine.ticker import Ticker


class LightSelector(InOrder, composites.Selector):
    """Ticks its children in order; the first that does not fail decides.

    S, F and R are the answers of the children a, b and c; I is INVALID; brackets: not ticked.

    ==== ================== ================= ==================== =================
    tick with memory: a b c status            without memory: a b c status
    ==== ================== ================= ==================== =================
    1    F R (I)            RUNNING           F R (I)              RUNNING
    2    (I) F R            RUNNING           F F R                RUNNING
    3    (I I) R            RUNNING           F R (I), c stopped   RUNNING
    4    (I I) S            SUCCESS           S (I I), b stopped   SUCCESS
    5    F F F              FAILURE           F F F                FAILURE
    ==== ================== ================= ==================== =================

    With memory, the children before the one that ran become INVALID. A start does not touch the
    children: those after the deciding child are stopped and become INVALID only if the deciding
    child differs from the last one.
    """

    def tick_children(self, ticker: Ticker) -> Status:
        ticks, children = ticker.ticks, self.children
        # Start at the first child.
        starts = self.status is not RUNNING
        if starts:
            self.current_child = children[0]
        last = self.current_child
        rest = iter(children)
        # With memory: skip the children before the one that ran.
        if self.memory and last is not children[0]:
            for child in islice(rest, children.index(last)):
                if child.status is not INVALID:
                    ticker.reset_child(child)
        for child in rest:
            status = ticks[child]()
            if status is not FAILURE:
                break
        self.current_child = child
        # Stop the children after one that has interrupted another.
        if status is not FAILURE:
            if child is not last:
                for child in rest:
                    ticker.reset_child(child)
            elif starts:
                ticker.pending.extend(rest)
        return status


BEHAVIOURS = {"selector": LightSelector}
