# SPDX-License-Identifier: Apache-2.0
"""HTTP and WebSocket server of a studio."""

from __future__ import annotations

import asyncio
import gzip
import json
import math
import mimetypes
import socket as sockets
import ssl
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from urllib.parse import quote

from aiohttp import WSMsgType, web

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_studio.access import (
    ALL_ROLES,
    LARGEST_BODY,
    OBSERVERS,
    AccessControl,
    SessionRole,
    WebRequest,
    cookie_name,
    security_headers,
)
from bt_agents_studio.connections import (
    HANDSHAKE_S,
    WAIT_S,
    Connections,
    most_connections,
    server_logger,
)
from bt_agents_studio.feed import Feed, shown_entries
from bt_agents_studio.journal_worker import JournalWorker, RecordedAnswer
from bt_agents_studio.operations import (
    LIMIT_S,
    OPERATIONS,
    OWN_OPERATIONS,
    WITH_PERSON,
    read_fields,
    read_request,
)
from bt_agents_studio.own_operations import OwnOperations
from bt_agents_studio.protocol import (
    LARGEST_MESSAGE,
    LATEST_S,
    Beat,
    Delta,
    Failure,
    Seek,
    ServerMessage,
    decode,
    encode,
)
from bt_agents_studio.recordings import WRITTEN_S
from bt_agents_studio.records import OF_A_PERSON
from bt_agents_studio.studio import Studio

if TYPE_CHECKING:
    from bt_agents_studio.node import StudioNode

PERIOD_S = 1 / 60
"""Shortest time between two messages to one client [s]."""

MOST_CLIENTS = 32
"""Maximum number of WebSockets of one role."""

MOST_EXCERPTS = 4
"""Maximum number of excerpts that are made or sent at a time, each in a file of its own."""

SEND_S = 600.0
"""Longest time for sending an excerpt [s]."""

BEAT_S = 1.0
"""Longest time without a message to a client [s]; a page considers a studio lost after three."""

_PING_S = 10.0
_PERSON_PING_S = 2.0
"""A robot waits 1.5 times this long for a page Person whose network has failed [s]."""
_END_S = 1.0
_PART_BYTES = 64 * 1024
_SOCKET = "/api/socket"
_PAGE = Path(__file__).parent / "page"
_STATUSES = {
    RefusalCode.NO_SESSION: 401,
    RefusalCode.BAD_TOKEN: 403,
    RefusalCode.FORBIDDEN: 403,
    RefusalCode.NO_KEY: 403,
    RefusalCode.NO_BODY: 408,
    RefusalCode.FOREIGN_HOST: 421,
    RefusalCode.FOREIGN_ORIGIN: 403,
    RefusalCode.NO_ORIGIN: 403,
    RefusalCode.NOT_JSON: 415,
    RefusalCode.NO_ANSWER: 504,
    RefusalCode.TOO_MANY_CLIENTS: 503,
    RefusalCode.BUSY: 503,
    RefusalCode.NOT_FOUND: 404,
    RefusalCode.NO_JOURNAL: 404,
}
_BAD_REQUEST = 400


