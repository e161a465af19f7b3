# SPDX-License-Identifier: Apache-2.0
"""Limits of messages and requests: legitimate ones fit, larger ones are refused with a code."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rcl_interfaces.srv
from action_msgs.msg import GoalStatusArray
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header, String

from bt_agents_core.errors import Refused
from bt_agents_interfaces import msg, srv
from bt_agents_interfaces.msg import (
    AgentCard,
    AgentFiles,
    Auction,
    Bids,
    Heartbeat,
    HostCard,
    Learning,
    MarketStatus,
    Persons,
    Profiles,
    RankedBid,
    Run,
    Scene,
    SceneValue,
    Tree,
    TreeNode,
    Trees,
    TunableInfo,
    Tunables,
    Tunings,
)
from bt_agents_interfaces.srv import CancelRun, OperateMarket, RegisterHost, SelectAgent
from bt_agents_ros import limits, qos, size_check
from bt_agents_ros.size_check import RefusalLog, check_bytes, check_content, check_fields
from fake_market import Market, make_host
from market_node_harness import MarketNodeHarness
from programs import ROOT

AGENTS, PARAMETERS, NODES = 10_000, 64, 10_000
NAMES = [f"{number:0>64}" for number in range(AGENTS)]
WIDE = [math.pi] * PARAMETERS
MARGIN = 8


def size_text(size: int) -> str:
    return f"{size // limits.MIB} MiB" if size % limits.MIB == 0 else f"{size // limits.KIB} KiB"


def documented() -> Iterator[tuple[str, str]]:
    """Return the table of the documentation, row by row."""
    yield "any other message, and any other request", size_text(limits.MESSAGE_BYTES)
    yield from ((f"`{name}`", size_text(size)) for name, size in limits.BYTES_OF.items())
    yield "a message or an answer of another package", size_text(limits.FOREIGN_BYTES)
    scene_texts = {f"Scene.{field}": size for field, size in limits.SCENE_CHARACTERS.items()}
    for usual, default, rows, unit in (
        ("text", limits.TEXT_CHARACTERS, scene_texts | dict(limits.CHARACTERS_OF), "characters"),
        ("list", limits.LIST_ENTRIES, limits.ENTRIES_OF, "entries"),
    ):
        if unit == "entries":
            what = "a list of texts or messages in a message of another package"
            yield what, f"{limits.FOREIGN_ENTRIES:,} entries"
        yield f"any other {usual}", f"{default:,} {unit}"
        yield from ((f"`{name}`", f"{size:,} {unit}") for name, size in rows.items())


def test_documented_limits_match_code() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    rows = "".join(f"| {what} | {most} |\n" for what, most in documented())

    assert f"| what | at most |\n|---|---|\n{rows}\n" in page


class Source:
    """A source of messages."""


def own_types() -> Iterator[Any]:
    """Each type that may be serialized or requested, with the types nested in them."""
    yield from (kind for _, kind in inspect.getmembers(msg, inspect.isclass))
    for _, kind in inspect.getmembers(srv, lambda kind: hasattr(kind, "Request")):
        yield kind.Request
        yield kind.Response


def card(name: str) -> AgentCard:
    return AgentCard(
        name=name,
        title=name,
        description="x" * 500,
        profile=WIDE,
        current=WIDE,
        learning=Learning(rates=WIDE, width=WIDE, drift=WIDE, retreat=WIDE),
    )


WIDEST: dict[str, Callable[[], Any]] = {
    "bids that weigh": lambda: Bids(
        agents=NAMES, agent_ids=range(AGENTS), vectors=WIDE * AGENTS, weights=WIDE * AGENTS
    ),
    "bids that are declined": lambda: Bids(
        declined=NAMES, decline_reasons=["x" * 300] * AGENTS, unmet=["x" * 100] * AGENTS
    ),
    "an auction": lambda: Auction(
        ranking=[
            RankedBid(
                agent=name, vector=WIDE, contributions=WIDE, weights=WIDE, calculation="x" * 1000
            )
            for name in NAMES
        ]
    ),
    "cards": lambda: HostCard(agents=[card(name) for name in NAMES]),
    "vetoes": lambda: MarketStatus(vetoed=NAMES, starved=NAMES),
    "profiles": lambda: Profiles(
        agents=NAMES, layers=["person/x"] * AGENTS, vectors=WIDE * AGENTS
    ),
    "a tree": lambda: Trees(
        trees=[
            Tree(
                nodes=[
                    TreeNode(path="x" * 200, kind="x" * 40, name="x" * 100, file="x" * 100)
                    for _ in range(NODES)
                ]
            )
        ]
    ),
    "trees": lambda: Trees(
        trees=[
            Tree(
                agent=name,
                nodes=[
                    TreeNode(
                        path="tree/0.sequence/2.ask",
                        kind="sequence",
                        name="Ask for the age",
                        file=f"agents/{name}.yaml",
                    )
                ]
                * 20,
            )
            for name in NAMES
        ]
    ),
    "files": lambda: AgentFiles(
        files=[f"agents/{name}.yaml" for name in NAMES],
        texts=["x" * 1500] * AGENTS,
        agents=NAMES,
        versions=range(AGENTS),
    ),
    "tunables": lambda: Tunables(
        tunables=[
            TunableInfo(name=f"{name}.patience", agent=name, key="patience", description="x" * 80)
            for name in NAMES
        ]
        * 5
    ),
    "bids to rank outside": lambda: SelectAgent.Request(
        agents=NAMES, vectors=WIDE * AGENTS, distances=[0.0] * AGENTS
    ),
    "a scene": lambda: Scene(
        values=[SceneValue(name="x" * 64, source="x" * 100)] * PARAMETERS,
        **{field: "x" * longest for field, longest in limits.SCENE_CHARACTERS.items()},
    ),
}


@pytest.mark.parametrize("widest", WIDEST.values(), ids=WIDEST)
def test_messages_of_largest_system_fit_limits(widest: Callable[[], Any]) -> None:
    message = widest()
    size = len(serialize_message(message))

    check_bytes(type(message), size)
    check_fields(message, size)


def test_messages_about_shipped_agents_stay_far_below_limits(ros: Any) -> None:
    topics = {
        HostCard: "bt_agents/cards",
        Trees: "agents/trees",
        AgentFiles: "agents/files",
        Tunables: "agents/tunables",
        Tunings: "agents/tunings",
    }
    said: dict[Any, list[bytes]] = {kind: [] for kind in topics}
    for kind, topic in topics.items():
        ros.node.create_subscription(kind, topic, said[kind].append, qos.FACTS, raw=True)
    market = Market(ros)
    ros.add(make_host(ROOT / "trees"))
    market.open()
    ros.until(lambda: all(said.values()))

    for kind, messages in said.items():
        check_bytes(kind, MARGIN * len(messages[-1]))
        check_fields(deserialize_message(messages[-1], kind), len(messages[-1]))


def test_registration_may_hold_all_agents_and_ten_runs() -> None:
    check_content(RegisterHost.Request(agents=NAMES, unreported=[Run()] * 10))
    with pytest.raises(Refused, match=r"RegisterHost_Request\.unreported has 11 entries"):
        check_content(RegisterHost.Request(unreported=[Run()] * 11))


def test_each_limit_row_overrides_an_existing_field() -> None:
    kinds = {
        kind.__name__: kind for kind in (*own_types(), *parameter_requests(), GoalStatusArray)
    }

    assert limits.BYTES_OF.keys() <= kinds.keys()
    assert limits.MESSAGE_BYTES not in limits.BYTES_OF.values()
    for rows, usual in (
        (limits.CHARACTERS_OF, limits.TEXT_CHARACTERS),
        (limits.ENTRIES_OF, limits.LIST_ENTRIES),
    ):
        for row, limit in rows.items():
            kind, _, field = row.partition(".")
            assert field in kinds[kind].get_fields_and_field_types(), row
            assert limit != usual, row


def parameter_requests() -> Iterator[Any]:
    """Each request about parameters."""
    for _, kind in inspect.getmembers(rcl_interfaces.srv, lambda kind: hasattr(kind, "Request")):
        yield kind.Request


@pytest.mark.parametrize("kind", list(own_types()), ids=lambda kind: str(kind.__name__))
def test_every_text_and_list_field_has_a_limit(kind: Any) -> None:
    for field, slot in kind.get_fields_and_field_types().items():
        if slot not in ("string", "sequence<string>"):
            continue
        limit = limits.CHARACTERS_OF.get(f"{kind.__name__}.{field}", limits.TEXT_CHARACTERS)
        text = "x" * (limit + 1)
        message = kind(**{field: text if slot == "string" else [text]})
        with pytest.raises(Refused, match=f"TOO_LARGE: {kind.__name__}.{field} has {limit + 1}"):
            check_fields(message, limit + 1)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            Persons(scenes=[Scene(), Scene(values=[SceneValue(source="x" * 1_001)])]),
            r"SceneValue\.source has 1001 characters",
        ),
        (Run(header=Header(frame_id="x" * 20_001)), r"Header\.frame_id has 20001 characters"),
    ],
)
def test_nested_fields_are_checked(message: Any, words: str) -> None:
    with pytest.raises(Refused, match=f"TOO_LARGE: {words}"):
        check_fields(message, limits.MESSAGE_BYTES)


def test_list_may_reach_its_limit_exactly() -> None:
    check_fields(Heartbeat(), 10**6)
    check_fields(Profiles(parameters=["x"] * limits.LIST_ENTRIES), 10**6)
    with pytest.raises(Refused, match=r"TOO_LARGE: Profiles\.parameters has 20001 entries"):
        check_fields(Profiles(parameters=["x"] * (limits.LIST_ENTRIES + 1)), 10**6)


def test_total_text_length_of_request_is_limited() -> None:
    request = RegisterHost.Request(parameters=["x" * limits.TEXT_CHARACTERS] * 1000)

    with pytest.raises(Refused, match="TOO_LARGE: RegisterHost_Request has 20001000 char"):
        check_content(request)


def test_flood_is_logged_periodically_per_topic_and_code() -> None:
    now_s = 0.0
    log = RefusalLog(lambda: now_s)
    refused, malformed = Refused("TOO_LARGE", "much"), Refused("MALFORMED", "no message")
    one, other = Source(), Source()
    assert log.line(one, "/one", refused) == "TOO_LARGE: /one: much; 1 refused since the start"
    assert log.line(one, "/one", refused) is None
    assert log.line(other, "/other", refused) is not None
    last = log.line(one, "/one", malformed)
    assert last == "MALFORMED: /one: no message; 3 refused since the start"
    assert log.line(one, "/one", malformed) is None
    now_s = size_check.LOG_PERIOD_S
    assert log.line(one, "/one", refused) == "TOO_LARGE: /one: much; 5 refused since the start"


@pytest.mark.parametrize("raw", [False, True])
def test_oversized_message_reaches_no_callback_but_next_does(
    ros: Any, capfd: pytest.CaptureFixture[str], raw: bool
) -> None:
    heard: list[Any] = []
    ros.node.create_subscription(Heartbeat, "beats", heard.append, qos.EVENTS, raw=raw)
    publisher = ros.node.create_publisher(Heartbeat, "beats", qos.EVENTS)
    ros.until(publisher.get_subscription_count)
    publisher.publish(Heartbeat(agent="x" * limits.MESSAGE_BYTES))
    publisher.publish(Heartbeat(agent="leo"))
    ros.until(lambda: heard)

    assert len(heard) == 1
    message = deserialize_message(heard[0], Heartbeat) if raw else heard[0]
    assert message == Heartbeat(agent="leo")
    assert "TOO_LARGE: /beats: Heartbeat has 262" in capfd.readouterr().err


def test_foreign_message_has_one_size_limit(ros: Any) -> None:
    heard: list[String] = []
    ros.node.create_subscription(String, "words", heard.append, qos.EVENTS)
    publisher = ros.node.create_publisher(String, "words", qos.EVENTS)
    ros.until(publisher.get_subscription_count)
    for length in (limits.FOREIGN_BYTES, limits.FOREIGN_BYTES - 100):
        publisher.publish(String(data="x" * length))
    ros.until(lambda: heard)

    assert [len(one.data) for one in heard] == [limits.FOREIGN_BYTES - 100]


def test_oversized_request_is_refused_with_code_without_effect(ros: Any) -> None:
    harness = MarketNodeHarness(ros)
    harness.host()
    pin = {"action": OperateMarket.Request.PIN, "agent": "attentive_guide"}
    refused = ros.ask(OperateMarket, "marketplace/operate", **pin, reason="x" * 20_000_000)
    assert (refused.accepted, refused.code) == (False, "TOO_LARGE")
    assert refused.message == ("OperateMarket_Request has 20000108 bytes, expected at most 262144")
    assert harness.statuses[-1].pinned == ""
    assert ros.ask(OperateMarket, "marketplace/operate", **pin).accepted

    answer = ros.call(harness.cancelling, CancelRun.Request(reason="x" * 20_001))
    assert answer.message.startswith("TOO_LARGE: CancelRun_Request.reason has 20001 characters")
    registered = ros.call(harness.registering, RegisterHost.Request(agents=["x"] * 400_000))
    assert not registered.accepted
    assert registered.message.startswith("TOO_LARGE: RegisterHost_Request.agents has 400000")


def test_run_with_oversized_result_fails_by_name(ros: Any) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host()
    host.message = "x" * limits.MESSAGE_BYTES
    harness.scene()
    ros.until(lambda: host.ended)
    host.finish()

    run = harness.until_event(Run.ENDED)
    assert run.outcome == Run.FAILED
    assert run.message.startswith("TOO_LARGE: RunAgent_GetResult_Response has 262")
