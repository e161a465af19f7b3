# SPDX-License-Identifier: Apache-2.0
"""Entry point of every node's process: ``python -m bt_agents_ros.node_main MODULE …``."""

from __future__ import annotations

import gc
import importlib
import sys

from bt_agents_core.gc_pause import gc_paused
from bt_agents_ros.signals import end_silently

NO_LOG_FILE = ("--ros-args", "--disable-external-lib-logs")
"""Arguments of a process that leaves no log file in ``~/.ros/log``, and needs no such folder."""

SUPERVISED = "BT_AGENTS_SUPERVISED"
"""Environment variable with the pid of the parent; a node's process ends with it."""

RESTARTED = "BT_AGENTS_RESTARTED"
"""Environment variable that the parent sets if it restarts the process whenever it ends.

Such a parent also keeps other systems off the ROS domain.
"""

READY = "BT_AGENTS_READY"
"""Environment variable with the file descriptor on which a node's process reports its start.

The report is a JSON object; see :func:`bt_agents_ros.spinner.report_ready`.
"""

READY_BYTES = 65_536
"""Longest report of a start, which an empty pipe takes at once [bytes]."""


def start(module: str) -> int:
    """Import a node's module, which takes long, and run its ``main``; return the exit code."""
    end_silently()
    with gc_paused():
        node = importlib.import_module(module)
    # The garbage collector never scans permanent objects again, not even at the end.
    gc.freeze()
    return int(node.main())


def one_process() -> int:
    """Run the nodes of the modules on the command line; return the exit code."""
    return start("bt_agents_ros.one_process")


if __name__ == "__main__":
    raise SystemExit(start(sys.argv.pop(1)))
