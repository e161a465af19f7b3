# SPDX-License-Identifier: Apache-2.0
"""Report about the processes of a supervisor, as the health of parts for ``/diagnostics``."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bt_agents_core.health import Health, PartHealth
from bt_agents_core.text import ellipsize
from bt_agents_tools.launcher.supervisor import ProcessState, SupervisedProcess

UP_ON = "up on "
"""First part of the prefix of the parts' names; the name of the machine follows."""

PARAMETERS = "parameters"
"""Name of the part with the parameters that no node has."""

PERIOD_S = 1.0
"""Time between two looks at processor time, memory and logs [s]."""

_LEVELS = {
    ProcessState.UP: Health.OK,
    ProcessState.STARTING: Health.WARN,
    ProcessState.INACTIVE: Health.WARN,
    ProcessState.ENDED: Health.ERROR,
}
_LONGEST_LINE = 200
_STAMP = re.compile(r"(?<=\] )\[[\d.]+\] \[[^\]]*\]: ")
"""Time and logger's name in a line of a ROS log."""

_TICKS = os.sysconf("SC_CLK_TCK")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_UTIME, _STIME, _RSS = 11, 12, 21
"""Fields of ``/proc/PID/stat`` after the name, as in :manpage:`proc(5)`."""


@dataclass(frozen=True, kw_only=True)
class Usage:
    """Resources of a process.

    Attributes:
        cpu_s: Processor time since its start [s].
        memory_bytes: Resident memory, including what it shares with others.
    """

    cpu_s: float
    memory_bytes: int


def read_usage(pid: int) -> Usage | None:
    """Return what a process uses; None if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        ticks = int(fields[_UTIME]) + int(fields[_STIME])
        return Usage(cpu_s=ticks / _TICKS, memory_bytes=int(fields[_RSS]) * _PAGE_BYTES)
    except (OSError, ValueError, IndexError):
        return None


class ProcessReport:
    """Report about supervised processes.

    A change of a state is in the next report; processor time, memory and the end of the log are
    read at most once in :data:`PERIOD_S`.

    Args:
        processes: Returns the current processes.
        unknown_parameters: Returns sentences about parameters that no node has, by name.
        clock: Steady time, the same as the supervisor's [s].
        wall_clock: Time of day [s since 1970].
        usage: Returns what the process with an id uses.
    """

    def __init__(
        self,
        processes: Callable[[], Sequence[SupervisedProcess]],
        unknown_parameters: Callable[[], Mapping[str, str]] = dict,
        *,
        clock: Callable[[], float] = time.monotonic,
        wall_clock: Callable[[], float] = time.time,
        usage: Callable[[int], Usage | None] = read_usage,
    ) -> None:
        self._processes = processes
        self._unknown_parameters = unknown_parameters
        self._clock = clock
        self._wall_clock = wall_clock
        self._usage = usage
        self._looked_at = float("-inf")
        # Name → since when its state holds: on the steady clock, and for people.
        self._since: dict[str, tuple[float, str]] = {}
        # Name → process and its processor time at the last look.
        self._spent: dict[str, tuple[int, float]] = {}
        self._measured: dict[str, dict[str, str]] = {}

    def parts(self) -> tuple[PartHealth, ...]:
        """Return one part for each process, and one for unknown parameters, if any."""
        processes = self._processes()
        now = self._clock()
        if now - self._looked_at >= PERIOD_S:
            spent_s = now - self._looked_at
            self._looked_at = now
            self._measured = {one.name: self._look(one, spent_s) for one in processes}
        parts = [self._part(one) for one in processes]
        if unknown := self._unknown_parameters():
            text = "the parameter file has parameters that no node has"
            parts.append(
                PartHealth(part=PARAMETERS, level=Health.WARN, message=text, values=unknown)
            )
        return tuple(parts)

    def _part(self, one: SupervisedProcess) -> PartHealth:
        if self._since.get(one.name, (None,))[0] != one.since:
            began_s = self._wall_clock() - (self._clock() - one.since)
            moment = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(began_s))
            self._since[one.name] = (one.since, moment)
        is_there = one.state is not ProcessState.ENDED
        return PartHealth(
            part=one.name,
            level=_LEVELS[one.state],
            message=one.state,
            values={
                "pid": str(one.pid) if is_there else "",
                "since": self._since[one.name][1],
                "restarts": str(one.restarts),
                "last exit": one.last_exit,
                **self._measured.get(one.name, {}),
            },
        )

    def _look(self, one: SupervisedProcess, spent_s: float) -> dict[str, str]:
        usage = self._usage(one.pid) if one.state is not ProcessState.ENDED else None
        line = ellipsize(_STAMP.sub("", one.log.last_line(), 1), _LONGEST_LINE)
        if usage is None:
            self._spent.pop(one.name, None)
            return {"cpu": "", "memory": "", "log": line}
        pid, before_s = self._spent.get(one.name, (0, 0.0))
        self._spent[one.name] = (one.pid, usage.cpu_s)
        share = (usage.cpu_s - before_s) / spent_s if pid == one.pid else None
        return {
            "cpu": f"{100 * share:.0f} %" if share is not None else "",
            "memory": f"{usage.memory_bytes / 1e6:.0f} MB",
            "log": line,
        }
