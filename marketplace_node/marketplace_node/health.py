# SPDX-License-Identifier: Apache-2.0
"""Health of the market: its hosts and its queue of scenes."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from bt_agents_core.health import Health, PartHealth
from bt_agents_core.text import join_first


def hosts_health(agents: Mapping[str, int], absent: Mapping[str, str]) -> PartHealth:
    """Return the health of the registered hosts.

    Args:
        agents: Host → number of its agents.
        absent: Host → why it cannot be asked, for each host that cannot.
    """
    values = {host: absent.get(host) or f"{number} agents" for host, number in agents.items()}
    if not agents:
        level, message = Health.WARN, "no host has registered, so nobody bids"
    elif absent:
        level = Health.ERROR
        named = join_first(f"{host} ({reason})" for host, reason in absent.items())
        message = f"{len(absent)} of {len(agents)} hosts cannot be asked: {named}"
    else:
        level = Health.OK
        message = f"hosts: {len(agents)}, agents: {sum(agents.values())}"
    return PartHealth(part="hosts", level=level, message=message, values=values)


def queue_health(queued: int, awaited: Collection[str]) -> PartHealth:
    """Return the health of the queue; ``awaited`` are the hosts that its scenes wait for."""
    level, message = Health.OK, f"scenes in line: {queued}"
    if awaited:
        level, message = Health.WARN, f"{message}, for {join_first(awaited)}"
    return PartHealth(part="queue", level=level, message=message, values={"scenes": str(queued)})
