# SPDX-License-Identifier: Apache-2.0
"""Stalls of the machine: as a program, prints when each began and how long it took [s].

A hypervisor may take memory or processor time from a virtual machine without the kernel of the
machine noticing. Every program is then several times slower for a few hundredths of a second, on
all cores: a loop of half a millisecond takes up to 18 ms of CPU time, and the machine reports no
lost time. The loop of this program is judged by its CPU time, so a core that is busy with other
programs is not a stall.
"""

from __future__ import annotations

import time

from processes import Running

_LOOPS = 9000
_FASTEST_OF = 200
_SLOW = 2.5
"""Number of times that a loop takes longer than the fastest one in a stall."""

_PAUSE_S = 0.004
_MARGIN_S = 0.01
"""Time before and after a slow loop that also counts, because of the pauses [s]."""


class Stalls:
    """The stalls that a program of this module has seen.

    Args:
        program: The running program.
    """

    def __init__(self, program: Running) -> None:
        self._program = program

    def outside(self, spans: list[tuple[float, float]]) -> list[float]:
        """Return the lengths of the spans that no stall has touched.

        Args:
            spans: Begin [s since 1970] and length [s].
        """
        stalls = [tuple(map(float, line.split())) for line in self._program.said.splitlines()]
        return [
            took
            for began, took in spans
            if not any(
                stall - _MARGIN_S < began + took and began < stall + stalled + _MARGIN_S
                for stall, stalled in stalls
            )
        ]


def main() -> None:
    """Print each stall until the end of the process."""
    fastest = min(_loop_s() for _ in range(_FASTEST_OF))
    while True:
        began = time.time()
        if _loop_s() > _SLOW * fastest:
            print(f"{began:.4f} {time.time() - began:.4f}", flush=True)
        time.sleep(_PAUSE_S)


def _loop_s() -> float:
    """Return the CPU time of one loop [s]."""
    began = time.thread_time()
    total = 0
    for number in range(_LOOPS):
        total += number * number
    return time.thread_time() - began


if __name__ == "__main__":
    main()
