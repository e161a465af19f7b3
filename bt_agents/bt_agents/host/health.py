# SPDX-License-Identifier: Apache-2.0
"""Health of a host: its files, its ticks and the servers of its skills."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from bt_agents_core.health import Health, PartHealth
from bt_agents_core.text import join_first


@dataclass(frozen=True, kw_only=True)
class TickCounts:
    """Ticks of the current run, else of the last one.

    Attributes:
        agent: The agent of the tree; empty before the first run.
        overruns: Ticks that took longer than the period.
    """

    agent: str = ""
    overruns: int = 0


def files_health(agents: int, problems: Collection[tuple[str, str]]) -> PartHealth:
    """Return the health of the agents' files; a problem is a place and a text."""
    values = dict(problems)
    if problems:
        level = Health.ERROR
        message = f"problems in files: {len(problems)}, in {join_first(dict(problems))}"
    else:
        level, message = Health.OK, f"agents: {agents}, all files are in order"
    return PartHealth(part="files", level=level, message=message, values=values)


def ticks_health(counts: TickCounts) -> PartHealth:
    """Return the health of the ticks."""
    level, message = Health.OK, "no tick took too long"
    if counts.overruns:
        level = Health.WARN
        message = f"ticks of {counts.agent} took too long; see the log of the host"
    values = {"agent": counts.agent, "too long": str(counts.overruns)}
    return PartHealth(part="ticks", level=level, message=message, values=values)


def servers_health(silent: Mapping[str, str], doubtful: Mapping[str, str]) -> PartHealth:
    """Return the health of the servers of the skills.

    Args:
        silent: Server → why it has not answered.
        doubtful: Server → what else keeps it from working as intended.
    """
    level, message = Health.OK, "every server has answered the last goal"
    if silent:
        level, message = Health.ERROR, f"silent: {join_first(silent)}"
    elif doubtful:
        level, message = Health.WARN, f"doubtful: {join_first(doubtful)}"
    return PartHealth(part="servers", level=level, message=message, values={**doubtful, **silent})
