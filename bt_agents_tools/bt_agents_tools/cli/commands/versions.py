# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents versions`: the good versions of an agent."""

from __future__ import annotations

import time
from typing import Any

import click

from bt_agents_tools.cli.connection import accepted, connect, find_host


@click.command()
@click.argument("agent")
def versions(agent: str) -> None:
    """List the good versions that an AGENT has had since its host was started."""
    with connect() as observer:
        from bt_agents_tools.client import reloading

        answer = reloading.list_versions(observer, find_host(observer, agent), agent)
        for version in accepted(answer, f"the host of {agent}").versions:
            click.echo(_line(version))


def _line(version: Any) -> str:
    read_at = time.strftime("%H:%M:%S", time.localtime(version.stamp.sec))
    place = "in force" if version.current else "waits for the end of the run" * version.waiting
    change = f": {version.change}" if version.change else ""
    mark = "*" if version.current else "+" if version.waiting else " "
    return f"{mark} {version.version:>4}  {read_at}  {version.cause}{change}" + (
        f"  ({place})" if place else ""
    )
