# SPDX-License-Identifier: Apache-2.0
"""Lets ``python -m bt_agents.cli`` be the command `bt-agents`."""

from bt_agents.cli import main

main()