class Server:
    """Web application of a studio; it runs in the thread of one event loop.

    Args:
        studio: The studio to show.
        access: Rules of access.
        node: Calls services, and is told which pages are open.
        person_address: Address of the page Person, including the token.
        secure: Whether the server uses TLS.
    """

    def __init__(
        self,
        studio: Studio,
        access: AccessControl,
        node: StudioNode,
        *,
        person_address: str,
        secure: bool = False,
    ) -> None:
        self._studio = studio
        self._access = access
        self._node = node
        self._secure = secure
        # Socket → role and id of the session that opened it.
        self._clients: dict[web.WebSocketResponse, tuple[SessionRole, str]] = {}
        self._persons: set[web.WebSocketResponse] = set()
        # Time of the last message, steady time [s].
        self._sent_s: dict[web.WebSocketResponse, float] = {}
        self._changed = asyncio.Event()
        # Last changes, and their text.
        self._encoded: tuple[Delta | None, str] = None, ""
        self._headers = security_headers(secure=secure)
        self._files = _read_page(_PAGE)
        self._own = OwnOperations(studio, node, person_address)
        self._labels = ThreadPoolExecutor(max_workers=1, thread_name_prefix="labels")
        self._recordings = JournalWorker(studio.mood, studio.namespace)
        self._reading: set[asyncio.Task[None]] = set()
        self._excerpts = asyncio.BoundedSemaphore(MOST_EXCERPTS)
        self._connections: Connections
        self._application = web.Application(
            client_max_size=LARGEST_BODY, middlewares=[self._guard]
        )
        self._application.add_routes(
            [
                web.post("/api/session", self._log_in),
                web.delete("/api/session", self._log_out),
                web.get(_SOCKET, self._socket),
                web.get("/api/state", self._state),
                web.get("/api/journals", self._journals),
                web.get("/api/journals/{name}", self._journal),
                web.get("/api/journals/{name}/events", self._events),
                web.get("/api/journals/{name}/messages", self._messages, allow_head=False),
                web.post("/api/do/{operation}", self._do),
                web.get("/{path:.*}", self._page),
            ]
        )

    @asynccontextmanager
    async def serving(
        self, listening: sockets.socket, context: ssl.SSLContext | None = None
    ) -> AsyncIterator[None]:
        """Serve on a listening socket within the block, with TLS if a context is given."""
        runner = web.AppRunner(
            self._application, access_log=None, logger=server_logger(), keepalive_timeout=WAIT_S
        )
        await runner.setup()
        assert runner.server is not None
        self._connections = Connections(runner.server, most_connections())
        accepting = await asyncio.get_running_loop().create_server(
            self._connections.accept,
            sock=listening,
            ssl=context,
            ssl_handshake_timeout=HANDSHAKE_S if context is not None else None,
        )
        try:
            yield
        finally:
            accepting.close()
            await self._close()
            await runner.server.shutdown(_END_S)
            await runner.cleanup()

    def changed(self) -> None:
        """Send new changes to the clients; call it in the thread of the event loop."""
        event, self._changed = self._changed, asyncio.Event()
        event.set()

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        try:
            described = _described(request)
            self._access.check_sender(described)
            if self._access.knows(described.session):
                with self._connections.asking(request.protocol):
                    answer = await handler(request)
            else:
                answer = await handler(request)
        except Refused as refused:
            status = _STATUSES.get(refused.code, _BAD_REQUEST)
            answer = _json({"code": refused.code, "message": refused.reason}, status)
        except web.HTTPException as error:
            if error.status < 400:
                raise
            answer = _json({"code": error.reason.upper(), "message": error.reason}, error.status)
        if not answer.prepared:
            answer.headers.update(self._headers)
        return answer

    async def _log_in(self, request: web.Request) -> web.Response:
        body = await _body(request)
        token = body.get("token") if isinstance(body, dict) else None
        session = self._access.log_in(token if isinstance(token, str) else "")
        answer = _json({"code": "", "message": "", "key": self._access.key(session)})
        answer.set_cookie(
            _cookie_name(request),
            session,
            httponly=True,
            samesite="Strict",
            secure=self._secure,
            path="/",
        )
        return answer

    async def _log_out(self, request: web.Request) -> web.Response:
        described = _described(request)
        self._access.check(described, ALL_ROLES)
        self._access.log_out(described.session)
        for socket, (_, session) in list(self._clients.items()):
            if session == described.session:
                await socket.close()
        answer = _json({"code": "", "message": ""})
        answer.del_cookie(_cookie_name(request), path="/")
        return answer

    async def _state(self, request: web.Request) -> web.Response:
        role = self._access.check(_described(request), ALL_ROLES)
        entries = shown_entries(self._studio.store.snapshot(), _collections_of(role))
        return _json({"sequence": self._studio.store.sequence, **entries})

    async def _journals(self, request: web.Request) -> web.Response:
        self._access.check(_described(request), OBSERVERS)
        loop = asyncio.get_running_loop()
        return _json(await loop.run_in_executor(self._labels, self._studio.journal_list))

    async def _journal(self, request: web.Request) -> web.StreamResponse:
        file = self._recording(request)
        if file.is_dir():
            raise Refused(
                RefusalCode.NO_FILE, f"'{file.name}' is a bag, a folder of files; copy it instead"
            )
        return web.FileResponse(file, headers=_attached(file.name))

    async def _events(self, request: web.Request) -> web.Response:
        return _answered(await self._recordings.events(self._recording(request)))

    async def _messages(self, request: web.Request) -> web.StreamResponse:
        file = self._recording(request)
        from_s, to_s = _moment(request, "from"), _moment(request, "to")
        if self._excerpts.locked():
            raise Refused(
                RefusalCode.BUSY, f"{MOST_EXCERPTS} excerpts are being sent; wait until one ends"
            )
        waits = self._studio.is_awaited(file.name, to_s + WRITTEN_S)
        async with self._excerpts:
            with TemporaryDirectory(prefix="bt-agents-") as folder:
                into = Path(folder) / "excerpt.mcap"
                answer = await self._recordings.write_excerpt(
                    file, from_s, to_s, into, waits=waits
                )
                if answer.is_failure:
                    return _answered(answer)
                headers = {**self._headers, **_attached(f"{file.stem}-excerpt.mcap")}
                sent = web.StreamResponse(headers=headers)
                sent.content_length = into.stat().st_size
                await sent.prepare(request)
                try:
                    async with asyncio.timeout(SEND_S):
                        with into.open("rb") as excerpt:
                            while part := excerpt.read(_PART_BYTES):
                                await sent.write(part)
                except TimeoutError:
                    # A client that does not read it must not keep a place.
                    if request.transport is not None:
                        request.transport.abort()
                return sent

    def _recording(self, request: web.Request) -> Path:
        """Return the recording that an observer requests."""
        self._access.check(_described(request), OBSERVERS)
        return self._studio.journal_file(request.match_info["name"])

    async def _do(self, request: web.Request) -> web.Response:
        name = request.match_info["operation"]
        if (own := OWN_OPERATIONS.get(name)) is not None:
            self._access.check(_described(request), own.roles)
            return _json(await self._own.do(name, read_fields(own.fields, await _body(request))))
        operation = OPERATIONS.get(name)
        if operation is None:
            names = ", ".join([*OPERATIONS, *OWN_OPERATIONS])
            raise Refused(RefusalCode.NOT_FOUND, f"no operation '{name[:40]}'; there are {names}")
        role = self._access.check(_described(request), operation.roles)
        service, fields = read_request(operation, await _body(request), role)
        answer = await asyncio.wrap_future(self._node.call(service, fields, LIMIT_S))
        return _json(
            {
                "accepted": bool(answer.accepted),
                "code": str(getattr(answer, "code", "")),
                "message": str(answer.message),
                **({"revision": int(answer.revision)} if hasattr(answer, "revision") else {}),
            }
        )

    async def _page(self, request: web.Request) -> web.Response:
        path = request.match_info["path"]
        found = self._files.get(path)
        if found is None and "." not in path and not path.startswith("api/"):
            # Each page has an address, and most of them share one document.
            document = f"{path.partition('/')[0]}.html"
            found = self._files.get(document) or self._files.get("index.html")
        if found is None:
            raise Refused(RefusalCode.NOT_FOUND, f"there is no '/{path[:80]}' here")
        kind, data, packed = found
        headers = {"Vary": "Accept-Encoding"}
        if "gzip" in request.headers.get("Accept-Encoding", ""):
            headers["Content-Encoding"] = "gzip"
            data = packed
        return web.Response(body=data, content_type=kind, charset="utf-8", headers=headers)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        described = _described(request)
        role = self._access.check(described, ALL_ROLES)
        if sum(one is role for one, _ in self._clients.values()) >= MOST_CLIENTS:
            raise Refused(
                RefusalCode.TOO_MANY_CLIENTS,
                f"{MOST_CLIENTS} pages of the role {role} are open, no more may be; close one of "
                "them",
            )
        # A client that can only look on does not count as a person in front of the robot.
        is_person = request.query.get("page") == "person" and role in WITH_PERSON
        socket = web.WebSocketResponse(
            heartbeat=_PERSON_PING_S if is_person else _PING_S,
            max_msg_size=LARGEST_MESSAGE,
            compress=False,
        )
        await socket.prepare(request)
        self._clients[socket] = role, described.session
        if is_person:
            self._persons.add(socket)
        self._tell_watched()
        feed = Feed(
            self._studio.store, self._studio.history, self._studio.name, _collections_of(role)
        )
        self._sent_s[socket] = time.monotonic()
        tasks = [
            asyncio.create_task(one)
            for one in (self._pump(socket, feed, role), self._beat(socket))
        ]
        try:
            async for received in socket:
                if received.type is not WSMsgType.TEXT:
                    break
                try:
                    feed.take(decode(received.data))
                except Refused as refused:
                    await self._send(socket, Failure(code=refused.code, message=refused.reason))
                self.changed()
        finally:
            self._clients.pop(socket, None)
            self._sent_s.pop(socket, None)
            self._persons.discard(socket)
            self._tell_watched()
            for task in tasks:
                task.cancel()
        return socket

    def _tell_watched(self) -> None:
        self._node.watch(bool(self._clients), bool(self._persons))

    async def _pump(self, socket: web.WebSocketResponse, feed: Feed, role: SessionRole) -> None:
        """Send one client its messages, as fast as it reads and only as often as needed."""
        await self._send(socket, self._studio.hello(role, self._node.get_namespace()))
        while not socket.closed:
            changed = self._changed
            if (seek := feed.take_recorded()) is not None:
                reading = asyncio.create_task(self._read(feed, seek))
                self._reading.add(reading)
                reading.add_done_callback(self._reading.discard)
            due = feed.next()
            if due is None:
                await changed.wait()
                continue
            encoded_s = await self._send(socket, due)
            # Leave half of the time for everything else, however much changes.
            await asyncio.sleep(max(PERIOD_S, 2 * encoded_s * len(self._clients)))

    async def _beat(self, socket: web.WebSocketResponse) -> None:
        """Send one client a sign of life after each time without other messages."""
        while not socket.closed:
            rest_s = self._sent_s.get(socket, 0.0) + BEAT_S - time.monotonic()
            if rest_s > 0:
                await asyncio.sleep(rest_s)
            else:
                await self._send(socket, Beat())

    async def _read(self, feed: Feed, seek: Seek) -> None:
        """Have a moment of a recording read, and pass it to the feed that requested it."""
        try:
            file = self._studio.journal_file(seek.source)
            waits = self._studio.is_awaited(seek.source, seek.at_s)
            answer = await self._recordings.moment(file, seek.at_s, waits=waits)
        except Refused as refused:
            answer = RecordedAnswer(
                text=encode(Failure(code=refused.code, message=refused.reason)), is_failure=True
            )
        feed.give(answer.text, is_failure=answer.is_failure, is_whole=answer.is_whole)
        self.changed()

    async def _send(self, socket: web.WebSocketResponse, message: ServerMessage | str) -> float:
        """Send a message; return the time for encoding it [s]."""
        began = time.monotonic()
        text = message if isinstance(message, str) else self._text_of(message)
        encoded_s = time.monotonic() - began
        if socket in self._clients:
            self._sent_s[socket] = time.monotonic()
        try:
            await socket.send_str(text)
        except (ConnectionError, RuntimeError):
            # The socket was closed meanwhile.
            await socket.close()
        return encoded_s

    def _text_of(self, message: ServerMessage) -> str:
        """Return the text of a message; clients that read equally fast share it."""
        if not isinstance(message, Delta):
            return encode(message)
        if message != self._encoded[0]:
            self._encoded = message, encode(message)
        return self._encoded[1]

    async def _close(self) -> None:
        for socket in list(self._clients):
            await socket.close(code=1001, message=b"the studio ends")
        self._labels.shutdown(wait=False, cancel_futures=True)
        for reading in list(self._reading):
            reading.cancel()
        await self._recordings.close()
        self._own.close()


