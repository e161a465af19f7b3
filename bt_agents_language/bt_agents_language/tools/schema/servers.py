# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of what a binding says about its server: ``timeouts`` and ``heartbeat``."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents_language.model.server_timeouts import HEARTBEAT_KEYS, TIMEOUT_KEYS
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.documents import mapping
from bt_agents_language.tools.schema.value_schemas import Schema, described


def timeouts(keys: Iterable[str]) -> Schema:
    """Return the schema of ``timeouts`` with these keys."""
    return mapping(
        {key: described(value_schemas.duration(), TIMEOUT_KEYS[key]) for key in keys}, []
    )


def heartbeat() -> Schema:
    """Return the schema of ``heartbeat``."""
    schemas = {
        "topic": value_schemas.ros_name(),
        "type": value_schemas.ros_type(),
        "within": value_schemas.duration(),
    }
    return mapping(
        {key: described(one, HEARTBEAT_KEYS[key]) for key, one in schemas.items()},
        ["topic", "type"],
    )
