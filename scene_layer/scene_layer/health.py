# SPDX-License-Identifier: Apache-2.0
"""Health of the sources of a scene: which of them have a valid reading."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

from bt_agents_core.health import Health, PartHealth
from bt_agents_core.text import join_first


class Standing(Enum):
    """State of a topic of sources; the values are texts for people."""

    FRESH = "its reading holds"
    STALE = "its last reading is stale"
    UNREAD = "no reading so far"


def sources_health(
    standings: Mapping[str, Standing],
    refusals: Mapping[tuple[str, str], int],
    other_types: Mapping[str, str],
) -> PartHealth:
    """Return the health of the sources.

    Args:
        standings: Topic → its state.
        refusals: Topic and code → number of refused messages.
        other_types: Topic that is published as another type → that type, and the expected one.
    """
    values = {topic: standing.value for topic, standing in standings.items()}
    for (topic, code), count in refusals.items():
        values[topic] = f"{values.get(topic, '')}, {count} refused as {code}".removeprefix(", ")
    for topic, types in other_types.items():
        values[topic] = f"{values.get(topic, '')}, published as {types}".removeprefix(", ")
    stale = [topic for topic, one in standings.items() if one is Standing.STALE]
    unread = [topic for topic, one in standings.items() if one is Standing.UNREAD]
    if other_types:
        published = (f"{topic} is published as {one}" for topic, one in other_types.items())
        level, message = Health.ERROR, join_first(published)
    elif stale:
        level, message = Health.STALE, f"stale: {join_first(stale)}"
    elif unread:
        level, message = Health.WARN, f"no reading so far: {join_first(unread)}"
    else:
        level, message = Health.OK, "every source has a reading that holds"
    return PartHealth(
        part="sources", level=level, message=message if standings else "none", values=values
    )
