# SPDX-License-Identifier: Apache-2.0
"""Every command ends in words, whatever terminal, disk and home it is given."""

from __future__ import annotations

import errno
import fcntl
import os
import pty
import re
import resource
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from bt_agents_tools.cli.main import all_commands
from programs import HANG_S, ROOT, alive, children
from tree_harness import TREES

pytestmark = pytest.mark.e2e

GUIDE = str(TREES / "agents" / "attentive_guide.yaml")

ARGUMENTS: dict[str, tuple[str, ...]] = {
    "allow": ("attentive_guide",),
    "award": ("attentive_guide", "age=4"),
    "check": (str(TREES),),
    "demo": ("--no-voice",),
    "experiment": ("run", str(ROOT / "experiments" / "1"), "--rounds", "3"),
    "explain": ("timeout",),
    "export": ("groot", GUIDE),
    "feedback": ("positive",),
    "fmt": ("--check", str(TREES)),
    "import": ("groot", "nothing.xml"),
    "new": ("ann",),
    "pin": ("attentive_guide",),
    "preset": ("show", "morning"),
    "preview": ("age=4",),
    "rehearse": (GUIDE,),
    "roll-back": ("attentive_guide",),
    "schema": (str(TREES),),
    "sense": ("mood=2",),
    "show": (GUIDE,),
    "test": (str(TREES),),
    "trigger": ("age=4",),
    "up": (str(TREES), "--no-voice"),
    "versions": ("attentive_guide",),
    "veto": ("attentive_guide",),
    "visit": (str(TREES / "scripts" / "airport_morning.yaml"),),
}
"""What a command is given; nothing where it needs nothing."""

HOMELESS = """
import pwd

def unknown(*_):
    raise KeyError("no such user")

pwd.getpwuid = pwd.getpwnam = unknown
from bt_agents_tools.cli import main
main()
"""
"""The command line for a user whom the system does not know."""

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
NO_SYSTEM = {"ROS_DOMAIN_ID": "none"}
"""A command to a running system is refused at once."""

SWEEP = ("experiment", "sweep", "told", "--runs", "2", "--rounds", "3", "--processes", "1")

SOON_S = 5.0
"""One second, on a machine that has much else to do [s]."""


def environment(**more: str) -> dict[str, str]:
    """Return the environment without a home."""
    kept = {k: v for k, v in os.environ.items() if k != "HOME" and not k.startswith("XDG_")}
    return {**kept, **more}


def started(*words: str, **more: Any) -> subprocess.Popen[bytes]:
    """Start a command without a home."""
    given = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(
        [sys.executable, "-c", HOMELESS, *words],
        env=environment(**NO_SYSTEM, **more.pop("env", {})),
        **{**given, **more},
    )


def ended(process: subprocess.Popen[bytes]) -> tuple[int, str, str]:
    """Return exit code, output and errors of a command, which has no traceback."""
    try:
        out, err = process.communicate(timeout=HANG_S)
    finally:
        process.kill()
    said = (out or b"").decode("utf-8"), (err or b"").decode("utf-8")
    for text in said:
        assert "Traceback" not in text
        assert "Exception ignored" not in text
    code = process.returncode
    # As a shell tells it: modules that are being loaded are ended by the signal itself.
    return (code if code >= 0 else 128 - code), *said


def closed(*descriptors: int) -> Callable[[], None]:
    def close() -> None:
        for one in descriptors:
            os.close(one)

    return close


@pytest.mark.parametrize("name", sorted(all_commands()))
def test_every_command_ends_in_words_without_home_in_ascii_and_with_closed_streams(
    name: str, tmp_path: Path
) -> None:
    words = (name, *ARGUMENTS.get(name, ()))
    folders = [tmp_path / place for place in ("ascii", "closed")]
    for folder in folders:
        folder.mkdir()
    plain = started(*words, cwd=folders[0], env=ASCII)
    mute = started(*words, cwd=folders[1], stdin=None, preexec_fn=closed(0, 1))
    code, out, err = ended(plain)
    assert (out + err).isascii()
    assert code in (0, 1), err
    assert out or err
    same, _, _ = ended(mute)
    assert same == code


