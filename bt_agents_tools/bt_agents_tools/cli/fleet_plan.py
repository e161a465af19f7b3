# SPDX-License-Identifier: Apache-2.0
"""Fleet of a robot: its process, which runs along with a system, and its output lines."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import click
from rich.console import Console

from bt_agents_core.optional_packages import how_to_install
from bt_agents_core.state_folder import FLEET_SETTINGS
from bt_agents_tools.cli.formatting import INDENT, print_line
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.supervisor import Component

_MOST_BYTES = 1 << 16


@dataclass(kw_only=True)
class FleetPlan:
    """Fleet process that starts with a system.

    Attributes:
        component: Its process.
        pipe: Descriptor of its output lines, over all of its starts.
    """

    component: Component
    pipe: int
    _begun: bytes = field(default=b"", init=False)

    def print_lines(self, console: Console) -> None:
        """Print the lines of the process since the last call; never block."""
        try:
            self._begun += os.read(self.pipe, _MOST_BYTES)
        except BlockingIOError:
            return
        *lines, self._begun = self._begun.split(b"\n")
        for line in lines:
            print_line(console, "[bold]fleet[/] ", line.decode(errors="replace"), INDENT)


def fleet_plan(trees: Path, state: Path, ledger: str) -> FleetPlan | None:
    """Return the fleet of a state folder; None if its robot has joined none.

    It is also None, after a line that says why, if the fleet process cannot run here.
    """
    if not (state / FLEET_SETTINGS).exists():
        return None
    for package in ("bt_agents_fleet", "psycopg"):
        if find_spec(package) is None:
            click.echo(f"no fleet: it needs {package}; {how_to_install('psycopg')}", err=True)
            return None
    pipe, end = os.pipe()
    os.set_blocking(pipe, False)
    return FleetPlan(component=components.fleet(trees, state, ledger, end), pipe=pipe)
