# SPDX-License-Identifier: Apache-2.0
"""Every command ends with a message on any terminal, disk and home."""

from __future__ import annotations

import errno
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from bt_agents_tools.cli.main import all_commands
from command_server import CommandServer, Ended, command_server
from programs import HANG_S, ROOT, alive, children, wait_for
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
    "fleet": ("status",),
    "forget": ("anna",),
    "import": ("groot", "nothing.xml"),
    "new": ("ann",),
    "pin": ("attentive_guide",),
    "preset": ("show", "morning"),
    "preview": ("age=4",),
    "record": ("start",),
    "rehearse": (GUIDE,),
    "schema": (str(TREES),),
    "security": (str(TREES), "--output", "policy.xml"),
    "sense": ("mood=2",),
    "show": (GUIDE,),
    "test": (str(TREES),),
    "trigger": ("age=4",),
    "up": (str(TREES), "--no-voice"),
    "veto": ("attentive_guide",),
    "visit": (str(TREES / "scripts" / "airport_morning.yaml"),),
}
"""Required arguments of a command; none by default."""

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
NO_SYSTEM = {"ROS_DOMAIN_ID": "none"}
"""Refuses commands to a running system at once."""

SWEEP = ("experiment", "sweep", "told", "--runs", "2", "--rounds", "3", "--processes", "1")

SOON_S = 5.0
"""One second, on a busy machine [s]."""


