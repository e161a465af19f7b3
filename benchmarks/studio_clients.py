# SPDX-License-Identifier: Apache-2.0
"""Clients of a studio without a browser: ``studio_clients.py ADDRESS READING HANGING``.

Hanging clients open their connection and never read. It prints a line once all are connected, and
then the time from each message of the probe until a client receives it [s].
"""

from __future__ import annotations

import asyncio
import json
import re
import sys
import time
from urllib.parse import urldefrag

from aiohttp import ClientSession, ClientWebSocketResponse, CookieJar

_SENT = re.compile(r'"(\d{10}\.\d{6})"')


async def _open(session: ClientSession) -> ClientWebSocketResponse:
    socket = await session.ws_connect("/api/socket", max_msg_size=0, autoping=True)
    hello = json.loads(await socket.receive_str())
    first = {"type": "resume", "version": hello["version"], "studio": "", "sequence": 0}
    await socket.send_str(json.dumps(first))
    return socket


async def _read(socket: ClientWebSocketResponse) -> None:
    before = ""
    async for message in socket:
        sent = _SENT.search(str(message.data))
        if sent is not None and sent[1] != before:
            before = sent[1]
            print(time.time() - float(before), flush=True)


async def main(address: str, reading: int, hanging: int) -> None:
    """Stay connected until the process is killed."""
    base, token = urldefrag(address)
    origin = base.rstrip("/")
    async with ClientSession(
        origin, headers={"Origin": origin}, cookie_jar=CookieJar(unsafe=True)
    ) as session:
        async with session.post("/api/session", json={"token": token}) as answer:
            answer.raise_for_status()
        sockets = [await _open(session) for _ in range(reading + hanging)]
        print("connected", flush=True)
        await asyncio.gather(*(_read(one) for one in sockets[:reading]), asyncio.sleep(3600))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
