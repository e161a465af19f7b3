# SPDX-License-Identifier: Apache-2.0
"""Connection of a command line to a running system, and the messages without one."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import click
import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli import connection
from bt_agents_tools.cli.connection import connect, wait_for_market
from bt_agents_tools.cli.table import TableForm, table_options
from bt_agents_tools.client import observer
from command_results import split_runner

UP = "'bt-agents up' of /trees (process 1)"


class Graph:
    """An observer's graph, in which time passes only while it spins.

    Args:
        heard_after_s: When the market's status arrives [s].
        markets: Namespaces of the marketplaces.
    """

    namespace = "/"

    def __init__(self, heard_after_s: float = math.inf, markets: tuple[str, ...] = ()) -> None:
        self.now, self._heard_after_s = 0.0, heard_after_s
        self.namespaces_of_markets = lambda: markets

    @property
    def market(self) -> Any:
        return "a status" if self.now >= self._heard_after_s else None

    def spin_until(self, done: Callable[[], bool], limit_s: float) -> bool:
        end = self.now + limit_s
        while self.now < end and not done():
            self.now += 0.5
        return done()


class System(Graph):
    """A running system with a host per trees folder; the cards of the hosts arrive later."""

    def __init__(self, *folders: str) -> None:
        super().__init__(heard_after_s=0.0)
        self._folders = folders

    @property
    def market(self) -> Any:
        return SimpleNamespace(hosts=len(self._folders))

    @property
    def cards(self) -> dict[str, Any]:
        folders = enumerate(self._folders if self.now else ())
        return {f"/h{number}": SimpleNamespace(trees=folder) for number, folder in folders}

    def close(self) -> None:
        pass


@click.command()
@table_options
def talking(form: TableForm) -> None:
    connect()
    click.echo("done")


@pytest.mark.parametrize(
    ("folders", "words", "said"),
    [
        (["/a", "/a"], [], "trees folder of the system: /a\n"),
        (["/b", "/a\x1b[2J"], ["--wide"], "trees folder of the system: /a [2J, /b\n"),
        (["/a"], ["--json"], ""),
        (["", ""], [], ""),
        ([], [], ""),
    ],
)
def test_command_names_trees_folder_of_running_system(
    monkeypatch: pytest.MonkeyPatch, folders: list[str], words: list[str], said: str
) -> None:
    monkeypatch.setattr(observer, "Observer", lambda: System(*folders))
    result = split_runner().invoke(talking, words)
    assert (result.stdout, result.stderr) == ("done\n", said)


@pytest.fixture(autouse=True)
def holders(monkeypatch: pytest.MonkeyPatch) -> dict[int, str]:
    """Return who holds each domain."""
    known = {7: ""}
    monkeypatch.setattr(connection, "holder", known.get)
    return known


def words(graph: Any) -> str:
    with pytest.raises(BtAgentsError) as caught:
        wait_for_market(graph, 7)
    return str(caught.value)


@pytest.mark.parametrize(("who", "markets"), [(UP, ()), ("", ("/",))])
def test_slow_market_is_awaited_while_it_is_known(
    holders: dict[int, str], who: str, markets: tuple[str, ...]
) -> None:
    holders[7] = who
    graph: Any = Graph(heard_after_s=9.5, markets=markets)
    wait_for_market(graph, 7)
    assert graph.now == 9.5


def test_missing_system_is_reported_quickly() -> None:
    graph = Graph(heard_after_s=9.5)
    assert words(graph) == (
        "no running system on ROS domain 7; start one with 'bt-agents up', or set ROS_DOMAIN_ID "
        "to its domain; for one on other machines set ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"
    )
    assert graph.now == 3.0


def test_silent_system_is_not_reported_as_missing(holders: dict[int, str]) -> None:
    holders[7] = UP
    assert words(Graph()) == (
        f"{UP} is on ROS domain 7, but its marketplace has not been heard for 10 s: it is being "
        "started, was told to leave, or the machine is very busy; try again"
    )


def test_error_names_systems_in_other_namespaces() -> None:
    assert words(Graph(markets=("/robot1", "/robot2"))) == (
        "no running system in namespace '/' of ROS domain 7; set ROS_NAMESPACE, there is one in "
        "/robot1, /robot2"
    )


HANGING = """
import ctypes, sys
import click
from bt_agents_ros.workarounds import bounded_end
from bt_agents_tools.cli import connection
from bt_agents_tools.cli.main import COMMANDS, CommandEntry, main
from bt_agents_tools.client import observer

class Hanging:
    def close(self):
        ctypes.PyDLL(None).pause()  # with the GIL, as rclpy ends a participant

@click.command()
def hang():
    connection.new_observer()
    click.echo("done")
    sys.exit(int(sys.argv[0]))

bounded_end.END_LIMIT_S = 1
observer.Observer = Hanging
COMMANDS["hang"] = CommandEntry("__main__", "hang")
sys.argv = [sys.argv[1], "hang"]
main()
"""


@pytest.mark.parametrize("code", [0, 3])
def test_command_exit_code_survives_hanging_middleware(code: int) -> None:
    command = [sys.executable, "-c", HANGING, str(code)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "done\n", "")
