# SPDX-License-Identifier: Apache-2.0
"""A system on three machines: packet loss and unplugged cables."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from machines import SERVER_PORT, Network, address_of
from processes import write_trees
from programs import ROOT

pytestmark = pytest.mark.e2e

MARKET, HOST, ROBOT = "brain", "helper", "body"
MACHINES = (MARKET, HOST, ROBOT)
CABLE_S = float(os.environ.get("BT_AGENTS_CABLE_S", "3"))
"""Time for which the cable of one machine is unplugged [s]."""

LONG_S = max(12.0, CABLE_S)
"""Longer than the lease of a participant, so machines must discover each other again [s]."""

DELAY_S = float(os.environ.get("BT_AGENTS_DELAY_S", "0.05"))
"""Delay of the slow network in each direction [s]."""

OPTIONS = ("--lan", "--slow-network", "2" if DELAY_S <= 0.05 else "4")
PEERS = {"ROS_STATIC_PEERS": ";".join(address_of(number) for number in (1, 2, 3))}
SERVER = {"ROS_DISCOVERY_SERVER": f"{address_of(1)}:{SERVER_PORT}"}


def trees(folder: Path, agent: str, age: float) -> Path:
    """Make the folder of an agent that says its name for some seconds, and when it is stopped."""
    tree = f"sequence: [{{say: {agent} begins}}, {{wait: 2 s}}, {{say: {agent} ends}}]"
    made = write_trees(folder / agent, **{agent: (age, tree)})
    shutil.copy(ROOT / "trees" / "skills" / "robot.yaml", made / "skills" / "voice.yaml")
    with (made / "agents" / f"{agent}.yaml").open("a") as file:
        file.write(f"\non_cancel: {{say: {agent} stops here}}\n")
    return made


class Robot:
    """The machines of one robot: market, an agent next to it, another elsewhere, and the body."""

    def __init__(self, network: Network, folder: Path) -> None:
        self.network = network
        self._leo = str(trees(folder, "leo", 5))
        mira = str(trees(folder, "mira", 1))
        parts = "market,scene,feedback,agents"
        self.brain = network.start(MARKET, "up", mira, "--only", parts, *OPTIONS)
        self.body = network.start(ROBOT, "robot", "--no-voice", *OPTIONS)
        self.join()
        self.heard = network.listen(ROBOT)
        self.told = network.listen(MARKET)

    def join(self) -> None:
        """Start leo's host."""
        self.helper = self.network.start(HOST, "host", self._leo, *OPTIONS)
        self.brain.until("market 2 hosts, 2 agents")

    def out(self, *machines: str, seconds: float) -> None:
        """Unplug machines for some seconds; print the time until leo has run again."""
        self.network.set(out=machines)
        time.sleep(seconds)
        self.network.set(out=())
        began = time.monotonic()
        self.until_leo_has_run()
        took_s = time.monotonic() - began
        print(f"{', '.join(machines)} out for {seconds:g} s: leo has run {took_s:.1f} s later")

    def trigger(self) -> None:
        """Trigger a scene that suits leo."""
        self.network.start(MARKET, "trigger", "age=5").wait()

    def until_leo_has_run(self) -> None:
        """Trigger scenes until leo has completed a run: after a cut, not all are back at once."""
        for _ in range(5):
            self.trigger()
            if "leo SUCCEEDED" in self.told.until("^end: "):
                return
        pytest.fail(f"leo does not come back:\n{self.told.output}\n{self.heard.output}")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A robot of three machines, on a network that all tests leave unchanged."""
    folder = tmp_path_factory.mktemp("machines")
    network = Network(folder, MACHINES)
    try:
        yield Robot(network, folder)
    finally:
        network.close()


def test_hosts_run_leave_and_join_on_lossy_network(robot: Robot) -> None:
    robot.network.set(delay=DELAY_S, loss=0.05)
    try:
        robot.until_leo_has_run()
        assert f"host      /agents_{HOST}, on {HOST}" in robot.network.ask(ROBOT, "status")
        assert robot.helper.stop()[0] == 0
        robot.brain.until("market 1 host, 1 agent")
        robot.join()
    finally:
        robot.network.set(delay=0.0, loss=0.0)


def test_disconnected_host_does_not_interrupt_its_successor(robot: Robot) -> None:
    robot.until_leo_has_run()
    robot.heard.seen(0.5)
    robot.trigger()
    robot.heard.until("says: leo begins")
    robot.network.set(out=[HOST])
    try:
        robot.told.until("leo 3-4")
        robot.heard.until("says: mira begins")
        time.sleep(1.0)
    finally:
        robot.network.set(out=())
    before = len(robot.heard.output)
    robot.told.until("^end: mira SUCCEEDED")
    late = robot.heard.seen(1.0)[before:]
    assert "says: mira ends" in late
    assert "says: leo" not in late


@pytest.mark.parametrize("machine", MACHINES)
def test_machine_reconnects_by_itself_after_cable_loss(robot: Robot, machine: str) -> None:
    robot.trigger()
    robot.out(machine, seconds=CABLE_S)


def test_separated_machines_find_each_other_again(robot: Robot) -> None:
    robot.out(*MACHINES, seconds=LONG_S)


@pytest.mark.parametrize("variables", [PEERS, SERVER], ids=["static peers", "discovery server"])
def test_machines_without_multicast_use_configured_discovery(
    tmp_path: Path, variables: dict[str, str]
) -> None:
    network = Network(tmp_path, MACHINES, variables)
    try:
        network.set(multicast=False)
        if variables is SERVER:
            network.serve_discovery(MARKET)
        Robot(network, tmp_path).until_leo_has_run()
        assert "2 agents" in network.ask(ROBOT, "status")
    finally:
        network.close()
