# SPDX-License-Identifier: Apache-2.0
"""Supervised processes: command lines, environment, logs, and restarts."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_ros.node_main import NO_LOG_FILE
from bt_agents_tools.launcher.parameter_file import ParameterFile, read_parameters
from bt_agents_tools.launcher.supervisor import (
    LAN_PROFILE,
    LOOPBACK_PROFILE,
    Backoff,
    Component,
    ProcessState,
    SupervisedProcess,
    Supervisor,
    discovery_text,
    set_discovery,
)

HANG_S = 30.0
HANGS = "agents hangs (not heard for 10 s): killing it"


@pytest.mark.parametrize(
    ("lives", "waits"),
    [
        ([0.0] * 9, [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]),
        ([9.9, 9.9, 10.0, 40.0, 0.0], [0.5, 1.0, 0.0, 0.0, 0.5]),
        ([0.0] * 8 + [3600.0, 3600.0], [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 0.0, 0.0]),
    ],
)
def test_restart_delay_doubles_to_limit_and_resets(lives: list[float], waits: list[float]) -> None:
    backoff = Backoff()
    assert [backoff.next_wait(life) for life in lives] == waits


UP = """
import os, signal, time
def main():
    signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    os.write(int(os.environ["BT_AGENTS_READY"]), b'''%s''')
    print("pid", os.getpid(), flush=True)
    while True:
        time.sleep(60)
"""
UP_FOR_EVER = UP % "up"


BROKEN = """
def main():
    print("error: scene.yaml is broken", flush=True)
    return 1
"""


class Watched(Supervisor):
    """A supervisor on a manual clock, and the modules that it runs."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self._folder = folder
        super().__init__(folder / "logs", clock=lambda: self.now)
        monkeypatch.setenv("PYTHONPATH", str(folder))
        monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")

    def write(self, name: str, text: str) -> Component:
        (self._folder / f"{name}.py").write_text(text)
        return Component(name=name, module=name)

    def said(self, name: str) -> str:
        return self.log(name).read_text()

    def until(self, done: Callable[[list[str]], bool]) -> list[str]:
        """Poll until the events so far satisfy a condition."""
        events: list[str] = []
        end = time.monotonic() + HANG_S
        while not done(events):
            assert time.monotonic() < end, events
            events += self.poll()
            time.sleep(0.01)
        return events

    def up(self, name: str, starts: int = 1) -> int:
        """Wait until a component has started; return its pid."""
        self.until(lambda _events: len(re.findall(r"pid \d+\n", self.said(name))) == starts)
        return int(self.said(name).split()[-1])

    def run(self, name: str = "agents") -> int:
        """Start a component that stays up, and wait until it has started; return its pid."""
        self.start(self.write(name, UP_FOR_EVER))
        return self.up(name)

    def wait(self, seconds: float) -> list[str]:
        """Let time pass, with two polls a second; return the events."""
        events: list[str] = []
        for _ in range(round(2 * seconds)):
            self.now += 0.5
            events += self.poll()
        return events

    def end(self, name: str, pid: int) -> list[str]:
        """Kill a component; return its events."""
        os.kill(pid, signal.SIGKILL)
        return self.until(bool)


@pytest.fixture
def watched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Watched]:
    room = Watched(tmp_path, monkeypatch)
    yield room
    for one in room._components.values():
        one.process.kill()
        one.process.wait()
        one.close()


def test_process_states_follow_end_restart_and_leaving(watched: Watched) -> None:
    def agents() -> SupervisedProcess:
        [one] = watched.processes()
        return one

    watched.start(watched.write("agents", UP_FOR_EVER))
    assert (agents().state, agents().restarts) == (ProcessState.STARTING, 0)
    pid = watched.up("agents")
    watched.until(lambda _events: agents().state is ProcessState.UP)
    assert (agents().pid, agents().last_exit) == (pid, "")
    watched.now += 3
    watched.on_state("agents", "inactive")
    assert (agents().state, agents().since) == (ProcessState.INACTIVE, 103.0)
    watched.on_state("agents", "active")
    assert agents().state is ProcessState.UP
    watched.now += 3
    os.kill(pid, signal.SIGKILL)
    watched.until(lambda _events: agents().state is not ProcessState.UP)
    ended = agents()
    assert (ended.state, ended.since) == (ProcessState.ENDED, 106.0)
    assert ended.last_exit == "killed by signal 9"
    watched.now += 0.49
    assert (watched.poll(), agents().state) == ([], ProcessState.ENDED)
    watched.now += 0.01
    watched.until(lambda _events: agents().state is ProcessState.UP)
    assert (agents().restarts, agents().since) == (1, 106.5)
    assert agents().pid != pid


