# SPDX-License-Identifier: Apache-2.0
"""Health of the feedback node: its ledger, and the delivery of profiles to hosts."""

from __future__ import annotations

from collections.abc import Collection

from bt_agents_core.health import Health, PartHealth
from bt_agents_core.text import join_first


def ledger_health(file: str, failure: str) -> PartHealth:
    """Return the health of the ledger; ``failure`` says why the last change was not recorded."""
    level, message = Health.OK, "every change is recorded"
    if failure:
        level, message = Health.ERROR, f"nothing is learned: {failure}"
    return PartHealth(part="ledger", level=level, message=message, values={"file": file})


def profiles_health(hosts: int, differing: Collection[str]) -> PartHealth:
    """Return the health of the profiles; ``differing`` are those that hosts have not accepted."""
    level, message = Health.OK, "every host bids with the profiles of the ledger"
    if differing:
        level = Health.WARN
        message = f"their hosts bid with other profiles: {join_first(differing)}"
    return PartHealth(part="profiles", level=level, message=message, values={"hosts": str(hosts)})
