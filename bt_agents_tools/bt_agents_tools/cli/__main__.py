# SPDX-License-Identifier: Apache-2.0
"""Lets ``python -m bt_agents_tools.cli`` be the command `bt-agents`."""

from bt_agents_tools.cli import main

main()