def _cookie_name(request: web.Request) -> str:
    return cookie_name(request.headers.get("Host", ""))


def _described(request: web.Request) -> WebRequest:
    headers = request.headers
    return WebRequest(
        method=request.method,
        host=headers.get("Host", ""),
        origin=headers.get("Origin", ""),
        fetch_site=headers.get("Sec-Fetch-Site", ""),
        content_type=headers.get("Content-Type", ""),
        session=request.cookies.get(_cookie_name(request), ""),
        key=headers.get("Authorization", "").removeprefix("Bearer "),
        opens_socket=request.path == _SOCKET,
    )


def _moment(request: web.Request, name: str) -> float:
    """Return the moment in the address of a request [s since 1970]."""
    text = request.query.get(name, "")
    try:
        moment = float(text)
    except ValueError:
        moment = math.nan
    if not 0 <= moment <= LATEST_S:
        raise Refused(
            RefusalCode.BAD_FIELD, f"'{name}' is '{text[:40]}', expected seconds since 1970"
        )
    return moment


def _attached(name: str) -> Mapping[str, str]:
    """Return the headers of a file that a browser saves."""
    return {
        "Content-Type": "application/octet-stream",
        "Content-Disposition": f'attachment; filename="{quote(name)}"',
    }


def _answered(answer: RecordedAnswer) -> web.Response:
    return web.Response(
        text=answer.text,
        status=_BAD_REQUEST if answer.is_failure else 200,
        content_type="application/json",
    )


