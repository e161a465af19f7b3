# SPDX-License-Identifier: Apache-2.0
"""Signals while a node is being made: it is closed as a whole, and soon."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.ros

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


def ended(number: signal.Signals, *, before: int = 0, inside: int = 0) -> tuple[int, str]:
    """Run a node that signals itself; return its exit code and what it has printed."""
    process = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(signal=number.name, before=before, inside=inside)],
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
