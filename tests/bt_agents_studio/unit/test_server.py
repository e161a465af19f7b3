# SPDX-License-Identifier: Apache-2.0
"""The server of the studio: pages, sockets, changes, and hostile requests over a real port."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientError, ClientSession, ClientWebSocketResponse, CookieJar, WSMsgType

from bt_agents_lab.recorder.file import JournalFile
from bt_agents_lab.recorder.reading import MOST_FURTHER
from bt_agents_studio import server
from bt_agents_studio.access import LARGEST_BODY, SessionRole, cookie_name
from bt_agents_studio.connections import MOST_CONNECTIONS
from bt_agents_studio.protocol import VERSION
from bt_agents_studio.records import MoodRecord, PartRecord, RobotActRecord, RobotRecord
from bt_agents_studio.server import MOST_CLIENTS, MOST_EXCERPTS
from journal_fixture import recorded, ticks
from studio_harness import ServedStudio, run_served, served, serving

_Connection = tuple[asyncio.StreamReader, asyncio.StreamWriter]

RESUME = {"type": "resume", "version": VERSION, "studio": "", "sequence": 0}
NEWEST_S = 2.0**40


def _mood(mood: float, at_s: float = 1.0) -> MoodRecord:
    return MoodRecord(at_s=at_s, mood=mood)


def _seek(at_s: float, source: str = "") -> dict[str, Any]:
    return {"type": "seek", "source": source, "at_s": at_s}


async def _refusal(answer: Any) -> tuple[int, str]:
    """Return the status and the code of a refusal."""
    return answer.status, (await answer.json())["code"]


async def _next(socket: ClientWebSocketResponse) -> dict[str, Any]:
    """Return the next message that is not a beat."""
    while True:
        message = await socket.receive(timeout=10)
        assert message.type is WSMsgType.TEXT, message
        received = dict(json.loads(message.data))
        if received["type"] != "beat":
            return received


async def _open(client: ClientSession) -> ClientWebSocketResponse:
    """Open a page, and return its socket after the first snapshot."""
    socket = await client.ws_connect("/api/socket")
    await _next(socket)
    await socket.send_json(RESUME)
    await _next(socket)
    return socket


@served
async def test_page_gets_snapshot_then_deltas_and_can_resume(one: ServedStudio) -> None:
    one.put("moods", "1", _mood(3.0))
    async with one.client(SessionRole.VIEW) as client:
        async with client.ws_connect("/api/socket") as socket:
            hello = await _next(socket)
            assert (hello["type"], hello["role"]) == ("hello", "view")
            await socket.send_json(RESUME)
            snapshot = await _next(socket)
            assert snapshot["entries"] == {"moods": {"1": {"at_s": 1.0, "mood": 3.0}}}
            one.put("moods", "2", _mood(4.0, 2.0))
            delta = await _next(socket)
            assert delta["changes"] == [["moods", "2", {"at_s": 2.0, "mood": 4.0}]]
        one.put("moods", "1", _mood(5.0))
        async with client.ws_connect("/api/socket") as socket:
            hello = await _next(socket)
            known = {"studio": hello["studio"], "sequence": delta["sequence"]}
            await socket.send_json(RESUME | known)
            delta = await _next(socket)
            assert delta["changes"] == [["moods", "1", {"at_s": 1.0, "mood": 5.0}]]


@served
async def test_slow_page_gets_newest_value_of_each_entry(one: ServedStudio) -> None:
    one.put("moods", "1", _mood(0.0, 0.0))
    async with one.client(SessionRole.VIEW) as client:
        socket = await _open(client)
        for number in range(1000):
            one.put("moods", "1", _mood(1.0, float(number)))
        received = await _next(socket)
        while received["changes"][0][2]["at_s"] < 999:
            received = await _next(socket)
        assert received["sequence"] == one.studio.store.sequence


@served
async def test_earlier_moment_stays_until_page_follows_again(one: ServedStudio) -> None:
    clock = iter(range(1000, 2000))
    one.studio._clock = lambda: float(next(clock))
    one.put("moods", "1", _mood(1.0))
    one.put("moods", "1", _mood(2.0))
    async with one.client(SessionRole.VIEW) as client:
        socket = await _open(client)
        await socket.send_json(_seek(1000))
        assert (await _next(socket))["entries"]["moods"]["1"]["mood"] == 1.0
        one.put("moods", "1", _mood(3.0))
        await socket.send_json({"type": "follow"})
        now = await _next(socket)
        assert (now["at_s"], now["entries"]["moods"]["1"]["mood"]) == (None, 3.0)


@served
async def test_present_goes_on_beside_earlier_moment(one: ServedStudio) -> None:
    async with one.client(SessionRole.VIEW) as client, client.ws_connect("/api/socket") as socket:
        one.put("parts", "robot", PartRecord(alive=True, seen_s=1.0))
        await _next(socket)
        await socket.send_json(RESUME)
        sequence = (await _next(socket))["sequence"]
        await socket.send_json(_seek(1))
        assert (await _next(socket))["at_s"] == 1
        one.put("moods", "1", _mood(3.0))
        one.put("parts", "robot", PartRecord(alive=False, seen_s=1.0))
        present = await _next(socket)
        assert present == {
            "type": "present",
            "changes": [["parts", "robot", {"alive": False, "seen_s": 1.0}]],
            "is_whole": False,
        }
        await socket.send_json({"type": "follow"})
        now = await _next(socket)
        assert (now["type"], now["entries"].keys()) == ("snapshot", {"moods", "parts"})
        assert now["sequence"] > sequence


@served
async def test_page_returning_to_earlier_moment_gets_whole_present(one: ServedStudio) -> None:
    one.put("parts", "robot", PartRecord(alive=True, seen_s=1.0))
    one.put("moods", "1", _mood(3.0))
    async with one.client(SessionRole.VIEW) as client, client.ws_connect("/api/socket") as socket:
        await _next(socket)
        await socket.send_json(RESUME)
        await socket.send_json(_seek(1))
        received = await _next(socket)
        while received["type"] != "present":
            received = await _next(socket)
        assert received["is_whole"]
        assert [change[:2] for change in received["changes"]] == [["parts", "robot"]]


@served
async def test_quiet_studio_beats_whatever_the_page_does(
    one: ServedStudio, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "BEAT_S", 0.01)
    async with (
        one.client(SessionRole.PERSON) as client,
        client.ws_connect("/api/socket") as socket,
    ):
        assert (await _next(socket))["type"] == "hello"
        assert await socket.receive_json(timeout=10) == {"type": "beat"}
        await socket.send_json(RESUME)
        assert (await _next(socket))["type"] == "snapshot"
        # Changes that this session may not see cause no message.
        one.put("moods", "1", _mood(3.0))
        for _ in range(3):
            assert await socket.receive_json(timeout=10) == {"type": "beat"}


@served
async def test_missing_journal_is_reported_and_page_continues(one: ServedStudio) -> None:
    one.put("moods", "1", _mood(1.0))
    async with one.client(SessionRole.VIEW) as client:
        socket = await _open(client)
        await socket.send_json(_seek(1, "../ledger.sqlite"))
        assert (await _next(socket))["code"] == "NO_JOURNAL"
        assert (await _next(socket))["at_s"] is None


async def _until(condition: Callable[[], object]) -> None:
    """Wait until a condition holds; only the whole test has a time limit."""
    while not condition():
        await asyncio.sleep(0.01)


def _journal(folder: Path, messages: int = 2) -> JournalFile:
    file = JournalFile(folder / "journal-2026-03-01_001.mcap")
    for number in range(1, messages + 1):
        file.add(recorded(number), number)
    file.flush()
    return file


def _worker(one: ServedStudio) -> asyncio.subprocess.Process:
    """Return the process that reads the recordings."""
    return one.server._recordings._process


@served
async def test_reading_delays_no_other_page(one: ServedStudio, tmp_path: Path) -> None:
    seek = _seek(NEWEST_S, _journal(tmp_path).path.name)
    one.put("moods", "1", _mood(1.0))
    async with one.client(SessionRole.VIEW) as client:
        reading, other = await _open(client), await _open(client)
        await reading.send_json(seek)
        moment = await _next(reading)
        assert moment["source"] == seek["source"]
        [run] = moment["entries"]["runs"].values()
        assert run["tick"] == 2
        worker = _worker(one)
        worker.send_signal(signal.SIGSTOP)
        await reading.send_json(seek | {"at_s": 2.5})
        await _until(lambda: one.server._reading)
        one.put("moods", "1", _mood(2.0))
        assert (await _next(other))["changes"][0][2]["mood"] == 2.0
        await reading.send_json({"type": "follow"})
        assert (await _next(reading))["at_s"] is None
        worker.kill()


@served
async def test_large_recording_is_shown_early(one: ServedStudio, tmp_path: Path) -> None:
    messages = MOST_FURTHER + 1
    file = _journal(tmp_path, messages)
    async with one.client(SessionRole.VIEW) as client:
        socket = await _open(client)
        await socket.send_json(_seek(NEWEST_S, file.path.name))
        for is_whole, tick in ((False, MOST_FURTHER), (True, messages)):
            moment = await _next(socket)
            [run] = moment["entries"]["runs"].values()
            assert (moment["is_whole"], run["tick"]) == (is_whole, tick)


@served
async def test_observers_get_timeline_of_recording(one: ServedStudio, tmp_path: Path) -> None:
    address = f"/api/journals/{_journal(tmp_path).path.name}/events"
    async with one.client(SessionRole.VIEW) as client:
        answer = await client.get(address)
        assert (answer.status, (await answer.json())["events"]) == (200, [])
        (tmp_path / "torn").mkdir()
        (tmp_path / "torn" / "metadata.yaml").write_text("torn")
        assert await _refusal(await client.get("/api/journals/torn/events")) == (400, "UNREADABLE")


@served
async def test_messages_of_span_are_sent_to_observers(one: ServedStudio, tmp_path: Path) -> None:
    address = f"/api/journals/{_journal(tmp_path).path.name}/messages"
    refused = {
        "?from=9&to=9": (400, "OUT_OF_RANGE"),
        "?from=0": (400, "BAD_FIELD"),
        "?from=nan&to=3": (400, "BAD_FIELD"),
        "?from=0&to=1e99": (400, "BAD_FIELD"),
        "?from=0&to=3x": (400, "BAD_FIELD"),
    }
    async with one.client(SessionRole.VIEW) as client:
        for query, expected in refused.items():
            assert await _refusal(await client.get(address + query)) == expected, query
        answer = await client.get(f"{address}?from=2.5&to=3")
        assert answer.status == 200
        assert answer.headers["Content-Disposition"] == (
            'attachment; filename="journal-2026-03-01_001-excerpt.mcap"'
        )
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        (tmp_path / "got.mcap").write_bytes(await answer.read())
    assert ticks(tmp_path / "got.mcap") == [2]


@served
async def test_no_more_excerpts_at_a_time_than_allowed(
    one: ServedStudio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "files"))
    (tmp_path / "files").mkdir()
    address = f"/api/journals/{_journal(tmp_path).path.name}/messages?from=2&to=3"
    async with one.client(SessionRole.VIEW) as client:
        assert (await client.get(address)).status == 200
        worker = _worker(one)
        worker.send_signal(signal.SIGSTOP)
        asked = [asyncio.create_task(client.get(address)) for _ in range(MOST_EXCERPTS)]
        await _until(lambda: len(os.listdir(tmp_path / "files")) == MOST_EXCERPTS)
        assert await _refusal(await client.get(address)) == (503, "BUSY")
        worker.send_signal(signal.SIGCONT)
        assert [(await one).status for one in asked] == [200] * MOST_EXCERPTS
        assert (await client.get(address)).status == 200
        # No file of them remains.
        assert os.listdir(tmp_path / "files") == []


@served
async def test_excerpt_that_nobody_reads_is_given_up(
    one: ServedStudio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "SEND_S", 0.5)
    file = _journal(tmp_path)
    for number in range(3, 19):
        file.add(recorded(number, tip=os.urandom(500_000).hex()), number)
    file.flush()
    line = f"GET /api/journals/{file.path.name}/messages?from=2&to=99 HTTP/1.1"
    cookie = f"{cookie_name(one.host)}={one.session(SessionRole.VIEW)}"
    reader, writer = await asyncio.open_connection("127.0.0.1", one.port)
    writer.write(f"{line}\r\nHost: {one.host}\r\nCookie: {cookie}\r\n\r\n".encode())
    head = await reader.readuntil(b"\r\n\r\n")
    assert b" 200 " in head
    await _until(lambda: one.server._excerpts._value == MOST_EXCERPTS)
    length = head.lower().partition(b"content-length: ")[2].split()[0]
    assert len(await reader.read()) < int(length)
    writer.close()


@served
async def test_killed_worker_is_reported_and_replaced(one: ServedStudio, tmp_path: Path) -> None:
    seek = _seek(NEWEST_S, _journal(tmp_path).path.name)
    one.put("moods", "1", _mood(1.0))
    async with one.client(SessionRole.VIEW) as client:
        page = await _open(client)
        await page.send_json(seek)
        first = await _next(page)
        worker = _worker(one)
        worker.send_signal(signal.SIGSTOP)
        await page.send_json(seek | {"at_s": 2.5})
        await _until(lambda: one.server._reading)
        worker.kill()
        failure = await _next(page)
        assert (failure["type"], failure["code"]) == ("failure", "UNREADABLE")
        assert (await _next(page))["at_s"] is None
        # So is one that ends between moments.
        for _ in range(2):
            await page.send_json(seek)
            assert (await _next(page))["entries"] == first["entries"]
            worker = _worker(one)
            worker.kill()
            await worker.wait()


@served
async def test_operation_is_forwarded_to_service_and_answer_returned(one: ServedStudio) -> None:
    async with one.client(SessionRole.OPERATE) as client:
        answer = await client.post("/api/do/cancel", json={"reason": "enough"})
        assert await answer.json() == {"accepted": True, "code": "", "message": "done"}
    assert one.caller.calls == [("marketplace/cancel", {"reason": "enough"})]


@served
async def test_person_sees_only_current_robot_state(one: ServedStudio) -> None:
    one.put("robot", "", _robot("Hello"))
    one.put("moods", "1", _mood(3.0))
    async with one.client(SessionRole.PERSON) as client:
        state = await (await client.get("/api/state")).json()
        assert state.keys() == {"sequence", "robot"}
        async with client.ws_connect("/api/socket") as socket:
            assert (await _next(socket))["role"] == "person"
            await socket.send_json(RESUME)
            assert (await _next(socket))["entries"].keys() == {"robot"}
            one.put("moods", "2", _mood(4.0))
            await socket.send_json(_seek(1))
            assert (await _next(socket))["code"] == "FORBIDDEN"
            one.put("robot", "", _robot("Goodbye"))
            assert [one[0] for one in (await _next(socket))["changes"]] == ["robot"]


def _robot(words: str) -> RobotRecord:
    act = RobotActRecord(
        at_s=1.0, number=1, kind="SAY", text=words, clip="", choices=(), rate=1.0, waiting=False
    )
    return RobotRecord(acts=(act,), light="off", light_blinks=False, sound="", sounds=0)


@served
async def test_session_cookie_is_http_only_and_same_site(one: ServedStudio) -> None:
    token = one.access.token(SessionRole.OPERATE)
    async with one.client() as client:
        answer = await client.post("/api/session", json={"token": token})
        cookie = answer.headers["Set-Cookie"].split("; ")
        assert {"HttpOnly", "SameSite=Strict"} <= {*cookie}
        assert (await client.get("/api/state")).status == 200
        key = {"Authorization": f"Bearer {(await answer.json())['key']}"}
        assert (await client.delete("/api/session", headers=key)).status == 200
        assert (await client.get("/api/state")).status == 401


@served
async def test_studios_on_one_host_keep_separate_session_cookies(one: ServedStudio) -> None:
    jar = CookieJar(unsafe=True)
    async with serving(ServedStudio()) as other, ClientSession(cookie_jar=jar) as browser:
        for studio in (one, other):
            answer = await browser.post(
                f"{studio.origin}/api/session",
                json={"token": studio.access.token(SessionRole.VIEW)},
                headers={"Origin": studio.origin},
            )
            assert answer.status == 200
        for studio in (one, other, one):
            assert (await browser.get(f"{studio.origin}/api/state")).status == 200


@served
async def test_every_response_forbids_foreign_content_and_frames(one: ServedStudio) -> None:
    async with one.client() as client:
        for path in ("/", "/live", "/person", "/studio.js", "/api/state", "/nothing.html"):
            headers = (await client.get(path)).headers
            policy = headers["Content-Security-Policy"]
            assert {"default-src 'none'", "frame-ancestors 'none'"} <= {*policy.split("; ")}
            assert "unsafe" not in policy
            found = headers["X-Content-Type-Options"], headers["Cache-Control"]
            assert found == ("nosniff", "no-store")


@served
async def test_page_person_has_a_document_of_its_own(one: ServedStudio) -> None:
    async with one.client() as client:
        documents = {}
        for path in ("/", "/live", "/live/guide", "/unknown", "/person", "/person/"):
            async with client.get(path) as answer:
                assert answer.content_type == "text/html"
                documents[path] = await answer.text()
    assert "/person.js" in documents["/person"]
    assert documents["/person"] == documents["/person/"]
    others = {text for path, text in documents.items() if not path.startswith("/person")}
    assert len(others) == 1
    assert "/person.js" not in others.pop()


@served
async def test_compressed_page_is_sent_to_supporting_clients(one: ServedStudio) -> None:
    async with one.client() as client:
        bodies, lengths = {}, {}
        for coding in ("gzip, br", "identity"):
            headers = {"Accept-Encoding": coding}
            async with client.get("/application.js", headers=headers) as answer:
                packed = answer.headers.get("Content-Encoding", "")
                bodies[packed] = await answer.read()
                lengths[packed] = int(answer.headers["Content-Length"])
                assert answer.headers["Vary"] == "Accept-Encoding"
        assert lengths["gzip"] < lengths[""] / 2
        assert bodies["gzip"] == bodies[""]  # the client has decompressed it


@served
async def test_excess_page_of_a_role_is_rejected(one: ServedStudio) -> None:
    async with one.client(SessionRole.VIEW) as client, one.client(SessionRole.OPERATE) as other:
        sockets = [await client.ws_connect("/api/socket") for _ in range(MOST_CLIENTS)]
        own = await other.ws_connect("/api/socket")
        assert (await _next(own))["type"] == "hello"
        refused = await client.get("/api/socket")
        assert (await refused.json())["code"] == "TOO_MANY_CLIENTS"
        await sockets.pop().close()
        await _next(sockets[0])
        again = await client.ws_connect("/api/socket")
        assert (await _next(again))["type"] == "hello"
        for socket in (*sockets, own, again):
            await socket.close()


@served
async def test_socket_closes_on_logout_of_its_session(one: ServedStudio) -> None:
    async with one.client(SessionRole.VIEW) as client, one.client(SessionRole.OPERATE) as other:
        closing = await client.ws_connect("/api/socket")
        own = await other.ws_connect("/api/socket")
        await client.delete("/api/session")
        while not closing.closed:
            await closing.receive()
        assert (await _next(own))["type"] == "hello"
        await own.close()


@served
async def test_studio_knows_which_pages_are_open(one: ServedStudio) -> None:
    async with one.client(SessionRole.OPERATE) as client:
        first = await client.ws_connect("/api/socket?page=person")
        second = await client.ws_connect("/api/socket")
        await _until(lambda: len(one.caller.watched) >= 2)
        assert one.caller.watched == [(True, True), (True, True)]
        for page, number, watched in ((first, 3, (True, False)), (second, 4, (False, False))):
            await page.close()
            await _until(lambda number=number: len(one.caller.watched) >= number)
            assert one.caller.watched[-1] == watched


@served
async def test_watching_page_person_counts_as_no_person(one: ServedStudio) -> None:
    async with one.client(SessionRole.VIEW) as client:
        page = await client.ws_connect("/api/socket?page=person")
        assert (await _next(page))["type"] == "hello"
        await page.close()
    assert set(one.caller.watched) <= {(True, False), (False, False)}


@served
async def test_page_person_without_pong_counts_as_closed(
    one: ServedStudio, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bt_agents_studio.server._PERSON_PING_S", 0.05)
    async with one.client(SessionRole.PERSON) as client:
        # It answers a ping only while it reads, and it does not read.
        page = await client.ws_connect("/api/socket?page=person")
        await _until(lambda: (False, False) in one.caller.watched)
        await page.close()


@pytest.mark.parametrize(
    ("body", "count"), [(False, 3 * MOST_CONNECTIONS), (True, MOST_CONNECTIONS - 1)]
)
def test_half_sent_requests_do_not_use_page_slots(
    body: bool, count: int, caplog: pytest.LogCaptureFixture
) -> None:
    async def test(one: ServedStudio) -> None:
        async with one.client(SessionRole.VIEW) as client:
            page = await client.ws_connect("/api/socket")
            halves = [await _half(one, body) for _ in range(count)]
            open_files = len(os.listdir("/proc/self/fd"))
            assert (await client.get("/api/state")).status == 200
            assert (await _next(page))["type"] == "hello"
            for _, writer in halves:
                writer.close()
            await page.close()
        # Both ends of each are in this process.
        assert open_files < 5 * MOST_CONNECTIONS

    run_served(test, ServedStudio())
    assert caplog.records == []


async def _half(one: ServedStudio, body: bool) -> _Connection:
    """Send half of a header, or of a body."""
    reader, writer = await asyncio.open_connection("127.0.0.1", one.port)
    lines = ["POST /api/session HTTP/1.1", f"Host: {one.host}", f"Origin: {one.origin}"]
    if body:
        lines += ["Content-Type: application/json", "Content-Length: 100"]
        lines += ["Expect: 100-continue", "", "{"]
    writer.write("\r\n".join(lines).encode())
    if body:
        assert b" 100 " in await reader.readuntil(b"\r\n\r\n")
    return reader, writer


@served
async def test_excess_connection_is_rejected(one: ServedStudio) -> None:
    one.server._connections._most = 2
    async with one.client(SessionRole.VIEW) as client:
        pages = [await client.ws_connect("/api/socket") for _ in range(2)]
        with pytest.raises(ClientError):
            await client.get("/api/state")
        await pages.pop().close()
        while (await _status(client)) is None:
            await asyncio.sleep(0.01)
        await pages.pop().close()


async def _status(client: ClientSession) -> int | None:
    """Return the status of an answer, None without an answer."""
    try:
        return (await client.get("/api/state")).status
    except ClientError:
        return None


@pytest.mark.parametrize(
    "sent",
    [
        b"\x00 / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nno header\r\n\r\n",
        b"GET / HTTP/1.1\r\nA: " + b"a" * 20_000 + b"\r\n\r\n",
        b"POST /api/session HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
    ],
)
def test_invalid_request_prints_nothing(sent: bytes, caplog: pytest.LogCaptureFixture) -> None:
    async def test(one: ServedStudio) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", one.port)
        writer.write(sent)
        assert b" 400 " in await asyncio.wait_for(reader.read(), 10)
        writer.close()

    run_served(test, ServedStudio())
    assert caplog.records == []


@served
async def test_late_body_times_out(one: ServedStudio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "WAIT_S", 0.1)
    reader, writer = await _half(one, body=True)
    assert b" 408 " in await asyncio.wait_for(reader.readline(), 10)
    writer.close()


_CANCEL = "POST /api/do/cancel"
_STOP = '{"reason":"x"}'
_TOKEN = '{"token":"{token}"}'
_PERSON = {"Cookie": "{cookie}={person}", "Authorization": "Bearer {person_key}"}
_VIEWER = {"Cookie": "{cookie}={viewer}", "Authorization": "Bearer {viewer_key}"}
_FOREIGN = {"Origin": "http://evil.example"}
_HOSTILE: list[tuple[str, str, Mapping[str, str | None], str]] = [
    # Name, request line, headers that replace a signed-in page's, body.
    ("rebound origin", _CANCEL, {"Host": "e:{port}", "Origin": "http://e:{port}"}, _STOP),
    ("suffix of a name", _CANCEL, {"Host": "127.0.0.1:{port}.e.com"}, _STOP),
    ("other port", _CANCEL, {"Host": "127.0.0.1:1"}, _STOP),
    ("no host", _CANCEL, {"Host": None}, _STOP),
    ("foreign origin", _CANCEL, _FOREIGN, _STOP),
    ("origin of another scheme", _CANCEL, {"Origin": "https://{host}"}, _STOP),
    ("origin as prefix", _CANCEL, {"Origin": "http://{host}.evil.example"}, _STOP),
    ("cross-site fetch", _CANCEL, {"Sec-Fetch-Site": "cross-site"}, _STOP),
    ("type as parameter", _CANCEL, {"Content-Type": "text/plain; application/json"}, _STOP),
    ("no cookie", _CANCEL, {"Cookie": None}, _STOP),
    ("replayed cookie", _CANCEL, {"Cookie": "{cookie}={ended}"}, _STOP),
    ("cookie of a viewer", _CANCEL, {"Cookie": "{cookie}={viewer}"}, _STOP),
    ("cookie without key", _CANCEL, {"Authorization": None}, _STOP),
    ("key that is not ASCII", _CANCEL, {"Authorization": "Bearer ü"}, _STOP),
    ("huge cookie", _CANCEL, {"Cookie": "{cookie}=" + "a" * 20000}, _STOP),
    ("token in the address", "POST /api/do/cancel?token={token}", {"Cookie": None}, _STOP),
    ("token as bearer", _CANCEL, {"Cookie": None, "Authorization": "Bearer {token}"}, _STOP),
    ("change by GET", "GET /api/do/cancel?reason=x", {}, ""),
    ("preflight", "OPTIONS /api/do/cancel", _FOREIGN, ""),
    ("connect", "CONNECT 127.0.0.1:22", {}, ""),
    ("no such operation", "POST /api/do/__init__", {}, "{}"),
    ("no JSON", _CANCEL, {}, "reason"),
    ("deep JSON", _CANCEL, {}, "[" * 100_000),
    ("unknown field", _CANCEL, {}, '{"epoch":"x"}'),
    ("huge body", _CANCEL, {}, '{"reason":"' + "a" * LARGEST_BODY + '"}'),
    ("huge length", _CANCEL, {"Content-Length": "99999999999999999999999"}, _STOP),
    ("two framings", _CANCEL, {"Transfer-Encoding": "chunked"}, _STOP),
    ("bad encoding", _CANCEL, {"Content-Type": "application/json; charset=no"}, _STOP),
    ("zipped", _CANCEL, {"Content-Encoding": "gzip"}, _STOP),
    ("socket of a foreign page", "GET /api/socket", _FOREIGN | {"@": "ws"}, ""),
    ("socket without origin", "GET /api/socket", {"Origin": None, "@": "ws"}, ""),
    ("socket without cookie", "GET /api/socket", {"Cookie": None, "@": "ws"}, ""),
    ("parent folder", "GET /../access.py", {}, ""),
    ("encoded parent folder", "GET /%2e%2e/access.py", {}, ""),
    ("absolute file", "GET //etc/passwd.txt", {}, ""),
    ("state without cookie", "GET /api/state", {"Cookie": None}, ""),
    ("journals without cookie", "GET /api/journals", {"Cookie": None}, ""),
    ("wrong token", "POST /api/session", {"Cookie": None}, '{"token":"0000"}'),
    ("token of a foreign page", "POST /api/session", {"Origin": "http://e"}, _TOKEN),
    ("person pins", "POST /api/do/operate", _PERSON, '{"action":"PIN","agent":"x"}'),
    ("person is urgent", "POST /api/do/scene", _PERSON, '{"urgent":true}'),
    ("person looks back", "GET /api/journals", _PERSON, ""),
    ("person exports", "GET /api/journals/a.mcap/messages?from=0&to=9", _PERSON, ""),
    ("messages of no recording", "GET /api/journals/a.mcap/messages?from=0&to=9", {}, ""),
    ("answer of a viewer", "POST /api/do/answer", _VIEWER, '{"text":"yes"}'),
    ("leaving without key", "DELETE /api/session", {"Authorization": None}, ""),
]


@pytest.mark.parametrize(
    ("line", "headers", "body"), [one[1:] for one in _HOSTILE], ids=[one[0] for one in _HOSTILE]
)
@served
async def test_hostile_request_is_rejected_and_changes_nothing(
    one: ServedStudio, line: str, headers: Mapping[str, str | None], body: str
) -> None:
    answer = await _sent(one, line, headers, body)
    status = int(answer.split(b" ", 2)[1]) if answer else 400
    assert 400 <= status < 600, answer[:300]
    assert b"Set-Cookie" not in answer
    assert one.caller.calls == []
    assert one.studio.store.sequence == 0
    # Sessions with the right still succeed.
    async with one.client(SessionRole.OPERATE) as client:
        assert (await client.post("/api/do/cancel", json={})).status == 200


async def _sent(
    one: ServedStudio, line: str, headers: Mapping[str, str | None], body: str
) -> bytes:
    ended = one.session(SessionRole.OPERATE)
    one.access.log_out(ended)
    session, viewer, person = (
        one.session(role) for role in (SessionRole.OPERATE, SessionRole.VIEW, SessionRole.PERSON)
    )
    words = {
        "port": str(one.port),
        "host": one.host,
        "token": one.access.token(SessionRole.OPERATE),
        "cookie": cookie_name(one.host),
        "ended": ended,
        "session": session,
        "viewer": viewer,
        "viewer_key": one.access.key(viewer),
        "person": person,
        "person_key": one.access.key(person),
    }

    def filled(text: str) -> str:
        for name, word in words.items():
            text = text.replace(f"{{{name}}}", word)
        return text

    data = filled(body).encode()
    wanted: dict[str, str | None] = {
        "Host": one.host,
        "Origin": one.origin,
        "Cookie": f"{cookie_name(one.host)}={session}",
        "Authorization": f"Bearer {one.access.key(session)}",
        "Content-Type": "application/json",
        "Content-Length": str(len(data)),
        "Connection": "close",
        **headers,
    }
    if wanted.pop("@", None):
        wanted |= {
            "Connection": "Upgrade",
            "Upgrade": "websocket",
            "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        }
    lines = [f"{name}: {filled(value)}" for name, value in wanted.items() if value is not None]
    reader, writer = await asyncio.open_connection("127.0.0.1", one.port)
    try:
        writer.write("\r\n".join([f"{filled(line)} HTTP/1.1", *lines, "", ""]).encode() + data)
        return await asyncio.wait_for(reader.read(4000), 10)
    except ConnectionError:
        return b""
    finally:
        writer.close()
