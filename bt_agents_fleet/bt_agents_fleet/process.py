# SPDX-License-Identifier: Apache-2.0
"""Fleet process of a system, with the arguments TREES STATE LEDGER PIPE."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import printable
from bt_agents_fleet.fleet_run import keep_up
from bt_agents_ros.signals import Interrupt
from bt_agents_ros.spinner import die_with_parent, report_ready


def main() -> int:
    """Keep the robot up to date until a signal ends it; return the exit code."""
    interrupt = Interrupt()
    die_with_parent()
    trees, state, ledger = map(Path, sys.argv[1:4])
    # Its lines are for the terminal of the parent, which may have stopped reading them.
    pipe = int(sys.argv[4])
    os.set_blocking(pipe, False)

    def say(line: str) -> None:
        print(line, flush=True)
        with suppress(OSError):
            os.write(pipe, f"{line}\n".encode())

    report_ready()
    try:
        keep_up(trees, state, ledger, say, interrupt)
    except BtAgentsError as error:
        print(f"error: {printable(str(error))}", file=sys.stderr)
        return 1
    return 0
