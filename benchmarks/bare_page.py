# SPDX-License-Identifier: Apache-2.0
"""A minimal page of node changes: one box per node, updated by every message.

It prints its address once it can be opened.
"""

from __future__ import annotations

import asyncio
import json
import threading
from typing import Any

import rclpy
from aiohttp import web
from rclpy.node import Node

from bare import EVENTS, LATCHED, spin
from bt_agents_interfaces.msg import Trees, TreeStatus

PAGE = """<!doctype html><title>bare</title><svg id="all" width="800"></svg><script>
const boxes = new Map();
new WebSocket(`ws://${location.host}/socket`).onmessage = (event) => {
  const {nodes, changes} = JSON.parse(event.data);
  for (const path of nodes) {
    const box = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    box.setAttribute("class", "node");
    box.setAttribute("data-path", path);
    box.setAttribute("width", 170);
    box.setAttribute("height", 36);
    box.setAttribute("y", 40 * boxes.size);
    boxes.set(path, box);
    document.getElementById("all").append(box);
  }
  for (const [path, status, message] of changes) {
    const box = boxes.get(path);
    box.setAttribute("fill", ["grey", "orange", "green", "red"][status]);
    box.setAttribute("title", message);
  }
};
</script>"""


class BarePage(Node):
    """Passes each message to all browsers."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__("bare_page", enable_rosout=False)
        self._loop = loop
        self._sockets: set[web.WebSocketResponse] = set()
        self._sending: set[asyncio.Future[None]] = set()
        self._nodes: list[str] = []
        self.create_subscription(TreeStatus, "agents/status", self._on_status, EVENTS)
        self.create_subscription(Trees, "agents/trees", self._on_trees, LATCHED)

    def _on_trees(self, message: Any) -> None:
        self._nodes = [node.path for node in message.trees[0].nodes]

    def _on_status(self, message: Any) -> None:
        changes = [(one.path, one.status, one.message) for one in message.changes]
        text = json.dumps({"nodes": [], "changes": changes})
        self._loop.call_soon_threadsafe(self._send, text)

    def _send(self, text: str) -> None:
        for socket in self._sockets:
            self._sending.add(sent := asyncio.ensure_future(socket.send_str(text)))
            sent.add_done_callback(self._sending.discard)

    async def page(self, _request: web.Request) -> web.Response:
        return web.Response(text=PAGE, content_type="text/html")

    async def socket(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(compress=False)
        await socket.prepare(request)
        await socket.send_str(json.dumps({"nodes": self._nodes, "changes": []}))
        self._sockets.add(socket)
        try:
            async for _ in socket:
                pass
        finally:
            self._sockets.discard(socket)
        return socket


async def main() -> None:
    """Serve until the parent ends."""
    rclpy.init()
    node = BarePage(asyncio.get_running_loop())
    application = web.Application()
    application.add_routes([web.get("/", node.page), web.get("/socket", node.socket)])
    runner = web.AppRunner(application, access_log=None)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    print(f"studio: http://127.0.0.1:{runner.addresses[0][1]}/", flush=True)
    thread = threading.Thread(target=spin, args=(node,), daemon=True)
    thread.start()
    while thread.is_alive():
        await asyncio.sleep(0.1)


if __name__ == "__main__":
    asyncio.run(main())