@pytest.fixture(scope="module")
def commands() -> Iterator[CommandServer]:
    """All commands without a home, in ASCII, on the simplest terminal."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("HOME", "XDG_"))}
    # COLUMNS may come from a wider terminal.
    more = {"TERM": "dumb", "COLUMNS": "80"}
    with command_server({**kept, **ASCII, **NO_SYSTEM, **more}, without_home=True) as server:
        yield server


def assert_in_words(ended: Ended) -> None:
    for text in (ended.out, ended.err):
        assert "Traceback" not in text
        assert "Exception ignored" not in text


@pytest.mark.parametrize("name", sorted(all_commands()))
def test_commands_end_cleanly_without_home_or_open_streams(
    name: str, commands: CommandServer, tmp_path: Path
) -> None:
    words = (name, *ARGUMENTS.get(name, ()))
    folders = [tmp_path / place for place in ("ascii", "closed")]
    for folder in folders:
        folder.mkdir()
    plain = commands.run(*words, folder=folders[0])
    mute = commands.run(*words, folder=folders[1], closed=(0, 1))
    assert_in_words(plain)
    assert_in_words(mute)
    assert (plain.out + plain.err).isascii()
    assert plain.code in (0, 1), plain.err
    assert plain.out or plain.err
    assert mute.code == plain.code


@pytest.mark.parametrize("name", sorted(all_commands()))
def test_commands_end_cleanly_on_full_or_closed_output(
    name: str, commands: CommandServer, tmp_path: Path
) -> None:
    with open("/dev/full", "wb") as full:
        crowded = commands.run(name, "--help", folder=tmp_path, stdout=full.fileno())
    assert (crowded.code, crowded.err) == (
        1,
        "error: standard output: No space left on device; make room, or write to another place\n",
    )
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "wb"):
        unread = commands.run(name, "--help", folder=tmp_path, stdout=writer)
    assert unread == Ended(code=128 + signal.SIGPIPE, out="", err="")


@pytest.mark.parametrize(
    "words",
    [
        ("new", "ann"),
        ("schema", str(TREES), "--output", "schemas"),
        ("test", str(TREES), "--junit", "results.xml"),
        ("export", "groot", GUIDE, "--out", "guide.xml"),
        ("experiment", "run", str(ROOT / "experiments" / "1"), "--rounds", "3", "--out", "r.csv"),
        (*SWEEP, "--output", "figures"),
    ],
    ids=lambda words: " ".join(words[:2]) if words[0] == "experiment" else words[0],
)
def test_file_without_disk_space_is_named(
    words: tuple[str, ...], commands: CommandServer, tmp_path: Path
) -> None:
    ended = commands.run(*words, folder=tmp_path, largest_file=0)
    assert_in_words(ended)
    assert ended.code == 1
    assert os.strerror(errno.EFBIG) in ended.err
    assert words[-1] in ended.err or "ann" in ended.err or "schemas" in ended.err


def test_closed_output_descriptor_is_not_reused_for_files(tmp_path: Path) -> None:
    command = shlex.quote(str(Path(sys.executable).with_name("bt-agents")))
    new = f"exec {command} new ann <&- >&- 2>&-"
    assert subprocess.run(["sh", "-c", new], cwd=tmp_path, timeout=HANG_S).returncode == 0
    written = (tmp_path / "trees" / "agents" / "ann.yaml").read_text(encoding="utf-8")
    assert "agent: ann" in written
    assert "check" not in written.splitlines()[-1]


def test_up_without_home_asks_for_state_folder(commands: CommandServer, tmp_path: Path) -> None:
    assert commands.run("up", str(TREES), folder=tmp_path) == Ended(
        code=1,
        out="",
        err="error: no place for logs and learned profiles: neither HOME nor XDG_STATE_HOME is "
        "set; set XDG_STATE_HOME to a folder that can be written\n",
    )


@contextmanager
def started(*words: str, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a command in its own process group; kill the group and close everything at the end."""
    with subprocess.Popen(
        [sys.executable, "-m", "bt_agents_tools.cli", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "XDG_STATE_HOME": str(folder)},
        cwd=folder,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


@pytest.mark.parametrize(
    ("words", "workers", "send"),
    [
        (("sweep", "told", "--processes", "2"), 3, os.killpg),
        (("sweep", "told", "--processes", "2"), 3, os.kill),
        (("sweep", "told", "--processes", "1"), 0, os.kill),
        (("run", str(ROOT / "experiments" / "1"), "--ros", "--rounds", "5000"), 4, os.killpg),
        (("plot", "3", "--output", "figures"), 0, os.kill),
    ],
    ids=[
        "sweep with workers, everybody",
        "sweep with workers, the command",
        "sweep",
        "run --ros, everybody",
        "plot",
    ],
)
def test_ctrl_c_quickly_ends_long_work_and_workers(
    words: tuple[str, ...], workers: int, send: Callable[[int, int], None], tmp_path: Path
) -> None:
    with started("experiment", *words, folder=tmp_path) as process:
        wait_for(lambda: len(children(process.pid)) >= workers and is_at_work(process.pid))
        mine = children(process.pid)
        start = time.monotonic()
        send(process.pid, signal.SIGINT)
        out, err = (text.decode() for text in process.communicate(timeout=HANG_S))
        took = time.monotonic() - start
    assert "Traceback" not in out + err
    assert "Exception ignored" not in out + err
    # As a shell reports it: the signal itself ends a process that is loading modules.
    assert abs(process.returncode) % 128 == signal.SIGINT, out + err
    assert took < SOON_S
    wait_for(lambda: not any(map(alive, mine)))


def test_killed_worker_ends_sweep(tmp_path: Path) -> None:
    def workers() -> list[int]:
        every = children(sweep.pid)
        return [pid for pid in every if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]

    with started("experiment", "sweep", "told", "--processes", "2", folder=tmp_path) as sweep:
        wait_for(lambda: len(workers()) == 2)
        killed, other = workers()
        os.kill(killed, signal.SIGKILL)
        _, err = (text.decode() for text in sweep.communicate(timeout=HANG_S))
    assert "error: a process of the sweep ended early; with little memory, take fewer" in err
    assert "Traceback" not in err
    assert sweep.returncode == 1
    wait_for(lambda: not alive(other))


@pytest.mark.parametrize("home", ["{folder}", ""])
def test_commands_write_no_log_file_in_home(
    home: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    runtime = tmp_path_factory.mktemp("runtime")
    done = subprocess.run(
        [sys.executable, "-m", "bt_agents_tools.cli", "sense", "age=3"],
        env={**os.environ, "HOME": home.format(folder=tmp_path), "XDG_RUNTIME_DIR": str(runtime)},
        stderr=subprocess.PIPE,
        timeout=HANG_S,
        check=False,
    )
    assert b"Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


_SWALLOWED = """
import signal, sys, time
from bt_agents_ros.signals import interruptible
try:
    with interruptible():
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException:
            pass
        time.sleep(1000.0)
except KeyboardInterrupt:
    sys.exit(7)
"""
_CAUGHT = """
import signal, time
from bt_agents_ros.signals import end_silently, interruptible
with interruptible():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        end_silently()
    time.sleep(0.2)
"""


@pytest.mark.parametrize(
    ("program", "code"), [(_SWALLOWED, 7), (_CAUGHT, 0)], ids=["swallowed", "caught"]
)
def test_only_swallowed_ctrl_c_is_raised_again(program: str, code: int) -> None:
    done = subprocess.run([sys.executable, "-c", program], timeout=HANG_S, check=False)
    assert done.returncode == code


def is_at_work(pid: int) -> bool:
    """Return whether a process handles SIGINT itself, and has loaded its numerical modules."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = int(status.partition("SigCgt:")[2].split()[0], 16)
    handles = bool(caught >> (signal.SIGINT - 1) & 1)
    return handles and "_multiarray_umath" in Path(f"/proc/{pid}/maps").read_text()
