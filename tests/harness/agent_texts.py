# SPDX-License-Identifier: Apache-2.0
"""Agents without the keys that every agent needs, and refusals of files."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.errors import ReadError
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.nodes.symbols import SymbolTable
from file_texts import read_agent_text
from tree_harness import SYMBOLS

HEAD = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\n"


def agent_of(keys: str, symbols: SymbolTable = SYMBOLS) -> AgentSpec:
    """Return the agent of a file that starts with :data:`HEAD`."""
    return read_agent_text(HEAD + keys, "a.yaml", symbols)


def problems_of(read: Callable[..., object], *given: object) -> tuple[Diagnostic, ...]:
    """Return the problems for which a reader refuses a file; none if it accepts the file."""
    try:
        read(*given)
    except ReadError as error:
        return error.diagnostics
    return ()


def refusal(read: Callable[..., object], *given: object, **settings: object) -> ReadError:
    """Return the error with which a reader refuses a file."""
    with pytest.raises(ReadError) as caught:
        read(*given, **settings)
    return caught.value
