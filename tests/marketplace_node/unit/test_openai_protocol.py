# SPDX-License-Identifier: Apache-2.0
"""Questions to a language model, and its answers, with a real server."""

from __future__ import annotations

import gzip
import json
import math
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneSpace
from market_harness import EXPRESS, GUIDE, SPACE, scene
from marketplace_node.external_ranking.http_client import HttpClient
from marketplace_node.external_ranking.openai_protocol import (
    MOST_BYTES,
    Bidder,
    Endpoint,
    answer,
    question,
    ranking,
)
from marketplace_node.round.decision import External
from model_server import ModelServer, completion, drips, free_port, model_server, sends

BIDDERS = (GUIDE, EXPRESS)
LIMIT_S = 20.0
"""Time limit of what takes no time on a machine that is not busy [s]."""

GOOD = json.dumps({"ranking": [EXPRESS, GUIDE], "reason": "quick"})

OWN_CERTIFICATE = """
-----BEGIN PRIVATE KEY-----
MIGHAgEAMBMGByqGSM49AgEGCCqGSM49AwEHBG0wawIBAQQg/TSa+iTUXZ/TGeXx
v+tN8OsWGUJ9SXFG1hnQMZVT5XqhRANCAARtIoW9FwXaviqN+0oLxhpzzqg4AVY0
Wiq3H3zZ26/zkxRhHjz1GUFkAjrPMAreCpegSLoZFvKyBS4usHR6uTqx
-----END PRIVATE KEY-----
-----BEGIN CERTIFICATE-----
MIIBkDCCATagAwIBAgIUHsVPLfyA+ZBaNAYPGWaILzz7PDUwCgYIKoZIzj0EAwIw
FDESMBAGA1UEAwwJbG9jYWxob3N0MCAXDTI2MTEyMTE1NDEyNVoYDzIxMjYxMDI4
MTU0MTI1WjAUMRIwEAYDVQQDDAlsb2NhbGhvc3QwWTATBgcqhkjOPQIBBggqhkjO
PQMBBwNCAARtIoW9FwXaviqN+0oLxhpzzqg4AVY0Wiq3H3zZ26/zkxRhHjz1GUFk
AjrPMAreCpegSLoZFvKyBS4usHR6uTqxo2QwYjAdBgNVHQ4EFgQUcBHUWbUC9Yhi
5k1+6d9x7wq2LWUwHwYDVR0jBBgwFoAUcBHUWbUC9Yhi5k1+6d9x7wq2LWUwDwYD
VR0TAQH/BAUwAwEB/zAPBgNVHREECDAGhwR/AAABMAoGCCqGSM49BAMCA0gAMEUC
ICzTDN6fHd1YZT8Z38tRSY1fGydH7+vcNEh6WZzDckFqAiEA825Hm0VQoqrmXh6J
4iIcysWRdgZ6kTgFbpeewaV5CAQ=
-----END CERTIFICATE-----
"""
"""Self-signed certificate and key for 127.0.0.1, only for this test."""


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with model_server() as running:
        yield running


@pytest.fixture
def client() -> Iterator[HttpClient]:
    client = HttpClient("http of a test")
    yield client
    client.close()


def post(
    client: HttpClient, url: str, limit_s: float = LIMIT_S, most: int = MOST_BYTES, **headers: str
) -> tuple[int, bytes]:
    asked = client.post(url, headers, b"{}", lambda *found: found, limit_s=limit_s, most=most)
    return asked.result(timeout=30.0)


def ask(client: HttpClient, server: ModelServer, limit_s: float = LIMIT_S) -> External:
    endpoint = Endpoint(base_url=server.url, model="small", key="secret")
    return answer(*post(client, endpoint.url, limit_s, **endpoint.headers()), BIDDERS)


