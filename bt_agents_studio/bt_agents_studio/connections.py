# SPDX-License-Identifier: Apache-2.0
"""Limit on the connections of a server, and the choice of one to close for a new one."""

from __future__ import annotations

import asyncio
import logging
import resource
from collections.abc import Iterator
from contextlib import contextmanager

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

MOST_CONNECTIONS = 256
"""Maximum number of open connections; less if the process may open few files."""

WAIT_S = 15.0
"""A client must send the header and the body of a request within this time each [s]."""

HANDSHAKE_S = 5.0
"""Time for the TLS handshake [s]."""


class Connections:
    """Accepts connections; at the limit, closes an idle one for each new one.

    It closes the first connection that no session has used, else the one whose last answer is
    oldest. A connection with a pending answer to a session, such as a WebSocket, stays.

    Args:
        server: Answers the requests.
        most: Maximum number of open connections.
    """

    def __init__(self, server: web.Server, most: int) -> None:
        self._server = server
        self._most = most
        self._asking: set[web.RequestHandler] = set()
        # Idle connections with an earlier answer, oldest first.
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
        """Mark a connection as answering a request of a session within the block."""
        self._answered.pop(connection, None)
        self._asking.add(connection)
        try:
            yield
        finally:
            self._asking.discard(connection)
            self._answered[connection] = None


class _Refusal(asyncio.Protocol):
    """Protocol of a connection beyond the limit."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        transport.abort()


def most_connections() -> int:
    """Return the maximum number of connections that leaves enough files for everything else."""
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return min(MOST_CONNECTIONS, files // 4)


def server_logger() -> logging.Logger:
    """Return the logger of a server, which omits messages about input that is not HTTP."""
    logger = logging.getLogger("bt_agents_studio.server")
    logger.addFilter(_is_own_fault)
    return logger


def _is_own_fault(record: logging.LogRecord) -> bool:
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))
