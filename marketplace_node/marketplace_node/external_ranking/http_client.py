# SPDX-License-Identifier: Apache-2.0
"""HTTP client with a hard deadline and a bounded answer, in a thread of its own."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from threading import Thread
from typing import TypeVar
from urllib.parse import urlsplit

import aiohttp

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

_T = TypeVar("_T")


class HttpClient:
    """Sends requests from an event loop in a thread, because rclpy executors run no asyncio.

    It checks certificates, follows no redirects, uses no proxy and decompresses nothing, so a
    small answer cannot become a large one.
    """

    def __init__(self, name: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def post(
        self,
        url: str,
        headers: Mapping[str, str],
        body: bytes,
        read: Callable[[int, bytes], _T],
        *,
        limit_s: float,
        most: int,
    ) -> Future[_T]:
        """Send a POST request; return a future with the result of ``read``.

        The future raises ``Refused`` (``UNREACHABLE`` or ``NO_ANSWER``, whose texts contain no
        headers) and every exception that ``read`` raises.

        Args:
            url: ``http`` or ``https``.
            headers: Headers of the request.
            body: Body of the request.
            read: Called with status and body of the answer, in the thread of the client.
            limit_s: Time limit of the whole request [s].
            most: Largest answer [bytes]; of a larger one ``read`` gets one byte more than this.
        """

        async def ask() -> _T:
            return read(*await _post(url, headers, body, limit_s=limit_s, most=most))

        return asyncio.run_coroutine_threadsafe(ask(), self._loop)

    def close(self) -> None:
        """Abandon the requests in progress without waiting for them."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._loop.stop)

    def _run(self) -> None:
        try:
            self._loop.run_forever()
            for task in asyncio.all_tasks(self._loop):
                task.cancel()
                self._loop.run_until_complete(asyncio.wait([task]))
        finally:
            self._loop.close()


async def _post(
    url: str, headers: Mapping[str, str], body: bytes, *, limit_s: float, most: int
) -> tuple[int, bytes]:
    parts = urlsplit(url)
    try:
        # Not the timeout of aiohttp, which is rounded up to whole seconds.
        async with (
            asyncio.timeout(limit_s),
            aiohttp.ClientSession(
                timeout=aiohttp.ClientTimeout(total=None), auto_decompress=False
            ) as session,
            session.post(
                url,
                headers={"Accept-Encoding": "identity", **headers},
                data=body,
                allow_redirects=False,
            ) as response,
        ):
            answer = bytearray()
            while len(answer) <= most and (chunk := await response.content.readany()):
                answer += chunk
            return response.status, bytes(answer[: most + 1])
    except TimeoutError:
        raise Refused(
            RefusalCode.NO_ANSWER, f"{parts.hostname} did not answer within {limit_s:.2g} s"
        ) from None
    except (aiohttp.ClientError, OSError, ValueError) as error:
        port = parts.port or (443 if parts.scheme == "https" else 80)
        reason = " ".join(str(error).split()) or type(error).__name__
        raise Refused(
            RefusalCode.UNREACHABLE, f"{parts.hostname}:{port} cannot be asked: {reason[:200]}"
        ) from None
