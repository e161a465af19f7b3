# SPDX-License-Identifier: Apache-2.0
"""Ended runs that no market has announced yet; reported at the next registration."""

from __future__ import annotations

from collections import deque

from bt_agents_interfaces.msg import Run

MOST = 10
"""Most runs; more push the oldest ones out."""

_REMEMBERED = 50


class UnreportedRuns:
    """Ended runs of a host that their market has not closed yet.

    A market has closed a run when it has announced itself that it ended, was lost or was refused.
    """

    def __init__(self) -> None:
        self._runs: dict[tuple[str, int, str], Run] = {}
        self._closed: deque[tuple[str, int, str]] = deque(maxlen=_REMEMBERED)

    def store(self, run: Run) -> None:
        """Store a run that has ended, unless its market has closed it before."""
        key = _key(run)
        if key in self._closed:
            return
        self._runs[key] = run
        if len(self._runs) > MOST:
            del self._runs[next(iter(self._runs))]

    def on_run_event(self, run: Run) -> None:
        """Remove a run that its market has closed; other events mean nothing."""
        if run.event in (Run.ENDED, Run.REFUSED):
            self._close(run)

    def of_others(self, epoch: str) -> list[Run]:
        """Return the runs of other markets than this one, the oldest first."""
        return [run for run in self._runs.values() if run.epoch != epoch]

    def acknowledge(self, runs: list[Run]) -> None:
        """Remove runs that a market has recorded."""
        for run in runs:
            self._close(run)

    def _close(self, run: Run) -> None:
        key = _key(run)
        self._runs.pop(key, None)
        self._closed.append(key)


def _key(run: Run) -> tuple[str, int, str]:
    """Return the identity of a run: one round has several when agents refuse it."""
    return run.epoch, run.round, run.agent
