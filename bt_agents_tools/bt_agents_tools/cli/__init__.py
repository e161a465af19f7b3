# SPDX-License-Identifier: Apache-2.0
"""The command line `bt-agents`."""

from bt_agents_ros.signals import end_silently


def main() -> None:
    """Run the command line, whose modules take a while to load."""
    end_silently()
    from bt_agents_tools.cli.main import main as run

    run()
