# SPDX-License-Identifier: Apache-2.0
"""Run of a studio: its ROS thread, its event loop, and a clean end of both."""

from __future__ import annotations

import asyncio
import gc
import os
import secrets
import signal
import socket
import ssl
import sys
import time
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.listening import STUDIO_PORTS, listen
from bt_agents_core.scene import SceneSpace
from bt_agents_studio.access import AccessControl, SessionRole, is_loopback
from bt_agents_studio.access_file import AccessFile
from bt_agents_studio.node import NodeThread
from bt_agents_studio.server import Server
from bt_agents_studio.studio import Studio

_PAGES = {SessionRole.PERSON: "person"}
_CHECK_S = 0.25
_SLICE_S = 0.01
"""Time for messages before it is the turn of the pages' requests [s]."""

_SWITCH_S = 0.0005
_NICENESS = 5
"""Lets nodes that tick use the processor before nodes that look on."""


@dataclass(frozen=True, kw_only=True)
class Address:
    """Address of a studio.

    Attributes:
        host: Name or address to listen on.
        port: Port; 0 takes the first free one of :data:`STUDIO_PORTS`.
        certificate: File with the certificate, optionally with its key, for TLS; None without.
        key: File with the key.
        listening: Existing listening socket; None opens one.
    """

    host: str = "127.0.0.1"
    port: int = 0
    certificate: Path | None = None
    key: Path | None = None
    listening: socket.socket | None = None

    @property
    def name(self) -> str:
        """The host as browsers write it."""
        return f"[{self.host}]" if ":" in self.host else self.host.lower()

    def hosts(self, port: int) -> frozenset[str]:
        """Return what a browser may name as ``Host``; it leaves out the standard port."""
        names = {self.name, *(("127.0.0.1", "localhost") if is_loopback(self.host) else ())}
        bare = names if port == (80 if self.certificate is None else 443) else frozenset()
        return frozenset(f"{name}:{port}" for name in names) | bare

    def context(self) -> ssl.SSLContext | None:
        """Return the TLS settings, None without TLS.

        Raises:
            BtAgentsError: The address is that of no machine, or reachable from other machines
                without a certificate; or certificate or key cannot be read.
        """
        if self.host in ("", "0.0.0.0", "::"):
            # A browser names the address that it has opened, and the studio answers for its own.
            raise BtAgentsError(
                f"--address is '{self.host}', which no browser can open; give the address or name "
                "of this machine under which others open the studio, such as 192.168.1.20"
            )
        if self.certificate is None:
            if self.key is not None:
                raise BtAgentsError("--key needs --certificate: without it there is no TLS")
            if not is_loopback(self.host):
                raise BtAgentsError(
                    f"{self.host} can be reached from other machines, so the studio needs TLS "
                    "there: give --certificate and --key, or leave --address out"
                )
            return None
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        try:
            context.load_cert_chain(self.certificate, self.key)
        except (OSError, ssl.SSLError) as error:
            keyed = "" if self.key else "; if its key is a file of its own, name it with --key"
            raise BtAgentsError(f"the certificate {self.certificate}: {error}{keyed}") from None
        return context


async def serve(
    address: Address,
    *,
    space: SceneSpace,
    journal: Path | None,
    kept: Path | None,
    ready: Callable[[Mapping[SessionRole, str]], None],
) -> None:
    """Serve a studio until SIGINT or SIGTERM.

    Args:
        address: Address to serve at.
        space: The scene parameters.
        journal: Folder of journal files; None for none.
        kept: Folder for the tokens and sessions, which survive a restart; None keeps none.
        ready: Called with the address for a browser of each role, including the token, once it can
            be opened.

    Raises:
        BtAgentsError: The address is unavailable, or ROS cannot be started.
    """
    # Long work of this thread must not hold up the messages: facts of the interpreter's lock.
    sys.setswitchinterval(_SWITCH_S)
    os.nice(_NICENESS)
    context = address.context()
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    namespace = os.environ.get("ROS_NAMESPACE", "")
    studio = Studio(uuid.uuid4().hex[:12], space=space, journal=journal, namespace=namespace)
    server: Server | None = None

    def deliver() -> None:
        """Show received messages, in turn with requests of pages."""
        thread.handover.deliver(_SLICE_S)
        if thread.handover.waits:
            loop.call_soon(deliver)
        if server is not None:
            server.changed()

    def wake() -> None:
        loop.call_soon_threadsafe(deliver)

    thread = NodeThread(studio, wake)
    node = await asyncio.to_thread(thread.start)
    try:
        ports = (address.port,) if address.port else STUDIO_PORTS
        listening = address.listening or listen(address.host, ports)
        port = listening.getsockname()[1]
        scheme = "https" if context is not None else "http"
        # Only this process has the port, so no other process writes this file.
        file = AccessFile(kept / f"studio-{port}.json" if kept is not None else None)
        access = AccessControl(
            address.hosts(port),
            scheme=scheme,
            random_bytes=secrets.token_bytes,
            clock=time.time,
            kept=file.read(),
            keep=file.write,
        )
        base = f"{scheme}://{address.name}:{port}/"
        addresses = {
            role: f"{base}{_PAGES.get(role, '')}#{access.token(role)}" for role in SessionRole
        }
        server = Server(
            studio,
            access,
            node,
            person_address=addresses[SessionRole.PERSON],
            secure=context is not None,
        )
        # A full collection visits every object that is not frozen: the modules alone take 40 ms.
        gc.freeze()
        async with server.serving(listening, context):
            ready(addresses)
            while not stopped.is_set():
                studio.check_parts()
                server.changed()
                with suppress(TimeoutError):
                    await asyncio.wait_for(stopped.wait(), _CHECK_S)
    finally:
        await asyncio.to_thread(thread.stop)