def test_question_contains_scene_labels_and_descriptions() -> None:
    space = SceneSpace(
        parameters=tuple(
            replace(one, description=f"what {one.name} is", labels={5.0: "an older adult"})
            for one in SPACE.parameters
        )
    )
    bidder = Bidder(name=GUIDE, vector=(4.0, 1.5, 3.0), distance=1.5, description="Slow and loud")
    asked = question("small", space, scene("s1", 5.0, 1.0, math.nan), [bidder])
    told = json.loads(asked["messages"][1]["content"])

    assert (asked["model"], asked["temperature"], asked["stream"]) == ("small", 0, False)
    assert [message["role"] for message in asked["messages"]] == ["system", "user"]
    assert told["scene"]["values"][0] == {
        "name": "age",
        "from": 1.0,
        "to": 5.0,
        "value": 5.0,
        "meaning": "what age is",
        "labels": {"5": "an older adult"},
    }
    assert told["scene"]["values"][2]["value"] == "unknown"
    assert told["characters"] == [
        {
            "name": GUIDE,
            "profile": {"age": 4.0, "familiarity": 1.5, "mood": 3.0},
            "distance": 1.5,
            "description": "Slow and loud",
        }
    ]


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        f"```json\n{GOOD}\n```",
        f"Sure! Here you are: {GOOD} I hope it helps {{}}",
        f'{{not json}} {{"ranking": 1}} {GOOD}',
    ],
)
def test_ranking_is_found_bare_fenced_or_in_prose(content: str) -> None:
    assert ranking(content, BIDDERS) == External(ranking=(EXPRESS, GUIDE), message="quick")


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("", "NO_RANKING"),
        ("attentive_guide, of course", "NO_RANKING"),
        ('{"ranking": "attentive_guide"}', "NO_RANKING"),
        ('{"ranking": [1, 2]}', "NO_RANKING"),
        ('{"ranking": ["bob"]}', "UNKNOWN_AGENT"),
        ('{"ranking": [NaN]}', "NO_RANKING"),
        ("{" * 500_000, "NO_RANKING"),
        ('{"a":' * 100_000, "NO_RANKING"),
    ],
)
def test_hostile_model_text_is_refused_quickly(content: str, code: str) -> None:
    start = time.monotonic()
    with pytest.raises(Refused) as caught:
        ranking(content, BIDDERS)
    assert caught.value.code == code
    assert len(caught.value.reason) < 700
    assert time.monotonic() - start < LIMIT_S


@pytest.mark.parametrize(
    ("status", "body", "code"),
    [
        (200, b"<html>", "NOT_JSON"),
        (200, b"\xff\xfe", "NOT_JSON"),
        (200, b"[" * 100_000, "NOT_JSON"),
        (200, b"[]", "NO_RANKING"),
        (200, b'{"choices": []}', "NO_RANKING"),
        (200, b'{"choices": [{"message": {"content": null}}]}', "NO_RANKING"),
        (401, b'{"error": "bad key"}', "HTTP_ERROR"),
        (302, completion(GOOD), "HTTP_ERROR"),
        (200, completion("x" * 10_000_000), "TOO_LONG"),
    ],
)
def test_hostile_server_responses_are_refused(
    client: HttpClient, server: ModelServer, status: int, body: bytes, code: str
) -> None:
    server.reply = sends(body, status)
    with pytest.raises(Refused) as caught:
        ask(client, server)
    assert caught.value.code == code
    assert "secret" not in str(caught.value)


def test_valid_response_is_received_over_http(client: HttpClient, server: ModelServer) -> None:
    server.reply = sends(completion(GOOD))

    assert ask(client, server).ranking == (EXPRESS, GUIDE)
    assert server.headers[0]["Authorization"] == "Bearer secret"


def test_response_is_not_decompressed(client: HttpClient, server: ModelServer) -> None:
    packed = gzip.compress(b"x" * 1000)

    def reply(request: Any) -> None:
        request.send_response(200)
        request.send_header("Content-Encoding", "gzip")
        request.send_header("Content-Length", str(len(packed)))
        request.end_headers()
        request.wfile.write(packed)

    server.reply = reply
    assert post(client, Endpoint(base_url=server.url, model="small").url) == (200, packed)
    assert server.headers[0]["Accept-Encoding"] == "identity"


@pytest.mark.parametrize("status_line", [b"", b"HTTP/1.0 200 OK\r\nContent-Length: 900\r\n\r\n"])
def test_slowly_sending_server_is_abandoned_in_time(
    client: HttpClient, server: ModelServer, status_line: bytes
) -> None:
    def reply(request: Any) -> None:
        request.wfile.write(status_line)
        drips(b"HTTP/1.0 200 OK\r\n" * 100, server.ended)(request)

    server.reply = reply
    start = time.monotonic()
    with pytest.raises(Refused, match=r"^NO_ANSWER:"):
        ask(client, server, limit_s=0.3)
    assert time.monotonic() - start < LIMIT_S, "a byte every 0.05 s must not keep it"


