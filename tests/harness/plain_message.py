# SPDX-License-Identifier: Apache-2.0
"""Plain nested data that sources read as a message."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.errors import Refused
from bt_agents_core.field_path import NoSuchField, NoSuchItem, item_of, value_at
from scene_layer.sources import Message


def message_of(fields: Mapping[str, object]) -> Message:
    """Return plain nested data as a message."""

    def field(path: str) -> object:
        try:
            return value_at(fields, path, item_of)
        except NoSuchItem:
            raise Refused("NO_SUCH_ITEM", f"'{path}': the list is too short") from None
        except NoSuchField:
            raise Refused("UNKNOWN_FIELD", f"the message has no field '{path}'") from None

    return field
