# SPDX-License-Identifier: Apache-2.0
"""Start and end of a node: signals during its start, and a middleware that hangs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from checkout import ROOT

LIMIT_S = 60.0

PROGRAM = """
import os, signal, sys, time
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.parameters import make_from_parameters
from bt_agents_ros.spinner import run

class Slow(BaseNode):
    def __init__(self):
        super().__init__("slow")
        for _ in range({inside}):
            os.kill(os.getpid(), signal.{signal})
        print("made")

    def destroy_node(self):
        super().destroy_node()
        print("closed")

def make():
    for _ in range({before}):
        os.kill(os.getpid(), signal.{signal})
    return make_from_parameters("slow", (), lambda _: Slow())

sys.exit(run(make))
"""

HANGING = """
import ctypes, os, signal, sys
from bt_agents_core.errors import NodeMustEnd
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.spinner import run
from bt_agents_ros.workarounds import bounded_end

class Hanging(BaseNode):
    def __init__(self):
        super().__init__("hanging")
        self.create_timer(0.01, self.end)

    def end(self):
        {end}

    def destroy_node(self):
        ctypes.PyDLL(None).pause()  # with the GIL, as rclpy ends a participant

bounded_end.END_LIMIT_S = 1
sys.exit(run(Hanging))
"""

HANGING_START = """
import ctypes
from bt_agents_ros.workarounds import bounded_end

bounded_end._NODES_LIMIT_S = 0.5
with bounded_end.ending_in_time():
    ctypes.PyDLL(None).pause()
"""


# Further nodes on the domain are of earlier tests.
READING = """
import rclpy
from std_msgs.msg import Empty
from bt_agents_ros.parameters import TREES, make_from_parameters
names = lambda node: sorted({"_reader", "reader", "late"} & {*node.get_node_names()})
def make(values):
    node = rclpy.create_node("reader")
    node.create_publisher(Empty, "told", 1)
    print(values["trees"], *names(node))
    return node

rclpy.init(args=["--ros-args", "-r", "__node:=late", "-p", "late:trees:=here"])
node = make_from_parameters("reader", (TREES,), make)
[told] = node.get_publishers_info_by_topic("told")
print(told.node_name, *names(node))
"""


def ended(number: signal.Signals, *, before: int = 0, inside: int = 0) -> tuple[int, str]:
    """Run a node that signals itself; return its exit code and output."""
    return printed(PROGRAM.format(signal=number.name, before=before, inside=inside))


def printed(program: str) -> tuple[int, str]:
    """Run a program; return its exit code and output."""
    process = subprocess.run(
        [sys.executable, "-c", program],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LIMIT_S,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    return process.returncode, process.stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_during_construction_closes_finished_node(number: signal.Signals) -> None:
    assert ended(number, inside=1) == (0, "made\nclosed\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_before_reading_files_prevents_construction(number: signal.Signals) -> None:
    assert ended(number, before=1) == (0, "")


def test_second_signal_ends_construction_immediately() -> None:
    assert ended(signal.SIGTERM, inside=2) == (-signal.SIGTERM, "")


@pytest.mark.parametrize(
    ("end", "outcome"),
    [
        ("os.kill(os.getpid(), signal.SIGTERM)", (0, "")),
        ("raise NodeMustEnd('it must')", (1, "error: it must\n")),
    ],
)
def test_node_exit_code_survives_hanging_middleware(end: str, outcome: tuple[int, str]) -> None:
    assert printed(HANGING.format(end=end)) == outcome


def test_unreadable_ros_argument_is_one_error() -> None:
    lines = printed(
        "from bt_agents_ros.spinner import run\n"
        "raise SystemExit(run(None, ['--ros-args', '--params-file', '/nowhere.yaml']))"
    )
    assert lines[0] == 1
    assert (
        "error: ROS cannot start: failed to initialize rcl: Couldn't parse params file" in lines[1]
    )
    assert "Traceback" not in lines[1]


@pytest.mark.parametrize("arguments", [["status"], ["studio", str(ROOT / "trees")]])
def test_missing_keystore_is_one_error(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("ENABLE", "true"), ("STRATEGY", "Enforce"), ("KEYSTORE", "/nowhere")):
        monkeypatch.setenv(f"ROS_SECURITY_{name}", value)
    start = f"import sys; from bt_agents_tools.cli import main; sys.argv[1:] = {arguments}; main()"
    code, text = printed(start)
    assert code == 1
    assert "error: ROS cannot start: failed to initialize rcl: SECURITY ERROR" in text
    assert "Traceback" not in text


def test_start_keeps_the_participant_of_its_process() -> None:
    assert printed(READING) == (0, "here _reader late\nlate late\n")


def test_hanging_start_ends_with_traceback() -> None:
    code, text = printed(HANGING_START)
    assert code == 1
    assert '"<string>", line 7 in <module>' in text
