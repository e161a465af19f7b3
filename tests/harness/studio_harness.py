# SPDX-License-Identifier: Apache-2.0
"""Studio served on a port of this machine, without a ROS system."""

from __future__ import annotations

import asyncio
import secrets
import socket
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import asynccontextmanager, contextmanager
from functools import wraps
from inspect import Signature, signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

from aiohttp import ClientSession, CookieJar
from rclpy.parameter import Parameter

from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_studio.access import AccessControl, SessionRole, cookie_name
from bt_agents_studio.server import Server
from bt_agents_studio.store import Change, encode_value
from bt_agents_studio.studio import Studio

LIMIT_S = 30.0
HANG_S = 300.0
"""Time limit of a browser test."""

SPACE = SceneSpace(
    parameters=(
        SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0, labels={1.0: "child"}),
        SceneParameter(name="mood", minimum=1.0, maximum=5.0, default=3.0),
    ),
    mood="mood",
)


StudioT = TypeVar("StudioT", bound="ServedStudio")


class RecordingCaller:
    """Node whose services all give the same answer, and the requests that they received."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, dict[str, Any]]] = []
        self.answered = SimpleNamespace(accepted=True, code="", message="done")
        self.previewed: Any = None
        self.hosts: Any = {}
        # Parameter of the market → its descriptor and its value.
        self.parameters: dict[str, tuple[Any, Any]] = {}
        self.not_set = ""
        # Whether any page, and whether a page Person, was open, at each change.
        self.watched: list[tuple[bool, bool]] = []

    def get_namespace(self) -> str:
        return "/"

    def watch(self, is_watched: bool, is_person_open: bool) -> None:
        self.watched.append((is_watched, is_person_open))

    def call(self, service: str, fields: Mapping[str, Any], limit_s: float) -> Future[Any]:
        if service in ("marketplace/describe_parameters", "marketplace/get_parameters"):
            found = [self.parameters[one] for one in fields["names"] if one in self.parameters]
            values = [Parameter("", value=value).get_parameter_value() for _, value in found]
            return _done(SimpleNamespace(descriptors=[one for one, _ in found], values=values))
        self.calls.append((service, dict(fields)))
        return _done(self.answered)

    def answer(self, text: str) -> Future[str]:
        self.calls.append(("answer", {"text": text}))
        return _done(f"answered {text}")

    def publish(self, topic: str, values: Sequence[str]) -> Future[str]:
        self.calls.append(("publish", {"topic": topic, "values": values}))
        return _done(f"published on {topic}")

    def preview(self, values: Mapping[str, float], limit_s: float) -> Future[Any]:
        self.calls.append(("preview", dict(values)))
        return _done(self.previewed)

    def set_market_parameters(
        self, changes: Mapping[str, str | float], limit_s: float
    ) -> Future[Any]:
        self.calls.append(("set", dict(changes)))
        if not self.not_set:
            for name, value in changes.items():
                self.parameters[name] = (self.parameters[name][0], value)
        result = SimpleNamespace(successful=not self.not_set, reason=self.not_set)
        return _done(SimpleNamespace(result=result))

    def tuned(self) -> Future[Any]:
        return _done(self.hosts)


def _done(value: Any) -> Future[Any]:
    answer: Future[Any] = Future()
    answer.set_result(value)
    return answer


class ServedStudio:
    """A studio, its server and its address."""

    def __init__(self, journal: Path | None = None) -> None:
        self.studio = Studio("studio", space=SPACE, journal=journal)
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

    def address_for(self, role: SessionRole, page: str = "") -> str:
        """Return the address of a page for a role."""
        return f"{self.origin}/{page}#{self.access.token(role)}"

    def session(self, role: SessionRole) -> str:
        return self.access.log_in(self.access.token(role))

    def client(self, role: SessionRole | None = None) -> ClientSession:
        """Return a signed-in client that names the page as its origin."""
        cookies, headers = {}, {"Origin": self.origin}
        if role is not None:
            session = self.session(role)
            cookies[cookie_name(self.host)] = session
            headers["Authorization"] = f"Bearer {self.access.key(session)}"
        return ClientSession(
            self.origin, cookies=cookies, cookie_jar=CookieJar(unsafe=True), headers=headers
        )

    def put(self, collection: str, key: str, value: object) -> None:
        self.studio.store.put(collection, key, value)
        self.server.changed()


def run_served(
    test: Callable[[StudioT], Awaitable[None]], one: StudioT, limit_s: float = LIMIT_S
) -> None:
    """Run a function while its studio is served."""

    async def run() -> None:
        async with serving(one):
            await asyncio.wait_for(test(one), limit_s)

    asyncio.run(run())


def served(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    """Serve a studio, the first argument of a test, while the test runs.

    Its journals are in the ``tmp_path`` of the test, if it takes one.
    """

    @wraps(test)
    def run(**fixtures: Any) -> None:
        run_served(lambda one: test(one, **fixtures), ServedStudio(fixtures.get("tmp_path")))

    _, *parameters = signature(test).parameters.values()
    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return run


@asynccontextmanager
async def serving(one: StudioT) -> AsyncIterator[StudioT]:
    """Serve a studio at a free port."""
    hosts: set[str] = set()
    one.access = AccessControl(
        hosts,  # filled when the port is known
        scheme="http",
        random_bytes=secrets.token_bytes,
        clock=time.time,
    )
    with socket.create_server(("127.0.0.1", 0)) as listening:
        one.port = listening.getsockname()[1]
        hosts.add(one.host)
        one.server = Server(
            one.studio,
            one.access,
            one.caller,
            person_address=one.address_for(SessionRole.PERSON, "person"),
        )
        async with one.server.serving(listening):
            yield one


class BackgroundStudio(ServedStudio):
    """Studio served by a thread, for a test with a browser."""

    loop: asyncio.AbstractEventLoop

    @property
    def address(self) -> str:
        """Address of the page for an operator."""
        return self.address_for(SessionRole.OPERATE)

    def put(self, collection: str, key: str, value: object) -> None:
        """Change an entry, as a message of the system does."""
        self.loop.call_soon_threadsafe(super().put, collection, key, value)

    def put_past(self, at_s: float, collection: str, key: str, value: object) -> None:
        """Record changes of an earlier moment [s since 1970], before any other change."""
        change = Change(collection=collection, key=key, value=encode_value(value))
        self.loop.call_soon_threadsafe(self.studio.history.record, at_s, change)


@contextmanager
def background_studio(journal: Path | None = None) -> Iterator[BackgroundStudio]:
    """Serve a studio in a thread until the end of the block."""
    begun: Future[asyncio.Event] = Future()

    async def wait(one: BackgroundStudio) -> None:
        one.loop = asyncio.get_running_loop()
        ended = asyncio.Event()
        begun.set_result(ended)
        await ended.wait()

    studio = BackgroundStudio(journal)
    thread = threading.Thread(target=run_served, args=(wait, studio, HANG_S), daemon=True)
    thread.start()
    ended = begun.result(LIMIT_S)
    try:
        yield studio
    finally:
        studio.loop.call_soon_threadsafe(ended.set)
        thread.join(LIMIT_S)
