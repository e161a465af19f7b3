# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of what a binding says about its server: ``timeouts`` and ``heartbeat``."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents.language.schema import values
from bt_agents.language.schema.scenes import mapping
from bt_agents.language.schema.values import Schema, described
from bt_agents.language.server_limits import HEARTBEAT_KEYS, TIMEOUT_KEYS


def timeouts(keys: Iterable[str]) -> Schema:
    """Return the schema of ``timeouts`` with these keys."""
    return mapping({key: described(values.duration(), TIMEOUT_KEYS[key]) for key in keys}, [])


def heartbeat() -> Schema:
    """Return the schema of ``heartbeat``."""
    schemas = {
        "topic": values.ros_name(),
        "type": values.ros_type(),
        "within": values.duration(),
    }
    return mapping(
        {key: described(one, HEARTBEAT_KEYS[key]) for key, one in schemas.items()},
        ["topic", "type"],
    )
