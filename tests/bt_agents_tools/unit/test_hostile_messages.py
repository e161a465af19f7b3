# SPDX-License-Identifier: Apache-2.0
"""Hostile messages: a terminal receives only printable text."""

from __future__ import annotations

import inspect
import io
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner
from rclpy.clock import Clock
from rich.console import Console

from bt_agents_core.errors import BtAgentsError
from bt_agents_interfaces import msg, srv
from bt_agents_ros.system_topics import HOST, SERVICES, TOPICS
from bt_agents_ros.types import load_type
from bt_agents_tools.cli import connection
from bt_agents_tools.cli.event_printer import EventPrinter
from bt_agents_tools.cli.main import bt_agents
from bt_agents_tools.client import observer, system_client
from bt_agents_tools.client.observer import MOST_HOSTS, Listener, Observer
from bt_agents_tools.client.printable_messages import make_printable
from hostile_texts import HOSTILE, hostile, texts
from tree_harness import SPACE

LISTENED = [name for name in vars(Listener) if not name.startswith("_")]
OF_SEVERAL_LINES = {
    msg.Auction,
    *(kind.Response for kind in (srv.ManageProfiles, srv.PreviewAuction, srv.ReloadAgents)),
}
KINDS = {
    *(kind for kind in vars(msg).values() if isinstance(kind, type)),
    *(one.Response for one in vars(srv).values() if hasattr(one, "Response")),
    *(load_type(topic.type) for topic in TOPICS),
    *(load_type(service.type).Response for service in SERVICES),
}


def raw(text: str) -> str:
    """Return the characters of a text that a terminal would obey or hide."""
    return "".join(one for one in text if not one.isprintable() and one not in "\n\t")


