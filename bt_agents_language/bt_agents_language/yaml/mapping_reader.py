# SPDX-License-Identifier: Apache-2.0
"""The keys of one mapping of a file, each read as the type that is expected of it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, TypeVar

from bt_agents_language.model import quantities
from bt_agents_language.model.specs import FieldType
from bt_agents_language.yaml.yaml_reader import Mapping, MappingEntry, Node, Scalar

if TYPE_CHECKING:
    from bt_agents_language.yaml.typed_reader import TypedReader

MESSAGE_DIGITS = 6
"""Digits of a number in a message, more than rounding it for people would keep."""

T = TypeVar("T")


class MappingReader:
    """The keys of one mapping, each readable as the type that is expected of it.

    Attributes:
        mapping: The mapping itself.
        nodes: Value of each key that is known.
        keys: Every key as it stands in the file.
    """

    def __init__(
        self,
        reading: TypedReader,
        what: str,
        mapping: Mapping,
        nodes: dict[str, Node],
        keys: dict[str, Scalar],
    ) -> None:
        self.mapping = mapping
        self.nodes = nodes
        self.keys = keys
        self._reading = reading
        self._what = what

    def get(self, key: str) -> Node | None:
        """Return what stands behind a key."""
        return self.nodes.get(key)

    def check_range(
        self,
        what: str,
        minimum: float | None,
        maximum: float | None,
        field_type: FieldType = FieldType.NUMBER,
    ) -> bool:
        """Return whether 'min' is below 'max', as far as both are known; note it when not."""
        if minimum is None or maximum is None or minimum < maximum:
            return True
        low, high = (
            quantities.spoken(limit, field_type, MESSAGE_DIGITS) for limit in (minimum, maximum)
        )
        self._reading.error(
            "out-of-range",
            self.nodes["max"],
            f"'max' of {what} is {high}, which is not more than 'min', {low}",
            "make 'max' the larger one",
        )
        return False

    def text(self, key: str, default: str = "") -> str:
        """Return a text, ``default`` when it is not there or wrong."""
        return self._read(key, self._reading.text) or default

    def name(self, key: str) -> str | None:
        """Return an identifier."""
        return self._read(key, self._reading.name)

    def integer(
        self, key: str, minimum: int | None = None, maximum: int | None = None
    ) -> int | None:
        """Return a whole number."""
        return self._read(key, lambda n, w: self._reading.integer(n, w, minimum, maximum))

    def number(
        self, key: str, minimum: float | None = None, maximum: float | None = None
    ) -> float | None:
        """Return a number."""
        return self._read(key, lambda n, w: self._reading.number(n, w, minimum, maximum))

    def duration(self, key: str) -> float | None:
        """Return a time [s]."""
        return self._read(key, self._reading.duration)

    def boolean(self, key: str) -> bool | None:
        """Return true or false."""
        return self._read(key, self._reading.boolean)

    def choice(self, key: str, words: Collection[str]) -> str | None:
        """Return one of some words."""
        return self._read(key, lambda n, w: self._reading.choice(n, w, words))

    def items(self, key: str) -> tuple[Node, ...]:
        """Return the items of a list, none when it is not there."""
        return self._read(key, self._reading.items) or ()

    def entries(self, key: str, of: str) -> tuple[MappingEntry, ...]:
        """Return the entries of a mapping of something, none when it is not there."""
        return self._read(key, lambda n, w: self._reading.entries(n, w, of)) or ()

    def _read(self, key: str, read: Callable[[Node, str], T | None]) -> T | None:
        node = self.nodes.get(key)
        return None if node is None else read(node, f"'{key}'")
