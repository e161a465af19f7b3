# SPDX-License-Identifier: Apache-2.0
"""One HTTP request that ends in time, whatever the server does; blocks, so in a thread only."""

from __future__ import annotations

import http.client
import socket
import ssl
import threading
import time
from collections.abc import Mapping
from urllib.parse import urlsplit

from bt_agents.errors import Refused

_CHUNK = 65536


def post(
    url: str, headers: Mapping[str, str], body: bytes, *, limit_s: float, most: int
) -> tuple[int, bytes]:
    """Send a POST request and return status and body of the answer.

    Certificates are checked, redirects are not followed, and no proxy is asked. When the time is
    up the socket is shut from another thread, so a server that drips bytes gains nothing.

    Args:
        url: ``http`` or ``https``.
        headers: Of the request.
        body: Of the request.
        limit_s: For all of it [s].
        most: Bytes of the answer that are read; one more when there are more.

    Raises:
        Refused: ``UNREACHABLE`` or ``TOO_LATE``; their words hold no header.
    """
    parts = urlsplit(url)
    host = parts.hostname or ""
    port = parts.port or (443 if parts.scheme == "https" else 80)
    end = time.monotonic() + limit_s
    late = Refused("TOO_LATE", f"{host} did not answer within {limit_s:.2g} s")
    try:
        plain = socket.create_connection((host, port), timeout=limit_s)
    except TimeoutError:
        raise late from None
    except OSError as error:
        raise _unreachable(host, port, error) from None
    link: socket.socket = plain
    if parts.scheme == "https":
        link = ssl.create_default_context().wrap_socket(
            plain, server_hostname=host, do_handshake_on_connect=False
        )
    watch = threading.Timer(max(0.0, end - time.monotonic()), _shut, (link,))
    watch.daemon = True
    watch.start()
    connection = http.client.HTTPConnection(host, port)
    connection.sock = link
    try:
        if isinstance(link, ssl.SSLSocket):
            link.do_handshake()
        connection.request("POST", parts.path, body, dict(headers))
        response = connection.getresponse()
        answer = b""
        while len(answer) <= most and (chunk := response.read(_CHUNK)):
            answer += chunk
        if time.monotonic() >= end:
            raise late
        return response.status, answer[: most + 1]
    except (OSError, http.client.HTTPException, ValueError) as error:
        # A socket that was shut in time looks like one that the server has closed.
        raise (late if time.monotonic() >= end else _unreachable(host, port, error)) from None
    finally:
        watch.cancel()
        connection.close()


def _shut(link: socket.socket) -> None:
    """Let whoever reads from a socket go on."""
    try:
        socket.socket.shutdown(link, socket.SHUT_RDWR)
    except OSError:
        return


def _unreachable(host: str, port: int, error: Exception) -> Refused:
    words = " ".join(str(error).split()) or type(error).__name__
    return Refused("UNREACHABLE", f"{host}:{port} cannot be asked: {words[:200]}")