@pytest.mark.parametrize("name", sorted(all_commands()))
def test_every_command_ends_in_words_when_its_output_is_full_or_nobody_reads_it(
    name: str, tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with open("/dev/full", "wb") as full:
        crowded = started(name, "--help", cwd=tmp_path, stdout=full)
    unread = started(name, "--help", cwd=tmp_path, stdout=writer)
    os.close(writer)
    code, _, err = ended(crowded)
    assert (code, err) == (
        1,
        "error: standard output: No space left on device; make room, or write to another place\n",
    )
    assert ended(unread) == (128 + signal.SIGPIPE, "", "")


@pytest.mark.parametrize(
    "words",
    [
        ("new", "ann"),
        ("schema", str(TREES), "--output", "schemas"),
        ("show", GUIDE, "--svg", "picture.svg"),
        ("test", str(TREES), "--junit", "results.xml"),
        ("export", "groot", GUIDE, "--out", "guide.xml"),
        ("experiment", "run", str(ROOT / "experiments" / "1"), "--rounds", "3", "--csv", "r.csv"),
        (*SWEEP, "--output", "figures"),
    ],
    ids=lambda words: " ".join(words[:2]) if words[0] == "experiment" else words[0],
)
def test_a_file_for_which_there_is_no_room_is_named(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    process = started(
        *words, cwd=tmp_path, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    )
    code, _, err = ended(process)
    assert code == 1
    assert os.strerror(errno.EFBIG) in err
    assert words[-1] in err or "ann" in err or "schemas" in err


def test_a_closed_output_is_not_the_next_file_that_is_opened(tmp_path: Path) -> None:
    process = started("new", "ann", cwd=tmp_path, stdin=None, preexec_fn=closed(0, 1, 2))
    assert ended(process)[0] == 0
    written = (tmp_path / "trees" / "agents" / "ann.yaml").read_text(encoding="utf-8")
    assert "agent: ann" in written
    assert "check" not in written.splitlines()[-1]


def test_who_has_no_home_is_asked_for_a_place(tmp_path: Path) -> None:
    assert ended(started("up", str(TREES), cwd=tmp_path)) == (
        1,
        "",
        "error: no place for logs and learned profiles: neither HOME nor XDG_STATE_HOME is set; "
        "set XDG_STATE_HOME to a folder that can be written\n",
    )


def wait_for(done: Callable[[], bool]) -> None:
    end = time.monotonic() + HANG_S
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("words", "workers"),
    [
        (("sweep", "told", "--processes", "2"), 3),
        (("sweep", "told", "--processes", "1"), 0),
        (("run", str(ROOT / "experiments" / "1"), "--ros", "--rounds", "5000"), 4),
        (("plot", "3", "--output", "figures"), 0),
    ],
    ids=lambda of: " ".join(of) if isinstance(of, tuple) and len(of) == 4 else None,
)
@pytest.mark.parametrize("whom", ["everybody", "the command"])
def test_ctrl_c_ends_long_work_and_its_workers_soon(
    words: tuple[str, ...], workers: int, whom: str, tmp_path: Path
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "bt_agents_tools.cli", "experiment", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "XDG_STATE_HOME": str(tmp_path)},
        cwd=tmp_path,
        start_new_session=True,
    )
    try:
        wait_for(lambda: len(children(process.pid)) >= workers and is_at_work(process.pid))
        mine = children(process.pid)
        start = time.monotonic()
        send = os.killpg if whom == "everybody" else os.kill
        send(process.pid, signal.SIGINT)
        code, out, err = ended(process)
        took = time.monotonic() - start
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert code == 128 + signal.SIGINT, out + err
    assert took < SOON_S
    wait_for(lambda: not any(map(alive, mine)))


def is_at_work(pid: int) -> bool:
    """Return whether a process handles SIGINT by itself, and has loaded what it computes with."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = int(status.partition("SigCgt:")[2].split()[0], 16)
    handles = bool(caught >> (signal.SIGINT - 1) & 1)
    return handles and "_multiarray_umath" in Path(f"/proc/{pid}/maps").read_text()


def test_a_table_fits_a_narrow_terminal_and_loses_nothing(tmp_path: Path) -> None:
    into_pipe, aside = started(*SWEEP, cwd=tmp_path), started(*SWEEP, "--csv", cwd=tmp_path)
    controller, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 60, 0, 0))
    narrow = started(*SWEEP, cwd=tmp_path, stdout=terminal, env={"TERM": "dumb"})
    os.close(terminal)
    shown = b""
    with suppress(OSError):
        while chunk := os.read(controller, 4096):
            shown += chunk
    os.close(controller)
    assert ended(narrow)[0] == 0
    lines = re.sub(r"\x1b\[\d*m", "", shown.decode()).splitlines()
    # Title and summary are prose, which the terminal wraps.
    assert max(map(len, lines[1:-1])) <= 60
    _, piped, _ = ended(into_pipe)
    _, table, _ = ended(aside)
    header, *rows = table.splitlines()
    assert header.startswith("strategy,update,wrong_share,")
    assert len(piped.splitlines()) == len(rows) + 3
    seen = " ".join(" ".join(lines).split())
    for row in rows:
        assert row.split(",")[0] in seen
