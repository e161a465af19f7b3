# SPDX-License-Identifier: Apache-2.0
"""Fork server: a forked process does what was requested, and is a normal child."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bt_agents_tools.launcher.fork_server import ForkedProcess, ForkServer
from bt_agents_tools.launcher.log_files import LogFile, make_log_folder
from bt_agents_tools.launcher.supervisor import Component, spawn
from programs import HANG_S, alive, wait_for

MODULE = """
import json, os, sys, time
LOADED_BY = os.getpid()
def main():
    os.write(int(os.environ["BT_AGENTS_READY"]), b"up")
    print(json.dumps({
        "loaded_here": LOADED_BY == os.getpid(), "arguments": sys.argv[1:], "parent": os.getppid(),
        "session": os.getsid(0) == os.getpid(), "variable": os.environ.get("VARIABLE"),
        "path": "PATH" in os.environ, "input": sys.stdin.read(),
        "descriptors": sorted(int(name) for name in os.listdir("/proc/self/fd")),
        "shown": open("/proc/self/cmdline").read().rstrip(chr(0)).split(chr(0)),
    }), flush=True)
    print("to the other stream", file=sys.stderr, flush=True)
    while os.environ.get("STAYS"):
        time.sleep(0.01)
    return 3
"""


class Forks:
    """A fork server, and a log of the output of its processes."""

    def __init__(self, folder: Path) -> None:
        (folder / "loaded_before.py").write_text(MODULE)
        make_log_folder(folder / "logs")
        self.log = LogFile(folder / "logs" / "one.log")
        self.server = ForkServer(["no_such_module", "loaded_before"])

    def start(self, **environment: str) -> ForkedProcess:
        component = Component(
            name="one", module="loaded_before", parameters={"a": "b"}, environment=environment
        )
        process, ready = spawn(component, self.log, 1, self.server)
        os.set_blocking(ready, True)
        assert os.read(ready, 8) == b"up"
        os.close(ready)
        assert isinstance(process, ForkedProcess)
        return process

    def said(self) -> str:
        return self.log.path.read_text()


@pytest.fixture
def forks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Forks]:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    subject = Forks(tmp_path)
    yield subject
    subject.server.close()


def test_forked_process_inherits_only_requested_state(forks: Forks) -> None:
    process = forks.start(VARIABLE="value")
    wait_for(lambda: process.poll() is not None)
    found = json.loads(forks.said().splitlines()[0])

    assert process.returncode == 3
    assert not found["loaded_here"]
    assert found["arguments"] == ["--ros-args", "--disable-external-lib-logs", "-p", 'a:="b"']
    assert found["parent"] == os.getpid()
    assert (found["session"], found["path"], found["input"]) == (True, True, "")
    assert found["variable"] == "value"
    assert len(found["descriptors"]) == 5, "three streams, the pipe, the listed folder"
    assert found["shown"][1:4] == ["-m", "bt_agents_ros.node_main", "loaded_before"]
    assert "to the other stream" in forks.said()
    assert os.environ.get("VARIABLE") is None


def test_forked_process_handles_signals_and_outlives_server(forks: Forks) -> None:
    asked, killed = forks.start(STAYS="yes"), forks.start(STAYS="yes")
    forks.server.close()
    assert (asked.poll(), killed.poll()) == (None, None)
    asked.send_signal(signal.SIGTERM)
    killed.kill()
    assert (asked.wait(), killed.wait()) == (-signal.SIGTERM, -signal.SIGKILL)
    killed.kill()  # it has ended, and another process may have its number


def test_process_loads_own_modules_without_server(forks: Forks) -> None:
    forks.server.close()
    component = Component(name="one", module="loaded_before")
    process, ready = spawn(component, forks.log, 1, forks.server)
    assert isinstance(process, subprocess.Popen)
    assert process.wait(HANG_S) == 3
    os.close(ready)
    assert json.loads(forks.said().splitlines()[0])["loaded_here"]


def test_server_ends_with_its_parent() -> None:
    program = (
        "import os, time\n"
        "from bt_agents_tools.launcher.fork_server import ForkServer\n"
        "print(ForkServer([])._process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    owner = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert owner.stdout is not None
    with owner.stdout:
        server = int(owner.stdout.readline())
        assert alive(server)
        owner.kill()
        owner.wait(HANG_S)
    wait_for(lambda: not alive(server))
