# SPDX-License-Identifier: Apache-2.0
"""Parts of a system on one of several machines."""

from __future__ import annotations

import re
import socket
from pathlib import Path

import click
import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.run_parts import PARTS, hold_parts, host_name, named_parts
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import hold_domain
from bt_agents_tools.launcher.network import open_to_network, prolong_requests
from bt_agents_tools.launcher.supervisor import LAN_PROFILE, LOOPBACK_PROFILE


@pytest.fixture(autouse=True)
def private_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")


def test_parts_are_comma_separated_and_default_to_all():
    assert named_parts("market, scene") == {"market", "scene"}
    assert named_parts("") == set(PARTS)


def test_unknown_part_is_refused_with_known_parts():
    with pytest.raises(click.UsageError) as caught:
        named_parts("market,seen")
    assert str(caught.value) == (
        "--only names 'seen', which is not a part of a system; expected some of market, scene, "
        "agents, feedback, robot, with commas between; did you mean 'scene'?"
    )


def test_every_part_names_a_component():
    trees = Path("/trees")
    made = [
        components.market(trees),
        components.scene_layer(trees),
        components.host(trees),
        components.feedback(trees, "ledger"),
        components.robot("off"),
    ]
    assert [component.name for component in made] == list(PARTS.values())


def test_a_host_is_named_after_its_machine(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "Ann's-Pi.local")
    assert host_name("") == "agents_ann_s_pi_local"
    monkeypatch.setattr(socket, "gethostname", lambda: "x" * 300)
    assert len(host_name("")) == 60
    assert host_name("left_arm") == "left_arm"
    command = components.host(Path("/trees"), name="left_arm").command()
    assert "__node:=left_arm" in command


@pytest.mark.parametrize("name", ["left arm", "7", "robot", "x" * 61, "ä"])
def test_invalid_host_name_is_refused(name: str):
    with pytest.raises(click.UsageError, match=r"--name is "):
        host_name(name)


def test_machine_runs_each_part_at_most_once():
    hold_parts(["robot"], "'bt-agents robot' (process 1)")
    hold_parts(["marketplace", "scene_layer"], "'bt-agents up --only market' (process 2)")
    with pytest.raises(BtAgentsError, match=r"the part robot already runs on ROS domain 7: 'bt-"):
        hold_parts(["robot"], "me")
    with pytest.raises(BtAgentsError, match=r"a system already runs on ROS domain 7: 'bt-agents"):
        hold_domain(7, "me")


def test_network_system_uses_profile_with_expiring_requests():
    environment = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(LOOPBACK_PROFILE)}
    open_to_network(environment)
    assert environment == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(LAN_PROFILE),
    }
    assert "<address>" not in LAN_PROFILE.read_text()
    [client] = re.findall(
        r'profile_name="client">.*?</data_writer>', LAN_PROFILE.read_text(), re.S
    )
    assert "<lifespan>" in client
    prolong_requests(environment, 2.5)
    made = Path(environment["FASTRTPS_DEFAULT_PROFILES_FILE"]).read_text()
    assert re.findall(r"<lifespan>\s*<duration>\s*(.*?)\s*</duration>", made, re.S) == [
        "<sec>2</sec>\n          <nanosec>500000000</nanosec>"
    ]


def test_user_dds_profile_is_kept():
    environment = {"FASTRTPS_DEFAULT_PROFILES_FILE": "/home/ann/fast.xml"}
    open_to_network(environment)
    prolong_requests(environment, 2.0)
    assert environment["FASTRTPS_DEFAULT_PROFILES_FILE"] == "/home/ann/fast.xml"


def test_hosts_wait_longer_on_slow_network():
    trees = Path("/trees")
    slow = components.on_slow_network(components.host(trees), 4.0)
    assert slow.parameters["slow_network"] == 4.0
    scene = components.scene_layer(trees)
    assert components.on_slow_network(scene, 4.0) == scene
