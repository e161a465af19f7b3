# SPDX-License-Identifier: Apache-2.0
"""A small client of the YAML language server that editors use."""

from __future__ import annotations

import json
import subprocess
import threading
from pathlib import Path
from queue import Queue
from typing import Any

from npm_packages import installed_packages, program

PACKAGE = "yaml-language-server"
ANSWER_S = 60


def installed_server() -> list[str]:
    """Return the command that starts the server; install the server first if necessary."""
    program_file = installed_packages() / PACKAGE / "bin" / PACKAGE
    return [program("node"), str(program_file), "--stdio"]


class LanguageServer:
    """One running server and its open documents."""

    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._messages: Queue[dict[str, Any]] = Queue()
        self._last_id = 0
        self._opened = 0
        self._problems: dict[str, list[dict[str, Any]]] = {}
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        capabilities = {
            "textDocument": {
                "completion": {
                    "completionItem": {"snippetSupport": True, "documentationFormat": ["markdown"]}
                },
                "hover": {"contentFormat": ["markdown"]},
                "publishDiagnostics": {},
            },
            "workspace": {"configuration": True},
        }
        self._ask("initialize", {"processId": None, "rootUri": None, "capabilities": capabilities})
        self._tell("initialized", {})

    def close(self) -> None:
        """End the server."""
        try:
            self._ask("shutdown", None)
            self._tell("exit", None)
            self._process.wait(timeout=10)
        finally:
            with self._process:
                self._process.kill()
                self._listener.join()

    def problems(self, path: Path, text: str) -> list[str]:
        """Open a text as a file and return the server's diagnostics."""
        uri = self._open(path, text)
        while uri not in self._problems:
            self._handle(self._messages.get(timeout=ANSWER_S))
        return [
            f"{one['range']['start']['line'] + 1}: {one['message']}" for one in self._problems[uri]
        ]

    def completions(self, path: Path, text: str) -> dict[str, dict[str, Any]]:
        """Return the server's completions at ``▮`` in the text, by label."""
        answer = self._ask_at("textDocument/completion", path, text)
        items = answer if isinstance(answer, list) else answer["items"]
        return {item["label"]: item for item in items}

    def hover(self, path: Path, text: str) -> str:
        """Return the server's hover text for the word at ``▮`` in the text."""
        answer = self._ask_at("textDocument/hover", path, text)
        return "" if answer is None else str(answer["contents"]["value"])

    def _ask_at(self, method: str, path: Path, text: str) -> Any:
        before, _, after = text.partition("▮")
        document = {"uri": self._open(path, before + after)}
        *lines, line = before.split("\n")
        place = {"line": len(lines), "character": len(line)}
        return self._ask(method, {"textDocument": document, "position": place})

    def _open(self, path: Path, text: str) -> str:
        # Each text gets a name of its own: the server remembers its last diagnostics.
        self._opened += 1
        uri = path.with_stem(f"{path.stem}_{self._opened}").as_uri()
        document = {"uri": uri, "languageId": "yaml", "version": 1, "text": text}
        self._tell("textDocument/didOpen", {"textDocument": document})
        return uri

    def _ask(self, method: str, parameters: object) -> Any:
        self._last_id += 1
        self._send({"id": self._last_id, "method": method, "params": parameters})
        while True:
            message = self._messages.get(timeout=ANSWER_S)
            if message.get("id") == self._last_id and "method" not in message:
                assert "error" not in message, message
                return message.get("result")
            self._handle(message)

    def _tell(self, method: str, parameters: object) -> None:
        self._send({"method": method, "params": parameters})

    def _handle(self, message: dict[str, Any]) -> None:
        """Keep diagnostics, and answer the server's questions to its editor."""
        if message.get("method") == "textDocument/publishDiagnostics":
            parameters = message["params"]
            self._problems[parameters["uri"]] = parameters["diagnostics"]
        elif message.get("method") == "workspace/configuration":
            asked = message["params"]["items"]
            settings = [_SETTINGS.get(one.get("section"), {}) for one in asked]
            self._send({"id": message["id"], "result": settings})
        elif "id" in message and "method" in message:
            self._send({"id": message["id"], "result": None})

    def _send(self, content: dict[str, Any]) -> None:
        body = json.dumps({"jsonrpc": "2.0", **content}).encode()
        pipe = self._process.stdin
        assert pipe is not None
        pipe.write(b"Content-Length: %d\r\n\r\n" % len(body) + body)
        pipe.flush()

    def _listen(self) -> None:
        pipe = self._process.stdout
        assert pipe is not None
        while True:
            length = 0
            while (line := pipe.readline().strip()) != b"":
                name, _, value = line.partition(b":")
                if name.lower() == b"content-length":
                    length = int(value)
            if not length:
                return
            self._messages.put(json.loads(pipe.read(length)))


_SETTINGS = {
    # Only the schemas that the files name, without look-ups on the net.
    "yaml": {"schemaStore": {"enable": False}},
    "[yaml]": {"editor.tabSize": 2, "editor.insertSpaces": True},
}
