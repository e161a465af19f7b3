# SPDX-License-Identifier: Apache-2.0
"""A system that is run for its visitors goes on as long as they do."""

from __future__ import annotations

import time
from itertools import count
from typing import Any

import pytest
from rich.console import Console

from bt_agents_tools.cli.run_system import _print_events
from bt_agents_tools.launcher.supervisor import Component


class Crowd:
    """Observer and supervisor in one, of visitors who are done after a thousand looks."""

    visits_done = False
    looks = 0

    def start(self, *_components: Component) -> None:
        """Start nothing."""

    def poll(self) -> list[str]:
        return []

    def publish_health(self) -> None:
        """Publish nothing."""

    def spin_until(self, _done: Any, _limit_s: float) -> None:
        self.looks += 1
        self.visits_done = self.looks == 1000


def test_long_script_is_played_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    minutes = count(step=60)
    monkeypatch.setattr(time, "monotonic", lambda: float(next(minutes)))
    crowd: Any = Crowd()
    never: Any = False
    _print_events(
        Console(), crowd, crowd, never, Component(name="visitors", module=""), None, None
    )
    assert crowd.visits_done
