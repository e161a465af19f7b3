# SPDX-License-Identifier: Apache-2.0
"""Command lines and the environment of the supervised processes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bt_agents.cli.supervisor import LOOPBACK_PROFILE, Component, Supervisor, keep_local
from bt_agents.errors import BtAgentsError


def test_parameters_are_handed_over_with_their_types() -> None:
    component = Component(
        name="n",
        module="m",
        parameters={"voice": "off", "path": 'a "b" c', "pace": 1.0, "count": 4, "flag": True},
    )
    assert component.command()[5:] == [
        *("-p", 'voice:="off"'),
        *("-p", 'path:="a \\"b\\" c"'),
        *("-p", "pace:=1.0"),
        *("-p", "count:=4"),
        *("-p", "flag:=true"),
    ]
    assert component.command()[:3] == [sys.executable, "-m", "m"]


def test_traffic_stays_on_this_machine_unless_the_user_has_said_otherwise() -> None:
    environment: dict[str, str] = {}
    keep_local(environment)
    assert environment == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(LOOPBACK_PROFILE),
    }
    assert LOOPBACK_PROFILE.is_file()
    own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    keep_local(own)
    assert own == {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}


def test_a_process_that_ends_by_itself_is_named_with_its_last_words(tmp_path: Path) -> None:
    supervisor = Supervisor(tmp_path / "logs")
    supervisor.start(Component(name="broken", module="no_such_module"))
    try:
        for process in supervisor._processes.values():
            process.wait(20)
        assert "broken ended with exit code 1" in supervisor.dead()
        assert "No module named no_such_module" in supervisor.dead()
    finally:
        assert supervisor.stop() == []


def test_a_process_that_does_not_end_when_asked_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "deaf.py").write_text(
        "import signal, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "print('deaf', flush=True)\n"
        "time.sleep(60)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    supervisor = Supervisor(tmp_path / "logs")
    supervisor.start(Component(name="deaf", module="deaf"))
    while "deaf" not in supervisor.log("deaf").read_text():
        assert not supervisor.dead()
    assert supervisor.stop() == ["deaf"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"ROS_DOMAIN_ID": "abc"},
        {"ROS_DOMAIN_ID": "999"},
        {"ROS_DOMAIN_ID": "-1"},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "everywhere"},
    ],
)
def test_an_environment_that_ros_does_not_know_is_refused_in_words(wrong: dict[str, str]) -> None:
    name, value = next(iter(wrong.items()))
    with pytest.raises(BtAgentsError, match=f"{name} is '{value}', expected"):
        keep_local(dict(wrong))


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BtAgentsError, match="set XDG_STATE_HOME"):
        Supervisor(tmp_path / "file" / "logs").start(Component(name="n", module="m"))
