# SPDX-License-Identifier: Apache-2.0
"""Stored ends: the next market announces them if the first one was killed before."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from bt_agents_core.scene import AGAIN
from bt_agents_interfaces.msg import Run
from bt_agents_tools.launcher.supervisor import Component
from dying_market import DIES_WHILE
from processes import NodeProcess, System, write_trees
from programs import ROOT

pytestmark = pytest.mark.e2e

TIMES = 10
"""Number of kills of a system's market."""

PAIRS = 2
"""Number of kills of the market with its host."""


@pytest.fixture
def fatal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that makes a market die at its next end."""
    file = tmp_path / "fatal"
    monkeypatch.setenv(DIES_WHILE, str(file))
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests" / "harness"), prepend=":")
    return file


def start(system: System) -> NodeProcess:
    trees = write_trees(system.folder / "leo", leo=(4.5, "say: leo speaks"))
    market = system.start(
        Component(
            name="marketplace",
            module="dying_market",
            parameters={
                "trees": str(trees),
                "scenes": str(system.folder / "scenes.json"),
                "collect_deadline": 0.05,
                "on_new_scene": "reject",
            },
        )
    )
    system.host("agents", trees)
    system.until_ready(hosts=1, agents=1)
    return market


def die_at_the_end(
    system: System, market: NodeProcess, fatal: Path, end: Callable[[], None], what: str = "scene"
) -> str:
    """Let the market die at the end of a scene or run; return its epoch."""
    market.expect_end()
    fatal.write_text(what)
    end()
    system.until(lambda: market.ended, "the market dies")
    assert not fatal.exists()
    return system.kill_market(market)


def kill_at_the_end(
    system: System, market: NodeProcess, fatal: Path, end: Callable[[], None]
) -> str:
    """Kill the market at the end of a scene, and restart it; return its epoch."""
    epoch = die_at_the_end(system, market, fatal, end)
    market.start()
    system.until_ready(hosts=1, agents=1, after=epoch)
    return epoch


def test_run_end_is_announced_once_despite_market_crash(system: System, fatal: Path) -> None:
    market = start(system)
    for number in range(TIMES):
        name = f"s{number}"
        system.old_person(name)
        system.until_speaking("leo speaks")

        epoch = kill_at_the_end(system, market, fatal, system.say_server.finish)

        found = system.until_end_of(name)
        assert (found.epoch, found.code, found.agent) == (epoch, "SUCCEEDED", "leo")
    check_that_no_end_comes_again(system, market, [f"s{number}" for number in range(TIMES)])


def test_scene_refusal_is_announced_once_despite_market_crash(system: System, fatal: Path) -> None:
    market = start(system)
    for number in range(TIMES):
        system.old_person(f"first{number}")
        system.until_speaking("leo speaks")
        name = f"s{number}"
        epoch = kill_at_the_end(system, market, fatal, partial(system.old_person, name))

        found = system.until_end_of(name)
        assert (found.epoch, found.code) == (epoch, "BUSY")
        system.say_server.let_go()
        if "asked again as" in system.until_end_of(f"first{number}").message:
            system.until_end_of(f"first{number}{AGAIN}")
        system.say_server.script.finish_s = None
    check_that_no_end_comes_again(system, market, [f"s{number}" for number in range(TIMES)])


@pytest.mark.parametrize("moment", ["while it runs", "right before its end is announced"])
def test_run_ends_once_when_market_and_host_crash(
    system: System, fatal: Path, moment: str
) -> None:
    market = start(system)
    host = system.processes[-1]
    for number in range(PAIRS):
        name = f"s{number}"
        system.old_person(name)
        system.until_speaking("leo speaks")
        system.until(lambda count=number + 1: len(system.started()) == count, "leo starts")

        if moment == "while it runs":
            epoch = system.kill_market(market)
        else:
            epoch = die_at_the_end(system, market, fatal, system.say_server.finish, "run")
        host.kill()
        market.start()
        host.start()
        system.until_ready(hosts=1, agents=1, after=epoch)

        code = "LOST" if moment == "while it runs" else "SUCCEEDED"
        assert system.until_end_of(name).code == code
        system.until(lambda count=number + 1: len(system.ended()) >= count, "the run has an end")
        assert (system.ended()[-1].epoch, system.ended()[-1].outcome) == (
            epoch,
            getattr(Run, code),
        )
        system.say_server.finish()
    check_that_no_end_comes_again(system, market, [f"s{number}" for number in range(PAIRS)])
    assert _runs(system.ended()) == _runs(system.started())


def _runs(events: list[Run]) -> list[tuple[str, int]]:
    return [(event.epoch, event.round) for event in events]


def check_that_no_end_comes_again(system: System, market: NodeProcess, names: list[str]) -> None:
    """Restart the market after all ends are announced; none may come again."""
    system.until(lambda: not fresh_ends(system), "the last end is confirmed")
    epoch = system.kill_market(market)
    market.start()
    system.until(
        lambda: system.epoch != epoch and system.statuses[-1].agents == 1, "the next market"
    )
    assert [len(system.ends_of(name)) for name in names] == [1] * len(names)


def fresh_ends(system: System) -> bool:
    """Return whether ends are stored that are not stored as announced."""
    text = (system.folder / "scenes.json").read_text(encoding="utf-8")
    return '"ends": []' not in text or '"run_ends": []' not in text