def _collections_of(role: SessionRole) -> Collection[str] | None:
    return OF_A_PERSON if role is SessionRole.PERSON else None


async def _body(request: web.Request) -> object:
    try:
        async with asyncio.timeout(WAIT_S):
            await request.read()
    except TimeoutError:
        raise Refused(RefusalCode.NO_BODY, f"the body did not come within {WAIT_S:g} s") from None
    except (ConnectionError, RuntimeError, web.RequestPayloadError):
        raise Refused(
            RefusalCode.NO_BODY, "the body ended too early, or is packed in another way"
        ) from None
    try:
        return json.loads(await request.text())
    except (ValueError, RecursionError, LookupError):
        raise Refused(RefusalCode.BAD_FIELD, "the body is not JSON") from None


def _json(value: object, status: int = 200) -> web.Response:
    text = json.dumps(value, default=vars, allow_nan=False, ensure_ascii=False)
    return web.Response(text=text, status=status, content_type="application/json")


def _read_page(folder: Path) -> Mapping[str, tuple[str, bytes, bytes]]:
    """Return type, content and compressed content of each file of the page by its address.

    The server opens no other file.
    """
    found = {}
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
            data = file.read_bytes()
            packed = gzip.compress(data, mtime=0)
            found[file.relative_to(folder).as_posix()] = (kind, data, packed)
    return found
