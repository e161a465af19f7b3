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
"""How long each flood of a node lasts, which is hundreds of small messages [s]."""

REST_S = 0.2
"""How long a node is watched before and after a flood, at least [s]."""

HANGS_S = 400
"""Until a test gives up [s]."""

LONGEST_SILENCE_S = 5.0
"""Between two signs of life of a node, on a machine that does other work [s]."""

MOST_GROWTH_MB = 150.0
"""Growth of a node in a flood; of several floods of a kind, in one of them at least."""

MOST_ROOM_MB = 700.0
"""Growth of a node in any flood: the middleware keeps room for very large messages."""

REFUSED = {
    "messages over the limit": "TOO_LARGE",
    "malformed messages": "MALFORMED",
    "requests over the limit": "TOO_LARGE",
}
"""Kinds that each node refuses → the code that its log says then.

It may have said it a moment before, when another node was flooded on a topic that both listen to.
"""

MOST_LINES = 20
"""Lines that a node logs of what it refuses in a flood."""


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
