# SPDX-License-Identifier: Apache-2.0
"""Texts of a language: ``${t.hello}`` stands for the text ``hello`` of ``texts/de.yaml``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Scalar

TEXT_PREFIX = "t."
"""How the name of a text begins."""


class NoText(BtAgentsError):
    """There is no text of a name, with the problem where it is named, and its code."""

    def __init__(self, message: str, hint: str = "", code: str = "unknown-name") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.code = code


@dataclass(frozen=True, kw_only=True)
class WrittenText:
    """A text as it stands in its file; several are variants."""

    source: Source
    scalars: tuple[Scalar, ...]


class Texts(Protocol):
    """Finds texts by their names, in one language."""

    def languages(self) -> list[str]:
        """Return the languages of which there are texts."""

    def speaking(self, language: str) -> Texts:
        """Return the texts of another language."""

    def find(self, name: str) -> WrittenText:
        """Return the text of a name without its prefix.

        Raises:
            NoText: There is none.
        """
