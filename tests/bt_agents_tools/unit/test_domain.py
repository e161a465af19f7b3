# SPDX-License-Identifier: Apache-2.0
"""ROS domains that a process reserves, and the parts of a system on several machines."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import click
import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.run_parts import PARTS, hold_parts, host_name, named_parts
from bt_agents_tools.launcher import components, domain_lock
from bt_agents_tools.launcher.domain_lock import hold_domain, holder, runtime_folder, turn_to_join
from bt_agents_tools.launcher.network import open_to_network, prolong_requests
from bt_agents_tools.launcher.supervisor import LAN_PROFILE, LOOPBACK_PROFILE

HOLD = """
import sys
from bt_agents_tools.launcher.domain_lock import hold_domain
hold_domain(7, "'bt-agents up' of /trees (process 1)")
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def private_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    return tmp_path


def test_domain_is_held_until_its_process_dies() -> None:
    command = [sys.executable, "-c", HOLD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        assert holder(7) == "'bt-agents up' of /trees (process 1)"
        assert holder(8) == ""
        with pytest.raises(BtAgentsError) as caught:
            hold_domain(7, "me")
        assert str(caught.value) == (
            "a system already runs on ROS domain 7: 'bt-agents up' of /trees (process 1); end it, "
            "or set ROS_DOMAIN_ID to another number"
        )
        hold_domain(8, "me")
        other.kill()
    assert holder(7) == ""
    hold_domain(7, "me")


def test_lock_is_private_and_names_its_holder(private_folder: Path) -> None:
    (private_folder / "bt-agents-system-9.lock").write_text("x" * 1000)  # of an earlier holder
    hold_domain(9, "me")
    [lock] = private_folder.iterdir()
    assert (lock.name, lock.read_text()) == ("bt-agents-system-9.lock", "me\n")
    assert lock.stat().st_mode & 0o777 == 0o600


def test_symlinked_lock_file_is_not_touched(private_folder: Path) -> None:
    precious = private_folder / "precious"
    precious.write_text("mine")
    os.symlink(precious, private_folder / "bt-agents-system-5.lock")
    with pytest.raises(BtAgentsError, match=r"bt-agents-system-5\.lock cannot be opened"):
        hold_domain(5, "me")
    assert precious.read_text() == "mine"


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files, without a login session."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(domain_lock, "LOGINS", tmp_path / "logins")
    return tmp_path


@pytest.mark.parametrize("named", [{}, {"XDG_RUNTIME_DIR": ""}, {"XDG_RUNTIME_DIR": "relative"}])
def test_missing_runtime_folder_uses_state_folder_per_machine(
    temporary: Path, named: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Another user's files there exclude nobody.
    (temporary / f"bt-agents-{os.getuid()}").write_text("")
    state = temporary / "state"
    for machine in ("robot", "a/../b"):
        monkeypatch.setattr("socket.gethostname", lambda name=machine: name)
        found = runtime_folder({**named, "XDG_STATE_HOME": str(state)})
        assert found == state / "bt-agents" / f"locks-{machine.replace('/', '%2F')}"
        assert found.stat().st_mode & 0o777 == 0o700


def test_missing_home_needs_private_temporary_folder(temporary: Path) -> None:
    (temporary / "file").write_text("")
    homeless = {"XDG_STATE_HOME": str(temporary / "file")}
    fallback = temporary / f"bt-agents-{os.getuid()}"
    assert runtime_folder(homeless) == fallback
    assert fallback.stat().st_mode & 0o777 == 0o700
    fallback.chmod(0o777)
    with pytest.raises(BtAgentsError, match="others can write there; set XDG_RUNTIME_DIR"):
        runtime_folder({**homeless, "XDG_RUNTIME_DIR": str(fallback)})
    fallback.rmdir()
    fallback.symlink_to(temporary)
    with pytest.raises(BtAgentsError, match="others can write there; set XDG_RUNTIME_DIR"):
        runtime_folder(homeless)


@pytest.mark.parametrize("participant", [0, 7, 119])
def test_domain_used_without_lock_is_not_reserved(participant: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        for first in range(domain_lock.FIRST, domain_lock.FIRST + 60):
            try:
                other.bind(("127.0.0.1", 7410 + 250 * first + 2 * participant))
            except OSError:
                continue
            break
        assert domain_lock.reserve_domain() != first


def test_concurrent_joins_per_domain_are_limited() -> None:
    with ExitStack() as joining:
        for _ in range(domain_lock.MOST_JOINING):
            joining.enter_context(turn_to_join(7))
        begin = time.monotonic()
        with turn_to_join(7, limit_s=0.2):
            assert time.monotonic() - begin >= 0.2, "it waits for its turn, and not for ever"
        begin = time.monotonic()
        with turn_to_join(8, limit_s=60.0):
            assert time.monotonic() - begin < 30.0, "another domain has turns of its own"
    with turn_to_join(7, limit_s=60.0):
        pass


def test_parts_are_comma_separated_and_default_to_all():
    assert named_parts("market, scene") == {"market", "scene"}
    assert named_parts("") == set(PARTS)


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
    assert "__node:=left_arm" in components.host(Path("/trees"), name="left_arm").command()


@pytest.mark.parametrize("name", ["left arm", "7", "robot", "journal", "x" * 61, "ä"])
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
    assert re.search(
        r"<lifespan>\s*<duration>\s*<sec>2</sec>\s*<nanosec>500000000</nanosec>", made
    )


def test_user_dds_profile_is_kept():
    environment = {"FASTRTPS_DEFAULT_PROFILES_FILE": "/home/ann/fast.xml"}
    open_to_network(environment)
    prolong_requests(environment, 2.0)
    assert environment["FASTRTPS_DEFAULT_PROFILES_FILE"] == "/home/ann/fast.xml"


def test_hosts_wait_longer_on_slow_network():
    trees = Path("/trees")
    host, scene = components.host(trees), components.scene_layer(trees)
    assert components.on_slow_network(host, 4.0).parameters["slow_network"] == 4.0
    assert components.on_slow_network(scene, 4.0) == scene
