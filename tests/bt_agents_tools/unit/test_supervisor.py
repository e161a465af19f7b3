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
HANGS = "agents hangs (no heartbeat for 10 s): killing it"


@pytest.mark.parametrize(
    ("lives", "waits"),
    [
        ([0.0] * 9, [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]),
        ([9.9, 9.9, 9.9], [0.5, 1.0, 2.0]),
        ([10.0, 15.0, 40.0], [0.5, 0.5, 0.5]),
        ([0.0, 0.0, 10.0, 0.0], [0.5, 1.0, 0.5, 1.0]),
        ([0.0] * 8 + [3600.0, 3600.0], [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 0.5, 0.5]),
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


class Watched:
    """A supervisor on a manual clock, and the modules that it runs."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self._folder = folder
        self.supervisor = Supervisor(folder / "logs", clock=lambda: self.now)
        monkeypatch.setenv("PYTHONPATH", str(folder))
        monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")

    def write(self, name: str, text: str) -> Component:
        (self._folder / f"{name}.py").write_text(text)
        return Component(name=name, module=name)

    def said(self, name: str) -> str:
        return self.supervisor.log(name).read_text()

    def until(self, done: Callable[[list[str]], bool]) -> list[str]:
        """Poll until the events so far satisfy a condition."""
        events: list[str] = []
        end = time.monotonic() + HANG_S
        while not done(events):
            assert time.monotonic() < end, events
            events += self.supervisor.poll()
            time.sleep(0.01)
        return events

    def up(self, name: str, starts: int = 1) -> int:
        """Wait until a component has started; return its pid."""
        self.until(lambda _events: len(re.findall(r"pid \d+\n", self.said(name))) == starts)
        return int(self.said(name).split()[-1])

    def run(self, name: str = "agents") -> int:
        """Start a component that stays up, and wait until it has started; return its pid."""
        self.supervisor.start(self.write(name, UP_FOR_EVER))
        return self.up(name)

    def wait(self, seconds: float) -> list[str]:
        """Let time pass, with two polls a second; return the events."""
        events: list[str] = []
        for _ in range(round(2 * seconds)):
            self.now += 0.5
            events += self.supervisor.poll()
        return events

    def end(self, name: str, pid: int) -> list[str]:
        """Kill a component; return its events."""
        os.kill(pid, signal.SIGKILL)
        return self.until(lambda events: bool(events))


@pytest.fixture
def watched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Watched]:
    room = Watched(tmp_path, monkeypatch)
    try:
        yield room
    finally:
        for one in room.supervisor._components.values():
            one.process.kill()
            one.process.wait()
            one.close()


def test_killed_component_restarts_with_doubling_delay(watched: Watched) -> None:
    watched.supervisor.start(watched.write("agents", UP_FOR_EVER))
    for starts, wait in enumerate(("0.5", "1", "2"), 1):
        pid = watched.up("agents", starts)
        events = watched.end("agents", pid)
        log = watched.supervisor.log("agents")
        assert events == [
            f"agents ended (killed by signal 9): starting it again in {wait} s (log: {log})",
            f"  agents: pid {pid}",
        ]
        watched.now += float(wait) - 0.01
        assert watched.supervisor.poll() == []
        assert watched.said("agents").count("pid ") == starts
        watched.now += 0.01 + 1.2
        events = watched.until(lambda events: bool(events))
        assert events == [f"agents is back after {float(wait) + 1.2:.1f} s"]
    assert re.findall("--- start [0-9]", watched.said("agents")) == [
        "--- start 2",
        "--- start 3",
        "--- start 4",
    ]


def test_process_states_follow_end_restart_and_leaving(watched: Watched) -> None:
    supervisor = watched.supervisor

    def agents() -> SupervisedProcess:
        [one] = supervisor.processes()
        return one

    supervisor.start(watched.write("agents", UP_FOR_EVER))
    assert (agents().state, agents().restarts) == (ProcessState.STARTING, 0)
    pid = watched.up("agents")
    watched.until(lambda _events: agents().state is ProcessState.UP)
    assert (agents().pid, agents().last_exit) == (pid, "")
    watched.now += 3
    supervisor.on_state("agents", "inactive")
    assert (agents().state, agents().since) == (ProcessState.INACTIVE, 103.0)
    supervisor.on_state("agents", "active")
    assert agents().state is ProcessState.UP
    watched.now += 3
    os.kill(pid, signal.SIGKILL)
    watched.until(lambda _events: agents().state is not ProcessState.UP)
    ended = agents()
    assert (ended.state, ended.since) == (ProcessState.ENDED, 106.0)
    assert ended.last_exit == "killed by signal 9"
    watched.now += 0.5
    watched.until(lambda _events: agents().state is ProcessState.UP)
    assert (agents().restarts, agents().since) == (1, 106.5)
    assert agents().pid != pid


def test_silent_component_is_killed_and_restarted(watched: Watched) -> None:
    supervisor = watched.supervisor
    pid = watched.run("agents")
    watched.run("robot")
    supervisor.poll()
    os.kill(pid, signal.SIGSTOP)
    supervisor.on_heartbeat("agents")
    assert watched.wait(9.5) == []
    watched.now += 0.5
    events = watched.until(lambda events: len(events) > 1)
    assert events[0] == HANGS
    assert events[1].startswith("agents ended (killed by signal 9): starting it again in 0.5 s")
    supervisor.on_heartbeat("agents")  # late, from the killed process
    watched.wait(30.0)
    assert watched.up("agents", 2) != pid
    assert "--- start" not in watched.said("robot")


def test_inactive_node_may_be_silent(watched: Watched) -> None:
    supervisor = watched.supervisor
    watched.run()
    supervisor.poll()
    supervisor.on_heartbeat("agents")

    supervisor.on_state("agents", "inactive")
    supervisor.on_heartbeat("agents")  # late, from its active time
    assert supervisor.poll() == ["agents was told to leave: it is inactive"]
    assert watched.wait(30.0) == []
    supervisor.on_state("agents", "active")
    assert supervisor.poll() == ["agents is active again"]

    supervisor.on_heartbeat("agents")
    assert watched.wait(10.0) == [HANGS]


def test_initial_node_states_are_not_reported(watched: Watched) -> None:
    watched.run()
    watched.supervisor.on_state("agents", "active")
    assert watched.supervisor.poll() == []


def test_heartbeat_of_any_node_counts_for_shared_process(watched: Watched) -> None:
    supervisor = watched.supervisor
    shared = replace(watched.write("system", UP_FOR_EVER), parts={"agents": "a", "robot": "b"})
    supervisor.start(shared)
    watched.up("system")
    supervisor.poll()
    for heard in [*["agents", "robot"] * 20, *["somebody else"] * 20]:
        watched.now += 0.5
        supervisor.on_heartbeat(heard)
        events = supervisor.poll()
        assert not events or heard == "somebody else"
    assert events[0] == "system hangs (no heartbeat for 10 s): killing it"


def test_a_heartbeat_before_the_first_poll_counts(watched: Watched) -> None:
    supervisor = watched.supervisor
    supervisor.start(watched.write("agents", UP_FOR_EVER))
    end = time.monotonic() + HANG_S
    while supervisor._components["agents"].last_heartbeat is None:
        assert time.monotonic() < end
        supervisor.on_heartbeat("agents")
        time.sleep(0.01)
    assert watched.wait(10.0) == [HANGS]


def test_short_pause_is_not_reported_as_hang(watched: Watched) -> None:
    watched.run()
    watched.supervisor.on_heartbeat("agents")
    watched.now += 5.0
    assert watched.supervisor.poll() == []
    assert watched.wait(10.0) == [HANGS]


def test_hang_detection_awaits_heartbeat_after_long_pause(watched: Watched) -> None:
    watched.run()
    watched.supervisor.on_heartbeat("agents")
    watched.now += 3600.0
    assert watched.supervisor.poll() == []
    assert watched.wait(50.0) == []
    watched.supervisor.on_heartbeat("agents")
    assert watched.supervisor.poll() == []
    assert watched.wait(10.0) == [HANGS]


def parameters(folder: Path, values: str) -> ParameterFile:
    path = folder / "my.yaml"
    path.write_text(f"/**: {{ros__parameters: {values}}}")
    return read_parameters(path)


def test_parameters_are_judged_after_last_report(watched: Watched, tmp_path: Path) -> None:
    file = parameters(tmp_path, "{pace: 2.0, tick_rate: 9.0, tick_rat: 9.0}")
    robot, agents = (
        replace(watched.write(name, UP % json.dumps({f"/{name}": said})), file=file)
        for name, said in (
            ("robot", {"tick_rate": "", "tick_rat": ""}),
            ("agents", {"pace": "", "tick_rat": "tick_rate"}),
        )
    )
    supervisor = watched.supervisor
    supervisor.start(robot, watched.write("studio", UP_FOR_EVER))
    supervisor.start(agents)
    events = watched.until(lambda events: bool(events))
    assert all(map(supervisor.has_been_up, ("robot", "agents")))
    told = (
        "my.yaml: no node here has a parameter 'tick_rat', so its value counts for nothing; did "
        "you mean 'tick_rate'?"
    )
    assert events == [told]
    assert supervisor.unknown_parameters() == {"** tick_rat": told}
    assert supervisor.poll() == []


def test_report_that_is_no_json_counts_as_up(watched: Watched, tmp_path: Path) -> None:
    file = parameters(tmp_path, "{pace: 2.0}")
    watched.supervisor.start(replace(watched.write("robot", UP_FOR_EVER), file=file))
    watched.until(lambda _events: watched.supervisor.has_been_up("robot"))
    assert watched.supervisor.unknown_parameters() == {}


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
    watched.supervisor.start(watched.write("agents", UP_AND_GONE))
    [one] = watched.supervisor._components.values()
    poll_ready = one.poll_ready

    def polled_just_before(now: float) -> bool:
        up = poll_ready(now)
        (tmp_path / "go").touch()
        one.process.wait(HANG_S)
        return up

    monkeypatch.setattr(one, "poll_ready", polled_just_before)
    [ended] = watched.until(lambda events: bool(events))
    assert "agents ended with exit code 1: starting it again in 0.5 s" in ended


def test_failed_first_start_is_an_error_with_log(watched: Watched) -> None:
    watched.supervisor.start(watched.write("broken", BROKEN))
    with pytest.raises(BtAgentsError, match="broken ended with exit code 1") as caught:
        watched.until(lambda events: bool(events))
    assert "error: scene.yaml is broken" in str(caught.value)


def test_previously_running_component_is_retried_forever(watched: Watched) -> None:
    watched.end("agents", watched.run())
    watched.write("agents", BROKEN)
    for wait in ("1", "2", "4"):
        watched.now += 30.0
        events = watched.until(lambda events: bool(events))
        assert f"agents ended with exit code 1: starting it again in {wait} s" in events[0]
        assert events[1:] == ["  agents: error: scene.yaml is broken"]
    watched.write("agents", UP_FOR_EVER)
    watched.now += 30.0
    [back] = watched.until(lambda events: bool(events))
    assert back == "agents is back after 120.0 s"


def test_startup_time_does_not_count_as_uptime(watched: Watched) -> None:
    watched.supervisor.start(watched.write("agents", UP_FOR_EVER))
    watched.now += 40.0
    pid = watched.up("agents")
    watched.supervisor.poll()
    watched.now += 9.0
    assert "starting it again in 0.5 s" in watched.end("agents", pid)[0]
    watched.now += 5.0
    pid = watched.up("agents", 2)
    watched.supervisor.poll()
    watched.now += 9.0
    assert "starting it again in 1 s" in watched.end("agents", pid)[0]


def test_secret_is_passed_only_to_its_process(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RANKER_KEY", raising=False)
    shown = UP_FOR_EVER.replace('"pid"', 'os.environ.get("RANKER_KEY"), "pid"')
    selector = replace(watched.write("selector", shown), environment={"RANKER_KEY": "s3cret"})
    watched.supervisor.start(selector, watched.write("agents", shown))
    watched.up("selector")
    watched.up("agents")
    assert "s3cret" in watched.said("selector")
    assert "s3cret" not in watched.said("agents")
    assert "s3cret" not in repr(selector)
    assert "s3cret" not in " ".join(selector.command())


def test_end_of_non_restarting_component_is_an_error(watched: Watched) -> None:
    component = watched.write("visitors", UP_FOR_EVER)
    watched.supervisor.start(replace(component, restarts=False))
    pid = watched.up("visitors")
    with pytest.raises(BtAgentsError, match=r"visitors ended .killed by signal 9."):
        watched.end("visitors", pid)


def test_system_continues_without_optional_component(watched: Watched) -> None:
    component = watched.write("studio", BROKEN)
    watched.supervisor.start(replace(component, needed=False))
    for wait in ("0.5", "1"):
        events = watched.until(lambda events: bool(events))
        assert f"studio ended with exit code 1: starting it again in {wait} s" in events[0]
        assert not watched.supervisor.has_been_up("studio")
        watched.now += 30.0
    watched.write("studio", UP_FOR_EVER)
    [back] = watched.until(lambda events: events and "is back" in events[-1])[-1:]
    assert "studio is back" in back
    assert watched.supervisor.has_been_up("studio")


def test_unexpected_exit_is_reported_with_log_tail(tmp_path: Path) -> None:
    supervisor = Supervisor(tmp_path / "logs")
    supervisor.start(Component(name="broken", module="no_such_module"))
    try:
        for one in supervisor._components.values():
            one.process.wait(20)
        assert "broken ended with exit code 1" in supervisor.failure()
        assert "No module named 'no_such_module'" in supervisor.failure()
    finally:
        assert supervisor.stop() == []


def test_parameters_keep_their_types() -> None:
    component = Component(
        name="n",
        module="m",
        parameters={"voice": "off", "path": 'a "b" c', "pace": 1.0, "count": 4, "flag": True},
    )
    assert component.command()[6:] == [
        *("-p", 'voice:="off"'),
        *("-p", 'path:="a \\"b\\" c"'),
        *("-p", "pace:=1.0"),
        *("-p", "count:=4"),
        *("-p", "flag:=true"),
    ]
    assert component.command()[:4] == [sys.executable, "-m", "bt_agents_ros.node_main", "m"]


def test_module_arguments_precede_ros_arguments() -> None:
    command = Component(
        name="n", module="m", arguments=("a b", "c"), parameters={"x": 1}
    ).command()
    module = command.index("m")
    assert command[module : module + 4] == ["m", "a b", "c", "--ros-args"]


def test_explicit_parameters_override_parameter_file() -> None:
    file = ParameterFile(path=Path("/f.yaml"), sections=())
    component = Component(name="n", module="m", parameters={"x": 1}, file=file)
    assert component.command()[6:] == ["--params-file", "/f.yaml", "-p", "x:=1"]


def test_traffic_stays_local_unless_user_overrides() -> None:
    environment: dict[str, str] = {}
    set_discovery(environment)
    whitelisted = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(LOOPBACK_PROFILE),
    }
    assert environment == whitelisted
    assert "<address>127.0.0.1</address>" in LOOPBACK_PROFILE.read_text()
    set_discovery(environment)
    assert environment == whitelisted
    assert discovery_text(environment) == "this machine only"
    own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    set_discovery(own)
    assert own == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(LAN_PROFILE),
    }
    assert discovery_text(own) == "open to everybody on this network"


@pytest.mark.parametrize(
    "own",
    [
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
        {"FASTRTPS_DEFAULT_PROFILES_FILE": "/home/ann/fast.xml"},
    ],
)
def test_discovery_range_keeps_traffic_local_without_whitelist(own: dict[str, str]) -> None:
    environment = dict(own)
    set_discovery(environment)
    assert environment == {**own, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    assert discovery_text(environment) == "this machine only"


UNTIL_ITS_END = """
import signal, sys, time
def end(*_):
    %s
signal.signal(signal.SIGTERM, end)
print("ready", flush=True)
while True:
    time.sleep(1)
"""


@pytest.mark.parametrize(
    ("on_term", "killed"), [("pass", ["one"]), ("time.sleep(2.2); sys.exit(0)", [])]
)
def test_only_unresponsive_process_is_killed_at_shutdown(
    watched: Watched, tmp_path: Path, on_term: str, killed: list[str]
) -> None:
    supervisor = Supervisor(tmp_path / "logs")  # its clock goes on
    supervisor.start(watched.write("one", UNTIL_ITS_END % on_term))
    while "ready" not in supervisor.log("one").read_text():
        assert not supervisor.failure()
    assert supervisor.stop() == killed


def test_every_process_joins_namespace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", "robot1")
    set_discovery(dict(os.environ))
    assert "-r __ns:=/robot1" in " ".join(Component(name="a", module="b").command())


@pytest.mark.parametrize(
    "wrong",
    [
        {"ROS_DOMAIN_ID": "abc"},
        {"ROS_DOMAIN_ID": "999"},
        {"ROS_DOMAIN_ID": "-1"},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "everywhere"},
        {"ROS_NAMESPACE": "my robot"},
        {"ROS_NAMESPACE": "//robot1"},
    ],
)
def test_invalid_ros_environment_is_refused_with_explanation(wrong: dict[str, str]) -> None:
    name, value = next(iter(wrong.items()))
    with pytest.raises(BtAgentsError, match=f"{name} is '{value}', expected"):
        set_discovery(dict(wrong))


def test_overlong_namespace_is_refused() -> None:
    with pytest.raises(BtAgentsError, match="of 100 characters at most"):
        set_discovery({"ROS_NAMESPACE": "/robot" * 20})


def test_unwritable_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BtAgentsError, match="set XDG_STATE_HOME"):
        Supervisor(tmp_path / "file" / "logs").start(Component(name="n", module="m"))


def test_discovery_range_off_is_refused_with_explanation() -> None:
    with pytest.raises(BtAgentsError, match="no process of the system finds another; unset it"):
        set_discovery({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"})
