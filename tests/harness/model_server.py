# SPDX-License-Identifier: Apache-2.0
"""A server on this machine that speaks the chat-completions protocol, well or badly."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

Reply = Callable[[BaseHTTPRequestHandler], None]


def completion(content: object) -> bytes:
    """Return the body of a valid answer with this text of the model."""
    message = {"role": "assistant", "content": content}
    return json.dumps(
        {"id": "1", "object": "chat.completion", "choices": [{"index": 0, "message": message}]}
    ).encode()


def says(*ranking: str, reason: str = "it fits") -> Reply:
    """Answer with a ranking."""
    return sends(completion(json.dumps({"ranking": ranking, "reason": reason})))


def sends(body: bytes, status: int = 200) -> Reply:
    """Answer with any body."""

    def reply(request: BaseHTTPRequestHandler) -> None:
        request.send_response(status)
        request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        request.wfile.write(body)

    return reply


def drips(data: bytes, ended: threading.Event) -> Reply:
    """Send a byte from time to time, for ever."""

    def reply(request: BaseHTTPRequestHandler) -> None:
        for byte in data:
            if ended.wait(0.05):
                return
            request.wfile.write(bytes([byte]))
            request.wfile.flush()

    return reply


@dataclass(eq=False)
class ModelServer:
    """The server of a test.

    Attributes:
        url: Its base URL.
        reply: How it answers requests.
        questions: Bodies of all requests so far.
        headers: Headers of all requests so far.
        ended: Set at the end of the test.
    """

    url: str = ""
    reply: Reply = field(default_factory=says)
    questions: list[Any] = field(default_factory=list)
    headers: list[dict[str, str]] = field(default_factory=list)
    ended: threading.Event = field(default_factory=threading.Event)


@contextmanager
def model_server() -> Iterator[ModelServer]:
    """Serve on a free port of 127.0.0.1 until the end of the test."""
    told = ModelServer()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            length = int(self.headers["Content-Length"])
            told.questions.append(json.loads(self.rfile.read(length)))
            told.headers.append(dict(self.headers))
            assert self.path == "/v1/chat/completions"
            with suppress(OSError):
                told.reply(self)

        def log_message(self, *_: object) -> None:
            """Log nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    told.url = f"http://127.0.0.1:{server.server_port}/v1"
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield told
    finally:
        told.ended.set()
        server.shutdown()
        server.server_close()
        thread.join(5.0)


def free_port() -> int:
    """Return a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