def test_untrusted_certificate_is_refused(client: HttpClient, tmp_path: Path) -> None:
    (tmp_path / "own.pem").write_text(OWN_CERTIFICATE)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "own.pem")
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            with suppress(OSError), context.wrap_socket(listening.accept()[0], server_side=True):
                pytest.fail("it shook hands with a server that nobody vouches for")

        serving = threading.Thread(target=serve, daemon=True)
        serving.start()
        with pytest.raises(Refused, match=r"(?i)certificate"):
            post(client, f"https://127.0.0.1:{listening.getsockname()[1]}/v1")
        serving.join(5.0)


def test_unreachable_server_is_named(client: HttpClient) -> None:
    port = free_port()
    with pytest.raises(Refused, match=rf"^UNREACHABLE:.*127\.0\.0\.1:{port}"):
        post(client, f"http://127.0.0.1:{port}/v1")


@pytest.mark.parametrize(
    ("host", "codes"), [("127.0.0.1.", "UNREACHABLE"), ("127.0.0.1", "UNREACHABLE|NO_ANSWER")]
)
def test_https_needs_a_valid_name_and_tls(
    client: HttpClient, server: ModelServer, host: str, codes: str
) -> None:
    port = server.url.split(":")[2].split("/")[0]
    with pytest.raises(Refused, match=rf"^({codes}):"):
        post(client, f"https://{host}:{port}/v1", limit_s=2.0)


def test_slow_name_resolution_is_abandoned(
    client: HttpClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    over = threading.Event()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: over.wait(20.0) and [])
    start = time.monotonic()
    with pytest.raises(Refused, match=r"^NO_ANSWER:"):
        post(client, "http://x.example/v1", limit_s=0.1)
    took = time.monotonic() - start
    over.set()

    assert took < 10.0


def test_several_requests_run_concurrently(client: HttpClient, server: ModelServer) -> None:
    together = threading.Barrier(3)

    def reply(request: Any) -> None:
        together.wait(10.0)
        sends(completion(GOOD))(request)

    server.reply = reply
    url = Endpoint(base_url=server.url, model="small").url
    asked = [
        client.post(url, {}, b"{}", lambda *found: found, limit_s=LIMIT_S, most=MOST_BYTES)
        for _ in range(3)
    ]
    assert [one.result(timeout=30.0) for one in asked] == [(200, completion(GOOD))] * 3


def test_closing_client_abandons_pending_requests(client: HttpClient, server: ModelServer) -> None:
    server.reply = drips(b"HTTP/1.0 200 OK\r\n" * 100, server.ended)
    url = Endpoint(base_url=server.url, model="small").url
    asked = client.post(url, {}, b"{}", lambda *found: found, limit_s=60.0, most=10)
    start = time.monotonic()
    client.close()
    with pytest.raises(CancelledError):
        asked.result(timeout=10.0)
    assert time.monotonic() - start < LIMIT_S


@pytest.mark.parametrize(
    ("base_url", "model", "key", "code"),
    [
        ("", "m", "", "BAD_ADDRESS"),
        ("localhost:11434", "m", "", "BAD_ADDRESS"),
        ("ftp://localhost/v1", "m", "", "BAD_ADDRESS"),
        ("http://localhost:99999999/v1", "m", "", "BAD_ADDRESS"),
        ("http://me:pass@localhost/v1", "m", "", "BAD_ADDRESS"),
        ("http://[::1/v1", "m", "", "BAD_ADDRESS"),
        ("http://localhost/v1", "", "", "EMPTY"),
        ("https://api.example.org/v1", "m", "two\r\nlines", "BAD_KEY"),
        ("http://api.example.org/v1", "m", "secret", "INSECURE"),
    ],
)
def test_unusable_endpoint_is_refused(base_url: str, model: str, key: str, code: str) -> None:
    with pytest.raises(Refused) as caught:
        Endpoint(base_url=base_url, model=model, key=key)
    assert caught.value.code == code
    assert not key or key not in str(caught.value)


def test_api_key_is_never_shown() -> None:
    endpoint = Endpoint(base_url="https://api.example.org/v1/", model="m", key="secret")
    assert "secret" not in repr(endpoint)
    assert endpoint.url == "https://api.example.org/v1/chat/completions"


def test_the_market_starts_without_the_http_client() -> None:
    code = "import sys; sys.modules['aiohttp'] = None; import marketplace_node.node"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60.0)
