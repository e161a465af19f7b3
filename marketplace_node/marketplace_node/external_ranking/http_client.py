# SPDX-License-Identifier: Apache-2.0
"""One HTTP request that ends in time, whatever the server does; blocks, so in a thread only."""

from __future__ import annotations

import http.client
import socket
import ssl
import threading
import time
from collections.abc import Mapping
from queue import Empty, SimpleQueue
from typing import Any
from urllib.parse import urlsplit

from bt_agents_core.errors import Refused

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
        link = _connected(host, port, end)
    except TimeoutError:
        raise late from None
    except (OSError, ValueError) as error:
        raise _unreachable(host, port, error) from None
    if parts.scheme == "https":
        try:
            link = ssl.create_default_context().wrap_socket(
                link, server_hostname=host, do_handshake_on_connect=False
            )
        except (OSError, ValueError) as error:
            link.close()
            raise _unreachable(host, port, error) from None
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


def _connected(host: str, port: int, end: float) -> socket.socket:
    """Return a socket to the first address of a host that answers.

    Raises:
        TimeoutError: None did before ``end``; each may take its share of what is left.
        OSError, ValueError: There is none, or all refuse.
    """
    addresses = _addresses(host, port, end)
    failure: OSError = OSError("it has no address")
    for index, (family, kind, protocol, _, address) in enumerate(addresses):
        left = end - time.monotonic()
        if left <= 0.0:
            raise TimeoutError
        link = socket.socket(family, kind, protocol)
        try:
            link.settimeout(left / (len(addresses) - index))
            link.connect(address)
            link.settimeout(max(0.001, end - time.monotonic()))
            return link
        except OSError as error:
            failure = error
            link.close()
    raise failure


def _addresses(host: str, port: int, end: float) -> list[Any]:
    """Look a name up in a thread of its own, as nothing else ends that in time."""
    found: SimpleQueue[list[Any] | OSError | ValueError] = SimpleQueue()

    def look_up() -> None:
        try:
            found.put(list(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)))
        except (OSError, ValueError) as error:
            found.put(error)

    threading.Thread(target=look_up, name="name lookup", daemon=True).start()
    try:
        answer = found.get(timeout=max(0.0, end - time.monotonic()))
    except Empty:
        raise TimeoutError from None
    if isinstance(answer, Exception):
        raise answer
    return answer


def _shut(link: socket.socket) -> None:
    """Let whoever reads from a socket go on."""
    try:
        socket.socket.shutdown(link, socket.SHUT_RDWR)
    except OSError:
        return


def _unreachable(host: str, port: int, error: Exception) -> Refused:
    words = " ".join(str(error).split()) or type(error).__name__
    return Refused("UNREACHABLE", f"{host}:{port} cannot be asked: {words[:200]}")
