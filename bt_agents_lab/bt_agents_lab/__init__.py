# SPDX-License-Identifier: Apache-2.0
"""Journal of a system, its replay, and experiments on the market and on learning."""

import sys

from bt_agents_core.optional_packages import journal_needs
from bt_agents_ros.node_main import start


def run_journal() -> int:
    """Run the journal; return the exit code."""
    try:
        return start("bt_agents_lab.node")
    except ModuleNotFoundError as error:
        print(f"error: {journal_needs(error.name)}", file=sys.stderr)
        return 1
