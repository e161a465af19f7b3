# SPDX-License-Identifier: Apache-2.0
"""Studio that is served on a port of this machine, without a ROS system behind it."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

from aiohttp import ClientSession, CookieJar, web

from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_studio.access import AccessControl, SessionRole
from bt_agents_studio.server import Server
from bt_agents_studio.studio import Studio

LIMIT_S = 30.0

SPACE = SceneSpace(
    parameters=(
        SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0, labels={1.0: "child"}),
        SceneParameter(name="mood", minimum=1.0, maximum=5.0, default=3.0),
    ),
    mood="mood",
)


class RecordingCaller:
    """Services that accept everything, and what they were asked."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, str, dict[str, Any]]] = []

    def call(
        self, kind: str, service: str, fields: Mapping[str, Any], limit_s: float
    ) -> Future[Any]:
        del limit_s
        self.calls.append((kind, service, dict(fields)))
        answer: Future[Any] = Future()
        answer.set_result(SimpleNamespace(accepted=True, code="", message="done"))
        return answer


class ServedStudio:
    """A studio, its server, and where that is."""

    def __init__(self) -> None:
        self.studio = Studio("studio", space=SPACE)
        self.caller = RecordingCaller()
        self.port = 0
        self.access: AccessControl
        self.server: Server

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def origin(self) -> str:
        return f"http://{self.host}"

    def session(self, role: SessionRole) -> str:
        return self.access.log_in(self.access.token(role))

    def client(self, role: SessionRole | None = None) -> ClientSession:
        """Return a client that is signed in, and names the page as its origin."""
        cookies = {"bt_agents_studio": self.session(role)} if role is not None else {}
        return ClientSession(
            self.origin,
            cookies=cookies,
            cookie_jar=CookieJar(unsafe=True),
            headers={"Origin": self.origin},
        )

    def put(self, collection: str, key: str, value: object) -> None:
        self.studio.store.put(collection, key, value)
        self.server.changed()


def served(test: Callable[[ServedStudio], Awaitable[None]]) -> None:
    """Run a test while its studio is served."""

    async def run() -> None:
        one = ServedStudio()
        hosts: set[str] = set()
        one.access = AccessControl(
            hosts,  # filled when the port is known
            scheme="http",
            random_bytes=secrets.token_bytes,
            clock=time.monotonic,
        )
        one.server = Server(one.studio, one.access, one.caller)
        runner = web.AppRunner(one.server.application, access_log=None)
        await runner.setup()
        try:
            site = web.TCPSite(runner, "127.0.0.1", 0)
            await site.start()
            one.port = runner.addresses[0][1]
            hosts.add(one.host)
            await asyncio.wait_for(test(one), LIMIT_S)
        finally:
            await runner.cleanup()

    asyncio.run(run())
