# SPDX-License-Identifier: Apache-2.0
"""Texts of a language: ``${t.hello}`` means the text ``hello`` of ``texts/de.yaml``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Scalar

TEXT_PREFIX = "t."
"""Prefix of the name of a text."""


class NoText(BtAgentsError):
    """Missing text of a name, with the problem at the place of the name, and its code."""

    def __init__(self, message: str, hint: str = "", code: str = "unknown-name") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.code = code


@dataclass(frozen=True, kw_only=True)
class WrittenText:
    """Text as written in its file; several texts are variants."""

    source: Source
    scalars: tuple[Scalar, ...]


class Texts(Protocol):
    """Finder of texts by name, in one language."""

    def languages(self) -> list[str]:
        """Return the languages with texts."""

    def speaking(self, language: str) -> Texts:
        """Return the texts of another language."""

    def find(self, name: str) -> WrittenText:
        """Return the text of a name without its prefix.

        Raises:
            NoText: There is none.
        """
