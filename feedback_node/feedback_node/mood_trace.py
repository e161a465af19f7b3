# SPDX-License-Identifier: Apache-2.0
"""Credit assignment: the mood of the person while each node of a tree was running."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bt_agents_core.mood import Addressee
from bt_agents_core.run_key import RunKey
from bt_agents_core.scene import MISSING, Scene, SceneSpace, mood_of

MOST_LEAVES = 1000
"""Most nodes of one run that are traced; further ones are not counted."""

MOST_VALUES = 1000
"""Most values of one run that are kept."""

MOST_CHANGES = 4096
"""Number of the last changes between nodes that are kept."""


@dataclass(frozen=True, kw_only=True)
class LeafMood:
    """Mood while one node was running, over all of its turns.

    Attributes:
        leaf: Path of the node.
        seconds: How long it ran [s].
        mean: Mean mood over the time when it was known; NaN if it never was.
        change: Sum over its turns of the last minus the first known mood; NaN if never known.
    """

    leaf: str
    seconds: float
    mean: float
    change: float


@dataclass(kw_only=True)
class _Account:
    seconds: float = 0.0
    known_s: float = 0.0
    sum: float = 0.0
    change: float = MISSING


class RunValues:
    """The last values that the nodes of the latest run have changed."""

    def __init__(self) -> None:
        self._run: RunKey | None = None
        self._values: dict[tuple[str, str], str] = {}

    def change(self, run: RunKey, path: str, name: str, value: str) -> None:
        """Handle a changed value of a node of a run."""
        if run != self._run:
            self._run, self._values = run, {}
        if (path, name) in self._values or len(self._values) < MOST_VALUES:
            self._values[path, name] = value

    def of(self, run: RunKey) -> Mapping[tuple[str, str], str]:
        """Return path and name → value of a run; empty if it is not the latest one."""
        return self._values if run == self._run else {}


class MoodTrace:
    """Accumulates the mood of a run by its active node.

    The active node is the tip of the tree: the deepest node that decides its status. A live scene
    counts until the next one or the end of the lease; as for rules, only measurements of the
    person whom the run is about count.

    Attributes:
        lease_s: How long a live scene counts after its arrival [s].
    """

    def __init__(
        self, awarded: Scene, space: SceneSpace, clock: Callable[[], float], lease_s: float
    ) -> None:
        self.lease_s = lease_s
        self._space = space
        self._clock = clock
        self._addressee = Addressee(awarded)
        self._mood = mood_of(awarded, space)
        self._known_until = clock() + lease_s
        self._entry = self._mood
        self._leaf = ""
        self._at = clock()
        self._accounts: dict[str, _Account] = {}
        self._changes: deque[tuple[float, str]] = deque(maxlen=MOST_CHANGES)

    def on_leaf(self, leaf: str) -> None:
        """Set the path of the active node."""
        if leaf == self._leaf:
            return
        self._count()
        self._leaf = leaf
        self._entry = self._mood
        self._changes.append((self._at, leaf))
        if leaf not in self._accounts and len(self._accounts) < MOST_LEAVES:
            self._accounts[leaf] = _Account()

    def receive(self, live: Scene) -> None:
        """Handle a live scene."""
        self._count()
        self._mood = mood_of(self._addressee.mask(live), self._space)
        self._known_until = self._at + self.lease_s
        if math.isnan(self._entry):
            self._entry = self._mood
        account = self._accounts.get(self._leaf)
        if account is not None and not math.isnan(self._mood):
            before = 0.0 if math.isnan(account.change) else account.change
            account.change = before + self._mood - self._entry
            self._entry = self._mood

    def leaf_at(self, moment: float) -> str:
        """Return the path of the node that was active at a moment [s]; empty if unknown."""
        index = bisect_right(self._changes, moment, key=lambda change: change[0])
        return self._changes[index - 1][1] if index else ""

    def so_far(self) -> tuple[LeafMood, ...]:
        """Return the moods of the nodes so far, in the order of their starts."""
        self._count()
        return tuple(
            LeafMood(
                leaf=leaf,
                seconds=account.seconds,
                mean=account.sum / account.known_s if account.known_s else MISSING,
                change=0.0 if account.known_s and math.isnan(account.change) else account.change,
            )
            for leaf, account in self._accounts.items()
        )

    def _count(self) -> None:
        now = self._clock()
        account = self._accounts.get(self._leaf)
        if account is not None:
            account.seconds += now - self._at
            if not math.isnan(self._mood):
                known_s = max(min(now, self._known_until) - self._at, 0.0)
                account.known_s += known_s
                account.sum += self._mood * known_s
        if now > self._known_until:
            self._mood = MISSING
        self._at = now
