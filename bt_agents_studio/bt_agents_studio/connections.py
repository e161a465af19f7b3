# SPDX-License-Identifier: Apache-2.0
"""Connections of a server: how many may be open, and which closes when there is one too many."""

from __future__ import annotations

import asyncio
import logging
import resource
from collections.abc import Iterator
from contextlib import contextmanager

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

MOST_CONNECTIONS = 256
"""Open connections, at most; fewer where the process may open few files."""

WAIT_S = 15.0
"""Time in which a connection has to send the header or the body of a request [s]."""

HANDSHAKE_S = 5.0
"""Time for the handshake of TLS [s]."""


class Connections:
    """Accepts connections; one too many takes the place of one that asks nothing.

    That is the first on which no session has ever asked anything, else the one that was answered
    longest ago. One on which a session is being answered, as on a WebSocket, stays.

    Args:
        server: Answers the requests.
        most: Open connections, at most.
    """

    def __init__(self, server: web.Server, most: int) -> None:
        self._server = server
        self._most = most
        self._asking: set[web.RequestHandler] = set()
        # Those that were answered and ask nothing now, the longest ago first.
        self._answered: dict[web.RequestHandler, None] = {}

    def accept(self) -> asyncio.Protocol:
        """Return the protocol of a new connection."""
        opened = [one for one in self._server.connections if one.transport is not None]
        self._answered = {one: None for one in self._answered if one.transport is not None}
        if len(opened) >= self._most:
            known = self._asking | self._answered.keys()
            silent = next((one for one in opened if one not in known), None)
            closing = silent or next(iter(self._answered), None)
            if closing is None:
                return _Refusal()
            closing.force_close()
        return self._server()

    @contextmanager
    def asking(self, connection: web.RequestHandler) -> Iterator[None]:
        """Answer a request of a session on a connection within the block."""
        self._answered.pop(connection, None)
        self._asking.add(connection)
        try:
            yield
        finally:
            self._asking.discard(connection)
            self._answered[connection] = None


class _Refusal(asyncio.Protocol):
    """Protocol of a connection that there is no room for."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        transport.abort()


def most_connections() -> int:
    """Return how many connections may be open, so that files are left for everything else."""
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return min(MOST_CONNECTIONS, files // 4)


def server_logger() -> logging.Logger:
    """Return the logger of a server, which leaves out what is no HTTP."""
    logger = logging.getLogger("bt_agents_studio.server")
    logger.addFilter(_is_own_fault)
    return logger


def _is_own_fault(record: logging.LogRecord) -> bool:
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))
