# SPDX-License-Identifier: Apache-2.0
"""ROS domains reserved by processes of this machine."""

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


def test_domain_is_held_until_its_process_dies() -> None:
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


def test_new_holder_replaces_text_of_earlier_holder(private_folder: Path) -> None:
    lock = private_folder / "bt-agents-system-9.lock"
    lock.write_text("x" * 1000)
    hold_domain(9, "me")
    assert lock.read_text() == "me\n"


def test_symlinked_lock_file_is_not_touched(private_folder: Path) -> None:
    precious = private_folder / "precious"
    precious.write_text("mine")
    os.symlink(precious, private_folder / "bt-agents-system-5.lock")
    with pytest.raises(BtAgentsError, match=r"bt-agents-system-5\.lock cannot be opened"):
        hold_domain(5, "me")
    assert precious.read_text() == "mine"


def test_lock_lives_in_user_runtime_folder(private_folder: Path) -> None:
    hold_domain(11, "me")
    [lock] = private_folder.iterdir()
    assert lock.name == "bt-agents-system-11.lock"
    assert lock.stat().st_mode & 0o777 == 0o600


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


def test_missing_home_falls_back_to_private_temporary_folder(temporary: Path) -> None:
    (temporary / "file").write_text("")
    found = runtime_folder({"XDG_STATE_HOME": str(temporary / "file")})
    assert found == temporary / f"bt-agents-{os.getuid()}"
    assert found.stat().st_mode & 0o777 == 0o700


def test_shared_or_symlinked_folder_holds_no_lock(temporary: Path) -> None:
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
def test_domain_used_without_lock_is_not_reserved(participant: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        for first in range(FIRST, FIRST + 60):
            try:
                other.bind(("127.0.0.1", 7410 + 250 * first + 2 * participant))
            except OSError:
                continue
            break
        assert reserve_domain() != first


def test_concurrent_joins_per_domain_are_limited() -> None:
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
