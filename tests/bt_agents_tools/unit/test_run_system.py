# SPDX-License-Identifier: Apache-2.0
"""A system with scripted visitors: it runs until the last one has left."""

from __future__ import annotations

import time
from itertools import count
from typing import Any

import pytest

from bt_agents_tools.cli.run_system import _print_events
from bt_agents_tools.launcher.supervisor import Component


class Crowd:
    """System, observer and supervisor whose visitors are done after a thousand polls."""

    interrupt = visits_done = False
    looks = 0

    def __init__(self) -> None:
        self.observer = self.supervisor = self

    def start(self, *_components: Component) -> None:
        """Start nothing."""

    def start_fleet(self) -> None:
        """Start nothing."""

    def poll(self) -> None:
        """Print nothing."""

    def spin_until(self, _done: Any, _limit_s: float) -> None:
        self.looks += 1
        self.visits_done = self.looks == 1000


def test_long_script_is_played_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    minutes = count(step=60)
    monkeypatch.setattr(time, "monotonic", lambda: float(next(minutes)))
    crowd: Any = Crowd()
    _print_events(crowd, Component(name="visitors", module=""), None)
    assert crowd.visits_done