def test_silent_component_is_killed_and_restarted(watched: Watched) -> None:
    pid = watched.run("agents")
    watched.run("robot")
    watched.poll()
    os.kill(pid, signal.SIGSTOP)
    watched.on_heartbeat("agents")
    assert watched.wait(9.5) == []
    watched.now += 0.5
    events = watched.until(lambda events: len(events) > 1)
    assert events[0] == HANGS
    assert events[1].startswith("agents ended (killed by signal 9): starting it again at once")
    watched.on_heartbeat("agents")  # late, from the killed process
    watched.wait(30.0)
    assert watched.up("agents", 2) != pid
    assert "--- start 2, " in watched.said("agents")
    assert "--- start" not in watched.said("robot")


def test_inactive_node_may_be_silent(watched: Watched) -> None:
    watched.run()
    watched.on_state("agents", "active")  # its first state, which is no event
    assert watched.poll() == []
    watched.on_heartbeat("agents")

    watched.on_state("agents", "inactive")
    watched.on_heartbeat("agents")  # late, from its active time
    assert watched.poll() == ["agents was told to leave: it is inactive"]
    assert watched.wait(30.0) == []
    watched.on_state("agents", "active")
    assert watched.poll() == ["agents is active again"]

    watched.on_heartbeat("agents")
    assert watched.wait(10.0) == [HANGS]


def test_failed_node_was_not_told_to_leave(watched: Watched) -> None:
    watched.run()
    watched.on_state("agents", "unconfigured")
    assert watched.poll() == ["agents has failed: it is unconfigured"]


def test_heartbeat_of_any_node_counts_for_shared_process(watched: Watched) -> None:
    shared = replace(watched.write("system", UP_FOR_EVER), parts={"agents": "a", "robot": "b"})
    watched.start(shared)
    watched.up("system")
    watched.poll()
    for heard in [*["agents", "robot"] * 20, *["somebody else"] * 20]:
        watched.now += 0.5
        watched.on_heartbeat(heard)
        events = watched.poll()
        assert not events or heard == "somebody else"
    assert events[0] == "system hangs (not heard for 10 s): killing it"


def test_a_heartbeat_before_the_first_poll_counts(watched: Watched) -> None:
    watched.start(watched.write("agents", UP_FOR_EVER))
    end = time.monotonic() + HANG_S
    while watched._components["agents"].last_heartbeat is None:
        assert time.monotonic() < end
        watched.on_heartbeat("agents")
        time.sleep(0.01)
    assert watched.wait(10.0) == [HANGS]


def test_pause_of_the_supervisor_is_no_hang(watched: Watched) -> None:
    watched.run()
    watched.on_heartbeat("agents")
    watched.now += 3600.0
    assert watched.wait(50.0) == [], "after a long pause, only another heartbeat counts"
    watched.on_heartbeat("agents")
    watched.now += 5.0
    assert watched.poll() == []
    assert watched.wait(9.5) == []
    assert watched.wait(0.5) == [HANGS]