class FakeNode:
    """A node whose topics and services are all hostile."""

    def get_namespace(self) -> str:
        return "/"

    def get_clock(self) -> Any:
        return Clock()

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., None], _: Any, raw: bool = False
    ) -> None:
        if not raw:
            info = ({"source_timestamp": 0},) * (len(inspect.signature(callback).parameters) - 1)
            message = hostile(kind)
            if kind is msg.HostCard:
                # A host must have this name; everything else in its messages is hostile.
                message.host = "/agents"
            callback(message, *info)

    def create_client(self, kind: Any, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(kind=kind, service_is_ready=lambda: True)

    def get_topic_names_and_types(self) -> list[Any]:
        return [("/bt_agents/market", ["bt_agents_interfaces/msg/MarketStatus"])]

    def get_publishers_info_by_topic(self, _: str) -> list[Any]:
        return [SimpleNamespace(node_name=HOSTILE, node_namespace=HOSTILE)]


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> list[Callable[[], None]]:
    """Connect every observer to a hostile graph; return the callbacks of its timers."""
    timers: list[Callable[[], None]] = []
    fake = SimpleNamespace(
        init=lambda **_: None, create_node=lambda *_, **__: FakeNode(), try_shutdown=lambda: None
    )

    def added_timer(_node: Any, _period_s: float, call: Callable[[], None], running: bool) -> Any:
        timers.append(call)
        return SimpleNamespace(is_canceled=lambda: not running, reset=list, cancel=list)

    spinner = SimpleNamespace(spin_until=lambda done, _, **__: done(), close=lambda: None)
    monkeypatch.setattr(system_client, "rclpy", fake)
    monkeypatch.setattr(system_client, "starting_ros", lambda _: nullcontext())
    monkeypatch.setattr(system_client, "Spinner", lambda _: spinner)
    monkeypatch.setattr(observer, "steady_timer", added_timer)
    monkeypatch.setattr(system_client, "Calls", lambda _: SimpleNamespace(call=answered_call))
    monkeypatch.setattr(connection, "set_discovery", lambda _: None)
    return timers


def answered_call(
    client: Any, _request: Any, *, on_answer: Callable[[Any], None], **_: Any
) -> None:
    answer = hostile(client.kind.Response)
    if hasattr(answer, "accepted"):
        answer.accepted = True
    on_answer(answer)


@pytest.mark.parametrize("kind", sorted(KINDS, key=str), ids=lambda kind: kind.__name__)
def test_every_message_and_response_field_is_sanitized(kind: Any) -> None:
    message = hostile(kind)
    shown = list(texts(make_printable(message)))
    assert shown == list(texts(message))
    assert "".join(map(raw, shown)) == ""
    assert sum("\n" in text for text in shown) == (kind in OF_SEVERAL_LINES)


def test_observer_returns_only_printable_messages_and_responses(
    graph: list[Callable[[], None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Any] = []
    listener = {name: lambda *given: told.extend(given) for name in LISTENED}
    one = Observer()
    one.notify(SimpleNamespace(**listener), is_new_robot=True)
    monkeypatch.setattr(observer, "time", SimpleNamespace(monotonic=lambda: 1e9))
    for timer in graph:
        timer()
    one._on_card(make_printable(hostile(msg.HostCard)))
    kept = [one.market, one.profiles, *one.cards, *one.cards.values(), *told]
    kept += one.namespaces_of_markets()
    for topic in TOPICS:
        kept += one.received(topic.name.replace(HOST, "/agents"))
    kept += [one.ask(service.name.replace(HOST, "/agents")) for service in SERVICES]
    assert len(kept) > len(TOPICS) + len(SERVICES) + len(LISTENED)
    assert "".join(raw(text) for part in kept for text in texts(part)) == ""


@pytest.mark.usefixtures("graph")
def test_new_host_replaces_only_absent_one(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {f"/h{number}/heartbeat" for number in range(MOST_HOSTS)}
    monkeypatch.setattr(
        FakeNode, "count_publishers", lambda _, topic: int(topic in there), raising=False
    )
    one = Observer()
    one.cards.clear()
    for number in range(MOST_HOSTS):
        one._on_card(msg.HostCard(host=f"/h{number}"))
    one._on_card(msg.HostCard(host="/late"))
    assert len(one.cards) == MOST_HOSTS
    assert "/late" not in one.cards
    there.remove("/h3/heartbeat")
    one._on_card(msg.HostCard(host="/late"))
    assert len(one.cards) == MOST_HOSTS
    assert {"/h3", "/late"} & one.cards.keys() == {"/late"}


def with_fields(kind: Any, **fields: Any) -> Any:
    message = hostile(kind)
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def changed(status: int) -> Any:
    change = with_fields(msg.StatusChange, status=status)
    return with_fields(msg.TreeStatus, changes=[change, change])


EVENTS: Sequence[tuple[str, Any]] = (
    *(("auction", with_fields(msg.Auction, outcome=number)) for number in range(1, 5)),
    *(("run", with_fields(msg.Run, event=number)) for number in range(5)),
    ("tree", changed(msg.StatusChange.RUNNING)),
    ("tree", changed(msg.StatusChange.FAILURE)),
    ("scene", with_fields(msg.Scene, person=True)),
    ("market", with_fields(msg.MarketStatus, queued=2)),
    ("end", hostile(msg.SceneEnd)),
    ("feedback", hostile(msg.Feedback)),
    ("feedback", with_fields(msg.Feedback, layer="")),
    ("tunings", hostile(msg.Tunings)),
)


@pytest.mark.parametrize(("name", "message"), EVENTS)
def test_events_reach_terminal_sanitized(name: str, message: Any) -> None:
    output = io.StringIO()
    printer = EventPrinter(Console(file=output, width=100, color_system=None), SPACE)
    getattr(printer, name)(make_printable(message))
    printer.summary()
    shown = output.getvalue()
    assert raw(shown) == ""
    assert not any(line.startswith("[FATAL]") for line in shown.splitlines())


@pytest.mark.parametrize(
    "words",
    [
        "status", "status --csv", "status --json", "why", "why --csv", "why --json",
        "scene", "scene --json", "trigger age=1", "sense mood=1", "answer", "cancel",
        "preview", "reload", "moods", "preset",
    ],
)  # fmt: skip
@pytest.mark.usefixtures("graph")
def test_commands_print_foreign_text_sanitized(words: str) -> None:
    result = CliRunner().invoke(bt_agents, words.split())
    assert result.exception is None
    assert "title" in result.output
    assert raw(result.output) == ""


@pytest.mark.usefixtures("graph")
def test_refusal_reason_is_sanitized() -> None:
    with pytest.raises(BtAgentsError, match="title") as refused:
        CliRunner().invoke(bt_agents, ["tune", "x.y=1"], catch_exceptions=False)
    assert raw(str(refused.value)) == ""
