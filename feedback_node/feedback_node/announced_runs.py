# SPDX-License-Identifier: Apache-2.0
"""Current and last runs, which unnamed feedback refers to."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from bt_agents_core.run_key import RunKey
from bt_agents_core.scene import Origin, Scene

_REMEMBERED_ENDS = 256
_REMEMBERED_AGENTS = 1_000


@dataclass(frozen=True, kw_only=True)
class AnnouncedRun:
    """One run of one agent, with the scene as awarded and what the person has said since."""

    epoch: str
    round: int
    agent: str
    scene: Scene

    @property
    def key(self) -> RunKey:
        """Identity of the run."""
        return RunKey.of(self)


class AnnouncedRuns:
    """Runs announced by their events; at most one is current.

    Events may be replayed from the history of their topic, so the start of a run may arrive after
    its end.
    """

    def __init__(self) -> None:
        self.current: AnnouncedRun | None = None
        self._last: AnnouncedRun | None = None
        self._of_agent: dict[str, AnnouncedRun] = {}
        self._ended: deque[RunKey] = deque(maxlen=_REMEMBERED_ENDS)
        self._collected: deque[RunKey] = deque(maxlen=_REMEMBERED_ENDS)
        self._uncollected: RunKey | None = None

    def started(self, run: AnnouncedRun) -> bool:
        """Handle a start; return True if this run has just become the current one."""
        if run.key in self._ended or (self.current is not None and self.current.key == run.key):
            return False
        self.current = run
        self._remember(run)
        return True

    def ended(self, run: AnnouncedRun) -> bool:
        """Handle an end; return True if it was the current run."""
        is_new = run.key not in self._ended
        if is_new:
            self._ended.append(run.key)
        if self.current is not None and self.current.key == run.key:
            self.current = None
            return True
        if is_new and self.current is None:
            self._remember(run)
        return False

    @property
    def collecting(self) -> bool:
        """True until the market has asked for feedback on the current or last run."""
        return self.current is not None or self._uncollected is not None

    def expect(self, run: AnnouncedRun) -> None:
        """Expect the market to ask for feedback on a run, unless it has already done so."""
        self._uncollected = None if run.key in self._collected else run.key

    def collected(self, run: AnnouncedRun) -> None:
        """Record that the market has asked for feedback on a run."""
        self._collected.append(run.key)
        if self._uncollected == run.key:
            self._uncollected = None

    def told(self, live: Scene) -> None:
        """Record what the person has said in the current run, from its live scene."""
        run = self.current
        told = {value.name: value for value in live.values if value.origin is Origin.TOLD}
        if run is None or not told:
            return
        values = tuple(told.get(value.name, value) for value in run.scene.values)
        if values != run.scene.values:
            self.current = replace(run, scene=replace(run.scene, values=values))
            self._remember(self.current)

    def last(self, agent: str = "") -> AnnouncedRun | None:
        """Return the current or last run, of ``agent`` if given; None without one."""
        return self._of_agent.get(agent) if agent else self._last

    def _remember(self, run: AnnouncedRun) -> None:
        self._last = run
        self._of_agent.pop(run.agent, None)
        self._of_agent[run.agent] = run
        if len(self._of_agent) > _REMEMBERED_AGENTS:
            del self._of_agent[next(iter(self._of_agent))]