def test_parameters_are_judged_after_last_report(watched: Watched, tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    path.write_text("/**: {ros__parameters: {pace: 2.0, tick_rate: 9.0, tick_rat: 9.0}}")
    file = read_parameters(path)
    robot, agents = (
        replace(watched.write(name, UP % json.dumps({f"/{name}": said})), file=file)
        for name, said in (
            ("robot", {"tick_rate": "", "tick_rat": ""}),
            ("agents", {"pace": "", "tick_rat": "tick_rate"}),
        )
    )
    watched.start(robot, watched.write("studio", UP_FOR_EVER))
    watched.start(agents)
    events = watched.until(bool)
    assert all(map(watched.has_been_up, ("robot", "agents")))
    told = (
        "my.yaml: no node here has a parameter 'tick_rat', so its value counts for nothing; did "
        "you mean 'tick_rate'?"
    )
    assert events == [told]
    assert watched.unknown_parameters() == {"** tick_rat": told}
    assert watched.poll() == []


UP_AND_GONE = """
import os, time
def main():
    while not os.path.exists(os.environ["GO"]):
        time.sleep(0.01)
    os.write(int(os.environ["BT_AGENTS_READY"]), b"up")
    return 1
"""


def test_component_dying_during_poll_counts_as_up(
    watched: Watched, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("GO", str(tmp_path / "go"))
    watched.start(watched.write("agents", UP_AND_GONE))
    [one] = watched._components.values()
    poll_ready = one.poll_ready

    def polled_just_before(now: float) -> bool:
        up = poll_ready(now)
        (tmp_path / "go").touch()
        one.process.wait(HANG_S)
        return up

    monkeypatch.setattr(one, "poll_ready", polled_just_before)
    [ended] = watched.until(bool)
    assert "agents ended with exit code 1: starting it again in 0.5 s" in ended


def test_failed_first_start_is_an_error_with_log(watched: Watched) -> None:
    watched.start(watched.write("broken", BROKEN))
    with pytest.raises(BtAgentsError, match="broken ended with exit code 1") as caught:
        watched.until(bool)
    assert "error: scene.yaml is broken" in str(caught.value)
    assert watched.failure() == str(caught.value)
    assert watched.stop() == []


def test_previously_running_component_is_retried_forever(watched: Watched) -> None:
    watched.end("agents", watched.run())
    watched.write("agents", BROKEN)
    for wait in ("1", "2", "4"):
        watched.now += 30.0
        events = watched.until(bool)
        assert f"agents ended with exit code 1: starting it again in {wait} s" in events[0]
        assert events[1:] == ["  agents: error: scene.yaml is broken"]
    watched.write("agents", UP_FOR_EVER)
    watched.now += 30.0
    assert watched.until(bool) == ["agents is back after 120.0 s"]


def test_startup_time_does_not_count_as_uptime(watched: Watched) -> None:
    watched.start(watched.write("agents", UP_FOR_EVER))
    for starts, wait in enumerate(("0.5", "1"), start=1):
        watched.now += 40.0
        pid = watched.up("agents", starts)
        watched.poll()
        watched.now += 9.0
        assert f"starting it again in {wait} s" in watched.end("agents", pid)[0]


def test_only_its_process_gets_secret(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RANKER_KEY", raising=False)
    shown = UP_FOR_EVER.replace('"pid"', 'os.environ.get("RANKER_KEY"), "pid"')
    selector = replace(watched.write("selector", shown), environment={"RANKER_KEY": "s3cret"})
    watched.start(selector, watched.write("agents", shown))
    watched.up("selector")
    watched.up("agents")
    assert "s3cret" in watched.said("selector")
    for elsewhere in (watched.said("agents"), repr(selector), *selector.command()):
        assert "s3cret" not in elsewhere


@pytest.mark.parametrize(("keeps", "role"), [(False, "agents"), (True, "author")])
def test_each_node_has_its_own_enclave(
    watched: Watched, monkeypatch: pytest.MonkeyPatch, keeps: bool, role: str
) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENCLAVE_OVERRIDE", "/bt_agents/author")
    shown = UP_FOR_EVER.replace('"pid"', 'os.environ["ROS_SECURITY_ENCLAVE_OVERRIDE"], "pid"')
    watched.start(replace(watched.write("agents", shown), keeps_enclave=keeps))
    watched.up("agents")
    assert watched.said("agents").split()[-3] == f"/bt_agents/{role}"


def test_end_of_non_restarting_component_is_an_error(watched: Watched) -> None:
    watched.start(replace(watched.write("visitors", UP_FOR_EVER), restarts=False))
    pid = watched.up("visitors")
    with pytest.raises(BtAgentsError, match=r"visitors ended .killed by signal 9."):
        watched.end("visitors", pid)


@pytest.mark.parametrize("lives_s", [9.0, 11.0])
def test_only_a_new_component_can_be_refused(watched: Watched, lives_s: float) -> None:
    ends = UP_FOR_EVER.replace("_exit(0)", "_exit(os.EX_CONFIG)")
    watched.start(watched.write("marketplace", ends))
    pid = watched.up("marketplace")
    watched.wait(lives_s)
    os.kill(pid, signal.SIGTERM)
    if lives_s < 10.0:
        with pytest.raises(BtAgentsError, match=r"marketplace ended with exit code 78; "):
            watched.until(bool)
    else:
        assert "exit code 78: starting it again" in watched.until(bool)[0]


def test_system_continues_without_optional_component(watched: Watched) -> None:
    watched.start(replace(watched.write("studio", BROKEN), needed=False))
    for wait in ("0.5", "1"):
        events = watched.until(bool)
        assert f"studio ended with exit code 1: starting it again in {wait} s" in events[0]
        assert not watched.has_been_up("studio")
        watched.now += 30.0
    watched.write("studio", UP_FOR_EVER)
    watched.until(lambda events: any("studio is back" in event for event in events))
    assert watched.has_been_up("studio")


def test_command_names_all_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", "robot1")
    component = Component(
        name="n",
        module="m",
        arguments=("a b", "c"),
        parameters={"voice": "off", "path": 'a "b" c', "pace": 1.0, "count": 4, "flag": True},
        file=ParameterFile(path=Path("/f.yaml"), sections=()),
    )
    assert component.command() == [
        *(sys.executable, "-m", "bt_agents_ros.node_main", "m", "a b", "c", *NO_LOG_FILE),
        *("-r", "__ns:=/robot1", "--params-file", "/f.yaml"),
        *("-p", 'voice:="off"', "-p", 'path:="a \\"b\\" c"'),
        *("-p", "pace:=1.0", "-p", "count:=4", "-p", "flag:=true"),
    ]


SUBNET = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}


def test_traffic_stays_local_unless_user_overrides() -> None:
    environment: dict[str, str] = {}
    set_discovery(environment)
    whitelisted = SUBNET | {"FASTRTPS_DEFAULT_PROFILES_FILE": str(LOOPBACK_PROFILE)}
    assert environment == whitelisted
    assert "<address>127.0.0.1</address>" in LOOPBACK_PROFILE.read_text()
    set_discovery(environment)
    assert environment == whitelisted
    assert discovery_text(environment) == "this machine only"
    own = SUBNET.copy()
    set_discovery(own)
    assert own == SUBNET | {"FASTRTPS_DEFAULT_PROFILES_FILE": str(LAN_PROFILE)}
    assert discovery_text(own) == "open to everybody on this network"


@pytest.mark.parametrize(
    "own",
    [
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "ROS_NAMESPACE": "robot1"},
        {"FASTRTPS_DEFAULT_PROFILES_FILE": "/home/ann/fast.xml"},
    ],
)
def test_discovery_range_keeps_traffic_local_without_whitelist(own: dict[str, str]) -> None:
    environment = dict(own)
    set_discovery(environment)
    assert environment == {**own, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    assert discovery_text(environment) == "this machine only"


@pytest.mark.parametrize(
    ("on_term", "killed"), [("None", ["one"]), ("(time.sleep(2.2), os._exit(0))", [])]
)
def test_only_unresponsive_process_is_killed_at_shutdown(
    watched: Watched, tmp_path: Path, on_term: str, killed: list[str]
) -> None:
    supervisor = Supervisor(tmp_path / "logs")  # its clock goes on
    supervisor.start(watched.write("one", UP_FOR_EVER.replace("os._exit(0)", on_term)))
    while "pid" not in supervisor.log("one").read_text():
        assert not supervisor.failure()
    assert supervisor.stop() == killed


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("ROS_DOMAIN_ID", "abc", "'abc', expected"),
        ("ROS_DOMAIN_ID", "233", "'233', expected"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "everywhere", "'everywhere', expected"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF", "no process of the system finds another; unset"),
        ("ROS_NAMESPACE", "my robot", "'my robot', expected"),
        ("ROS_NAMESPACE", "//robot1", "'//robot1', expected"),
        ("ROS_NAMESPACE", "/robot" * 20, "of 100 characters at most"),
    ],
)
def test_invalid_ros_environment_is_explained(name: str, value: str, words: str) -> None:
    with pytest.raises(BtAgentsError, match=f"^{name} is .*{words}"):
        set_discovery({name: value})


def test_slash_after_namespace_does_not_count() -> None:
    environment = {"ROS_NAMESPACE": "/robot1/"}
    set_discovery(environment)
    assert environment["ROS_NAMESPACE"] == "/robot1"


def test_unwritable_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BtAgentsError, match="set XDG_STATE_HOME"):
        Supervisor(tmp_path / "file" / "logs").start(Component(name="n", module="m"))
