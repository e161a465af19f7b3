# SPDX-License-Identifier: Apache-2.0
"""Commands in processes of their own, forked from a process that has loaded them all."""

from __future__ import annotations

import gc
import json
import os
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from fcntl import F_SETPIPE_SZ, fcntl
from pathlib import Path
from typing import Any

HANG_S = 60.0

_STREAMS = ("stdin", "stdout", "stderr")

_REQUEST_BYTES = 1 << 17
_PIPE_BYTES = 1 << 20
"""More than any command prints, so no command waits for its reader."""


@dataclass(frozen=True, kw_only=True)
class Ended:
    """A command that has ended.

    Attributes:
        code: Its exit code, as a shell reports it.
        out: Text from the pipe that was its standard output.
        err: Text from the pipe that was its standard error.
    """

    code: int
    out: str
    err: str


class CommandServer:
    """Client of the process that forks commands."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def run(
        self,
        *words: str,
        folder: Path,
        stdout: int | None = None,
        closed: Sequence[int] = (),
        largest_file: int | None = None,
        environment: Mapping[str, str] | None = None,
        together: bool = False,
    ) -> Ended:
        """Run one command to its end.

        Args:
            words: The command and its arguments.
            folder: Working directory.
            stdout: Descriptor of its standard output; by default a pipe that this reads.
            closed: Numbers of the standard streams that are closed at its start.
            largest_file: Most bytes that it may write into one file.
            environment: Its environment; by default the server's.
            together: True puts its standard error into ``out``, in order.
        """
        request = {
            "words": words,
            "folder": str(folder),
            "closed": list(closed),
            "largest_file": largest_file,
            "environment": None if environment is None else dict(environment),
        }
        with ExitStack() as open_files, open(os.devnull, "rb") as nothing:
            readers, writers = [], []
            for _ in ("stdout", "stderr"):
                reader, writer = os.pipe()
                readers.append(open_files.enter_context(open(reader, "rb")))
                writers.append(open_files.enter_context(open(writer, "wb")))
                fcntl(writer, F_SETPIPE_SZ, _PIPE_BYTES)
            out, err = (writer.fileno() for writer in writers)
            printed = out if stdout is None else stdout
            descriptors = [nothing.fileno(), printed, printed if together else err]
            socket.send_fds(self._connection, [json.dumps(request).encode()], descriptors)
            for writer in writers:
                writer.close()
            code = int(self._connection.recv(64))
            texts = [reader.read().decode() for reader in readers]
        return Ended(code=code if code >= 0 else 128 - code, out=texts[0], err=texts[1])


@contextmanager
def command_server(
    environment: dict[str, str], *, without_home: bool = False
) -> Iterator[CommandServer]:
    """Start the process that forks commands; kill it and its forks at the end.

    Args:
        environment: Its environment.
        without_home: True runs the commands as a user that the system does not know.
    """
    mine, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    mine.settimeout(HANG_S)
    with mine, its:
        process = subprocess.Popen(
            [sys.executable, "-P", __file__, str(its.fileno()), str(int(without_home))],
            stdin=subprocess.DEVNULL,
            env=environment,
            pass_fds=[its.fileno()],
            start_new_session=True,
        )
        its.close()
        try:
            yield CommandServer(mine)
        finally:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _wait_for_call(connection: socket.socket) -> None:
    """Fork for each request; return in the fork."""
    while True:
        text, descriptors, _, _ = socket.recv_fds(connection, _REQUEST_BYTES, len(_STREAMS))
        if not text:
            sys.exit()
        pid = os.fork()
        if not pid:
            connection.close()
            _become(json.loads(text), descriptors)
            return
        for descriptor in descriptors:
            os.close(descriptor)
        _, status = os.waitpid(pid, 0)
        connection.send(str(os.waitstatus_to_exitcode(status)).encode())


def _become(request: dict[str, Any], descriptors: Sequence[int]) -> None:
    """Turn this fork into a process like one that a shell starts."""
    for number, descriptor in enumerate(descriptors):
        os.dup2(descriptor, number)
        os.close(descriptor)
    for number in request["closed"]:
        os.close(number)
        # Python reads this when it starts.
        setattr(sys, _STREAMS[number], None)
    if (environment := request["environment"]) is not None:
        os.environ.clear()
        os.environ.update(environment)
    os.chdir(request["folder"])
    sys.argv = ["bt-agents", *request["words"]]
    if (size := request["largest_file"]) is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


if __name__ == "__main__":
    import pwd

    from bt_agents_tools.cli.main import all_commands, main

    def _unknown(*_: object) -> None:
        raise KeyError("no such user")

    if int(sys.argv[2]):
        pwd.getpwuid = pwd.getpwnam = _unknown
    for entry in all_commands().values():
        entry.load()
    gc.freeze()
    with socket.socket(fileno=int(sys.argv[1])) as to_test:
        _wait_for_call(to_test)
    main()
