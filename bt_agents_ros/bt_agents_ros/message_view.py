# SPDX-License-Identifier: Apache-2.0
"""Read-only mapping over a ROS message that converts fields lazily."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bt_agents_core.field_types import Plain
from bt_agents_ros.types import read_field


class MessageView(Mapping[str, Plain]):
    """Fields of a message by name, each converted when first read; the message must not change."""

    def __init__(self, message: Any) -> None:
        self._message = message
        self._names = message.get_fields_and_field_types()
        self._converted: dict[str, Plain] = {}

    def __getitem__(self, name: str) -> Plain:
        if name not in self._names:
            raise KeyError(name)
        if name not in self._converted:
            self._converted[name] = read_field(self._message, name)
        return self._converted[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
