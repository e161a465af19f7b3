# SPDX-License-Identifier: Apache-2.0
"""Every node under floods of messages and requests that are too large or too many."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from flooder import FLOODS, ROUNDS
from programs import ROOT

pytestmark = pytest.mark.e2e

FLOOD_S = 0.15
"""Length of a flood of a node, which is hundreds of small messages [s]."""

REST_S = 0.2
"""Least time for which a node is watched before and after a flood [s]."""

HANGS_S = 400
"""Time limit of a test [s]."""

LONGEST_SILENCE_S = 5.0
"""Longest time between two signs of life of a node, on a busy machine [s]."""

MOST_GROWTH_MB = 150.0
"""Growth of a node in a flood; of several floods of a kind, the smallest counts."""

MOST_ROOM_MB = 700.0
"""Growth of a node in any flood: the middleware keeps memory for very large messages."""

REFUSED = {
    "messages over the limit": "TOO_LARGE",
    "malformed messages": "MALFORMED",
    "requests over the limit": "TOO_LARGE",
}
"""Kinds that each node refuses → the code in its log.

It may be logged earlier, when another node is flooded on a topic of both.
"""

MOST_LINES = 20
"""Most lines that a node logs about refusals in a flood."""


@pytest.fixture(scope="module")
def floods() -> dict[str, list[dict[str, Any]]]:
    """Outcomes by kind of all floods of one system."""
    words = [str(ROOT / "benchmarks" / "floods.py"), str(FLOOD_S), str(REST_S)]
    ended = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, timeout=HANGS_S, check=False
    )
    print(ended.stdout)
    assert ended.returncode == 0, ended.stderr[-3000:]
    found: dict[str, list[dict[str, Any]]] = {}
    for line in ended.stdout.splitlines():
        outcome = json.loads(line)
        found.setdefault(outcome["kind"], []).append(outcome)
    return found


@pytest.mark.parametrize("kind", FLOODS)
def test_flood_neither_silences_nodes_nor_grows_memory(
    kind: str, floods: dict[str, list[dict[str, Any]]]
) -> None:
    for node in FLOODS[kind][1]:
        found = [one for one in floods[kind] if one["node"] == node]

        assert len(found) == ROUNDS.get(kind, 1)
        assert all(one["sent"] > 0 for one in found), found
        assert max(one["silence_s"] for one in found) < LONGEST_SILENCE_S, found
        assert min(one["growth_mb"] for one in found) < MOST_GROWTH_MB, found
        assert max(one["growth_mb"] for one in found) < MOST_ROOM_MB, found
        refusals = [one["refusals"] for one in found]
        assert max(refusals) <= MOST_LINES, found
        if kind in REFUSED:
            assert REFUSED[kind] in found[-1]["codes"], found
