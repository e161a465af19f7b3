# SPDX-License-Identifier: Apache-2.0
"""ROS domains that processes of this machine hold."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.launcher.domain_lock import hold_domain, holder

HOLD = """
import sys
from bt_agents_tools.launcher.domain_lock import hold_domain
hold_domain(7, "'bt-agents up' of /trees (process 1)")
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def private_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    return tmp_path


def test_a_domain_is_held_by_one_process_until_that_is_killed() -> None:
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        assert other.stdout is not None
        assert other.stdin is not None
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
    finally:
        other.kill()
        other.wait()
        other.stdout.close()
        other.stdin.close()
    assert holder(7) == ""
    hold_domain(7, "me")


def test_the_words_of_an_earlier_holder_are_gone(private_folder: Path) -> None:
    lock = private_folder / "bt-agents-system-9.lock"
    lock.write_text("x" * 1000)
    hold_domain(9, "me")
    assert lock.read_text() == "me\n"


def test_a_lock_file_that_is_a_link_to_something_else_is_not_touched(private_folder: Path) -> None:
    precious = private_folder / "precious"
    precious.write_text("mine")
    os.symlink(precious, private_folder / "bt-agents-system-5.lock")
    with pytest.raises(BtAgentsError, match=r"bt-agents-system-5\.lock cannot be opened"):
        hold_domain(5, "me")
    assert precious.read_text() == "mine"
