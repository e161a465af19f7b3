# SPDX-License-Identifier: Apache-2.0
"""A system with scripted visitors and a studio, which may be impossible."""

from __future__ import annotations

import time
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.listening import STUDIO_PORTS, listen
from bt_agents_tools.cli import run_system
from bt_agents_tools.cli.run_system import _print_events, studio_plan
from bt_agents_tools.launcher.supervisor import Component


def test_long_script_is_played_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    minutes = count(step=60)
    monkeypatch.setattr(time, "monotonic", lambda: float(next(minutes)))
    system = Mock(interrupt=False)
    system.observer.visits_done = False

    def spin_until(_done: Any, _limit_s: float) -> None:
        system.observer.visits_done = system.spin_until.call_count == 1000

    system.spin_until.side_effect = spin_until
    _print_events(system, Component(name="visitors", module=""), None)
    assert system.observer.visits_done


def test_addresses_of_earlier_start_are_removed(tmp_path: Path) -> None:
    (tmp_path / "studio.json").write_text("{}")
    plan = studio_plan(Path("trees"), tmp_path, tmp_path / "journal", browser_robot=True)
    assert plan is not None
    assert not plan.addresses.exists()
    assert plan.asks_person
    assert not plan.component.needed
    with plan.listening:
        number = plan.listening.fileno()
        assert plan.component.descriptors == (number,)
        folders = ("trees", str(tmp_path), str(tmp_path / "journal"))
        assert plan.component.arguments == (*folders, str(number))


def test_two_systems_use_different_ports(tmp_path: Path) -> None:
    plans = [studio_plan(tmp_path, tmp_path, tmp_path, browser_robot=False) for _ in range(2)]
    listening = [plan.listening for plan in plans if plan is not None]
    ports = {one.getsockname()[1] for one in listening}
    for one in listening:
        one.close()
    assert len(ports) == 2
    assert ports <= set(STUDIO_PORTS)


def test_system_continues_without_free_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with listen("127.0.0.1", [0]) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr(run_system, "STUDIO_PORTS", [port])
        assert studio_plan(tmp_path, tmp_path, tmp_path, browser_robot=False) is None
    assert capsys.readouterr().err == f"no studio: port {port} is taken\n"


def test_missing_studio_package_prints_one_install_hint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(run_system, "find_spec", lambda _name: None)
    assert studio_plan(Path("trees"), tmp_path, tmp_path, browser_robot=False) is None
    said = "no studio: it needs the package aiohttp; pip install aiohttp gets it"
    assert capsys.readouterr().err == f"{said}\n"
    with pytest.raises(BtAgentsError, match="pip install aiohttp"):
        studio_plan(Path("trees"), tmp_path, tmp_path, browser_robot=True)
