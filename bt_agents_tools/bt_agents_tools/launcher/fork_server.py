# SPDX-License-Identifier: Apache-2.0
"""Server that forks the processes of nodes after loading their modules.

Loading takes most of the start-up time of a node, and loaded modules take most of its memory,
which forked processes share. A forked process becomes a child of the requesting process: the
server's own fork ends at once, and the kernel gives its child to the nearest ancestor that adopts
orphans.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from fcntl import F_DUPFD, fcntl
from pathlib import Path
from typing import Any, NoReturn

from bt_agents_core.gc_pause import gc_paused
from bt_agents_ros import node_main
from bt_agents_ros.signals import sigint_blocked

ANSWER_S = 10.0
"""Longest time until a process is forked, including the rest of the loading [s]."""

_ADOPTED_S = 5.0
_POLL_S = 0.001

_REQUEST_BYTES = 1 << 18
_MOST_DESCRIPTORS = 16
_PR_SET_CHILD_SUBREAPER = 36
_PR_GET_CHILD_SUBREAPER = 37

_ROOM = "-" * 3000
"""Last argument of the server; command lines of forked processes overwrite it."""

_ARGUMENTS_START, _ARGUMENTS_END = 45, 46
"""Fields of ``/proc/self/stat`` after the name, as in :manpage:`proc(5)`."""


class ForkedProcess:
    """Child process, with the methods of ``subprocess.Popen`` that a supervisor needs.

    Attributes:
        returncode: As in ``Popen``; None while the process runs.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal; None while it runs."""
        self._wait(os.WNOHANG)
        return self.returncode

    def wait(self) -> int:
        """Wait for the end of the process; return the exit code."""
        self._wait(0)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End the process at once."""
        self.send_signal(signal.SIGKILL)

    def _wait(self, options: int) -> None:
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, options)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)


class ForkServer:
    """Client of the server, which starts to load modules at once.

    Args:
        modules: Modules that the processes run, in the order of their starts.
    """

    def __init__(self, modules: Iterable[str]) -> None:
        self._connection, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._connection.settimeout(ANSWER_S)
        with closing(its), sigint_blocked():
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(its.fileno()), _ROOM],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                start_new_session=True,
                pass_fds=(its.fileno(),),
            )
        with suppress(OSError):  # one that has ended answers no request, either
            self._connection.send(json.dumps([os.getpid(), *modules]).encode())

    def start(
        self,
        command: Sequence[str],
        environment: Mapping[str, str],
        output: int,
        descriptors: Sequence[int],
    ) -> ForkedProcess:
        """Start a process in its own session.

        Args:
            command: ``PYTHON -m bt_agents_ros.node_main MODULE …``.
            environment: Its environment.
            output: Descriptor of its standard output and error; its standard input is empty.
            descriptors: Other descriptors that it inherits under the same numbers.

        Raises:
            OSError: The server has ended, does not answer, or takes no request of that size. The
                server is then closed.
        """
        request = {"command": command, "environment": environment, "descriptors": descriptors}
        message = json.dumps(request).encode()
        try:
            with _adopting():
                socket.send_fds(self._connection, [message], [output, *descriptors])
                answer = self._connection.recv(32)
            if not answer:
                raise OSError("the fork server has ended")
        except OSError:
            self.close()
            raise
        return ForkedProcess(int(answer))

    def close(self) -> None:
        """End the server, which has no state to save; forked processes continue."""
        self._connection.close()
        self._process.kill()
        self._process.wait()


@contextmanager
def _adopting() -> Iterator[None]:
    """Let this process adopt orphaned descendants within this block.

    Raises:
        OSError: The kernel does not support it.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    before = ctypes.c_int()
    if libc.prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(before), 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "no orphans can be adopted")
    libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        libc.prctl(_PR_SET_CHILD_SUBREAPER, before.value, 0, 0, 0)


def _serve(connection: socket.socket) -> list[str]:
    """Load modules, then fork for each request; return the command in a forked process."""
    parent, *modules = json.loads(connection.recv(_REQUEST_BYTES))
    with gc_paused():
        for module in modules:
            # The process that runs the module reports its error.
            with suppress(Exception):
                importlib.import_module(module)
    gc.freeze()
    # Waiting threads of libraries do not exist in the fork.
    warnings.filterwarnings("ignore", "This process.* is multi-threaded", DeprecationWarning)
    while True:
        text, descriptors, _, _ = socket.recv_fds(connection, _REQUEST_BYTES, _MOST_DESCRIPTORS)
        if not text:
            sys.exit()
        middle = os.fork()
        if not middle:
            if os.fork():
                os._exit(0)
            return _become(json.loads(text), descriptors, parent, connection)
        os.waitpid(middle, 0)
        for descriptor in descriptors:
            os.close(descriptor)


def _become(
    request: Mapping[str, Any], received: Sequence[int], parent: int, connection: socket.socket
) -> list[str]:
    """Turn this process into the requested one; return its command."""
    command: list[str] = request["command"]
    numbers: list[int] = request["descriptors"]
    os.setsid()
    # Move them out of the way of the requested numbers.
    received = [connection.detach(), *received]
    free = max(*received, *numbers) + 1
    answering, *moved = (fcntl(one, F_DUPFD, free) for one in received)
    os.closerange(3, free)
    for descriptor, number in zip((moved[0], *moved), (2, 1, *numbers), strict=True):
        os.dup2(descriptor, number)
    for descriptor in moved:
        os.close(descriptor)
    os.environ.clear()
    os.environ.update(request["environment"])
    _set_command_line(command)
    end = time.monotonic() + _ADOPTED_S
    while os.getppid() != parent:
        if time.monotonic() > end:
            os._exit(1)
        time.sleep(_POLL_S)
    os.write(answering, str(os.getpid()).encode())
    os.close(answering)
    return command


def _run(module: str, arguments: Sequence[str]) -> NoReturn:
    """Run a node, and end this process as ``multiprocessing`` ends its forks.

    It skips destructors of C libraries: LTTng's tracing waits there for a thread that does not
    exist in a fork, and crashes.
    """
    sys.argv = [str(node_main.__file__), *arguments]
    code: object = 1
    try:
        code = node_main.start(module)
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(Exception):
            atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(code if isinstance(code, int) else int(bool(code)))


def _set_command_line(words: Sequence[str]) -> None:
    """Show another command line for this process, if there is room for it."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    start, end = int(fields[_ARGUMENTS_START]), int(fields[_ARGUMENTS_END])
    shown = "".join(f"{word}\0" for word in words).encode()[: max(0, end - start - 1)]
    ctypes.memset(start, 0, end - start)
    ctypes.memmove(start, shown, len(shown))


if __name__ == "__main__":
    _set_command_line([sys.executable, "-m", "bt_agents_tools.launcher.fork_server"])
    _, _, _, module, *arguments = _serve(socket.socket(fileno=int(sys.argv[1])))
    _run(module, arguments)
