# SPDX-License-Identifier: Apache-2.0
"""The command line `bt-agents`."""

import gc

from bt_agents_ros.signals import end_silently, loading


def main() -> None:
    """Run the command line, whose modules load slowly."""
    end_silently()
    with loading():
        from bt_agents_tools.cli.main import main as run
    try:
        run()
    finally:
        # Otherwise the garbage collector would scan everything at the end.
        gc.freeze()
