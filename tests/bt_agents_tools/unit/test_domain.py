# SPDX-License-Identifier: Apache-2.0
"""ROS domains that processes of this machine hold."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.launcher import domain_lock
from bt_agents_tools.launcher.domain_lock import (
    FIRST,
    MOST_JOINING,
    hold_domain,
    holder,
    reserve_domain,
    runtime_folder,
    turn_to_join,
)

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


def test_the_lock_lies_in_the_runtime_folder_of_the_user(private_folder: Path) -> None:
    hold_domain(11, "me")
    [lock] = private_folder.iterdir()
    assert lock.name == "bt-agents-system-11.lock"
    assert lock.stat().st_mode & 0o777 == 0o600


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files, where nobody has logged in."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(domain_lock, "LOGINS", tmp_path / "logins")
    return tmp_path


@pytest.mark.parametrize("named", [{}, {"XDG_RUNTIME_DIR": ""}, {"XDG_RUNTIME_DIR": "relative"}])
def test_without_a_runtime_folder_the_user_has_one_for_each_machine(
    temporary: Path, named: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # What another user has made there keeps nobody out.
    (temporary / f"bt-agents-{os.getuid()}").write_text("")
    state = temporary / "state"
    for machine in ("robot", "a/../b"):
        monkeypatch.setattr("socket.gethostname", lambda name=machine: name)
        found = runtime_folder({**named, "XDG_STATE_HOME": str(state)})
        assert found == state / "bt-agents" / f"locks-{machine.replace('/', '%2F')}"
        assert found.stat().st_mode & 0o777 == 0o700


def test_without_a_home_a_private_temporary_folder_holds_locks(temporary: Path) -> None:
    (temporary / "file").write_text("")
    found = runtime_folder({"XDG_STATE_HOME": str(temporary / "file")})
    assert found == temporary / f"bt-agents-{os.getuid()}"
    assert found.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_others_can_write_or_that_is_a_link_holds_no_lock(temporary: Path) -> None:
    (temporary / "file").write_text("")
    homeless = {"XDG_STATE_HOME": str(temporary / "file")}
    fallback = temporary / f"bt-agents-{os.getuid()}"
    fallback.mkdir()
    fallback.chmod(0o777)
    with pytest.raises(BtAgentsError, match="others can write there; set XDG_RUNTIME_DIR"):
        runtime_folder({**homeless, "XDG_RUNTIME_DIR": str(fallback)})
    fallback.rmdir()
    (temporary / "elsewhere").mkdir()
    fallback.symlink_to(temporary / "elsewhere")
    with pytest.raises(BtAgentsError, match="others can write there; set XDG_RUNTIME_DIR"):
        runtime_folder(homeless)


@pytest.mark.parametrize("participant", [0, 7, 119])
def test_a_domain_that_somebody_uses_without_a_lock_is_not_reserved(participant: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        for first in range(FIRST, FIRST + 60):
            try:
                other.bind(("127.0.0.1", 7410 + 250 * first + 2 * participant))
            except OSError:
                continue
            break
        assert reserve_domain() != first


def test_so_many_commands_join_a_domain_at_once_and_no_more() -> None:
    with ExitStack() as joining:
        for _ in range(MOST_JOINING):
            joining.enter_context(turn_to_join(7))
        begin = time.monotonic()
        with turn_to_join(7, limit_s=0.2):
            assert time.monotonic() - begin >= 0.2, "it waits for its turn, and not for ever"
        begin = time.monotonic()
        with turn_to_join(8, limit_s=60.0):
            assert time.monotonic() - begin < 30.0, "another domain has turns of its own"
    with turn_to_join(7, limit_s=60.0):
        pass
