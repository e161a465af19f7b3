# SPDX-License-Identifier: Apache-2.0
"""Oversized requests, goals, answers and feedback: refused before they become objects."""

from __future__ import annotations

import gc
import inspect
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser import definition as idl

from bt_agents_core.errors import Refused
from bt_agents_interfaces import action, msg, srv
from bt_agents_interfaces.action import Say
from bt_agents_interfaces.msg import Heartbeat, Scene, SceneValue
from bt_agents_interfaces.srv import CancelRun, OperateMarket
from bt_agents_ros import limits, qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.types import resolved, slots_of
from bt_agents_ros.workarounds.bounded_types import bounded, bounded_by, serialized_size
from scripted_server import Script, ScriptedServer


def kinds() -> Iterator[Any]:
    """Each message, request, response and part of an action that we define."""
    yield from (kind for _, kind in inspect.getmembers(msg, inspect.isclass))
    for _, kind in inspect.getmembers(srv, lambda kind: hasattr(kind, "Request")):
        yield from (kind.Request, kind.Response)
    for _, kind in inspect.getmembers(action, lambda kind: hasattr(kind, "Impl")):
        for service in (kind.Impl.SendGoalService, kind.Impl.GetResultService):
            yield from (service.Request, service.Response)
        yield kind.Impl.FeedbackMessage


def entry_of(slot: Any) -> Any:
    """Return one entry for a list of a rosidl type."""
    kind = resolved(slot)
    if hasattr(kind, "SLOT_TYPES"):
        return kind()
    if isinstance(kind, idl.AbstractGenericString):
        return ""
    return {"boolean": False, "float": 0.0, "double": 0.0, "octet": b"\0"}.get(kind.typename, 0)


def taken(message: Any) -> Any:
    """Return a stand-in's conversion of a message."""
    return deserialize_message(serialize_message(message), bounded(type(message)))


LISTS = [
    (kind, field, slot.value_type)
    for kind in kinds()
    for field, slot in slots_of(kind).items()
    if isinstance(slot, idl.AbstractSequence)
]


@pytest.mark.parametrize(
    ("kind", "field", "slot"), LISTS, ids=[f"{kind.__name__}.{field}" for kind, field, _ in LISTS]
)
def test_list_entries_are_counted_in_memory(kind: Any, field: str, slot: Any) -> None:
    most = limits.ENTRIES_OF.get(f"{kind.__name__}.{field}", limits.LIST_ENTRIES)
    largest = limits.BYTES_OF.get(kind.__name__, limits.MESSAGE_BYTES)
    entry = entry_of(slot)
    long = kind(**{field: [entry] * (most + 1)})
    found = taken(long)

    assert isinstance(found, Refused)
    if len(serialize_message(long)) <= largest:
        assert (
            found.reason
            == f"{kind.__name__}.{field} has {most + 1} entries, expected at most {most}"
        )
    else:
        assert " bytes, expected at most " in found.reason
    short = kind(**{field: [entry] * 3})
    assert taken(short) == short


@pytest.mark.parametrize("kind", list(kinds()), ids=lambda kind: str(kind.__name__))
def test_measured_size_matches_serialized_message(kind: Any) -> None:
    size = serialized_size(kind)
    assert size is not None
    seen: list[int] = []

    def watched(address: int) -> int:
        seen.append(size(address))
        return seen[-1]

    message = deserialize_message(serialize_message(kind()), bounded_by(kind, watched))
    assert message == kind()
    # Serialization rounds up to four bytes.
    assert 0 <= len(serialize_message(kind())) - 4 - seen[0] < 4


def test_oversized_request_is_refused_before_creating_python_objects() -> None:
    values = CancelRun.Request(scene=Scene(values=[SceneValue()] * 400_000))
    message = serialize_message(values)
    gc.collect()
    made: list[Any] = []
    found = deserialize_message(message, bounded(CancelRun.Request))
    made += [one for one in gc.get_objects() if type(one) is SceneValue]

    assert isinstance(found, Refused)
    assert found.code == "TOO_LARGE"
    assert len(made) <= 1


def test_stand_in_keeps_no_references() -> None:
    request = CancelRun.Request(reason="x" * 1000)
    before = sys.getrefcount(None)
    for _ in range(1000):
        assert sys.getrefcount(taken(request)) <= 2
    assert sys.getrefcount(None) < before + 500


def test_content_is_counted_when_size_is_unknown() -> None:
    stand_in = bounded_by(CancelRun.Request, None)

    def found(reason: str) -> Any:
        return deserialize_message(serialize_message(CancelRun.Request(reason=reason)), stand_in)

    assert found("short").reason == "short"
    assert found("x" * 20_001).code == "TOO_LARGE"


def test_type_without_library_is_logged_as_unmeasured(capfd: pytest.CaptureFixture[str]) -> None:
    class Unknown:
        __module__ = "no_such_package.srv._unknown"

    assert serialized_size(Unknown) is None
    assert "NOT_MEASURED: no_such_package" in capfd.readouterr().err


@pytest.fixture
def client(ros: Any) -> Iterator[ActionClient]:
    made = ActionClient(ros.node, Say, "say")
    yield made
    made.destroy()


def send(ros: Any, client: ActionClient, text: str) -> Any:
    """Send a goal; return its handle once the server has answered."""
    ros.until(client.server_is_ready)
    return ros.result(client.send_goal_async(Say.Goal(text=text)))


def test_oversized_goal_is_rejected_and_next_is_accepted(
    ros: Any, client: ActionClient, capfd: pytest.CaptureFixture[str]
) -> None:
    server = ScriptedServer(ros)
    assert not send(ros, client, "x" * limits.MESSAGE_BYTES).accepted
    ros.result(send(ros, client, "hello").get_result_async())

    assert [goal.request.text for goal in server.goals] == ["hello"]
    assert "TOO_LARGE: an action: Say_SendGoal_Request has 2621" in capfd.readouterr().err


def test_oversized_result_fails_its_future(ros: Any, client: ActionClient) -> None:
    ScriptedServer(ros, script=Script(result={"message": "x" * limits.MESSAGE_BYTES}))
    handle = send(ros, client, "hello")

    with pytest.raises(Refused, match="TOO_LARGE: Say_GetResult_Response has 2621"):
        ros.result(handle.get_result_async())


def test_oversized_response_fails_its_future(ros: Any) -> None:
    def answer(_request: Any, response: Any) -> Any:
        response.message = "x" * limits.MESSAGE_BYTES
        return response

    ros.node.create_service(OperateMarket, "operate", answer)

    with pytest.raises(Refused, match="TOO_LARGE: OperateMarket_Response has 262165"):
        ros.ask(OperateMarket, "operate")


@pytest.mark.parametrize("kind", [SetParameters, SetParametersAtomically])
def test_oversized_parameters_are_refused_with_code(ros: Any, kind: Any) -> None:
    ros.add(BaseNode("tuned"))
    name = "set_parameters" + ("_atomically" if kind is SetParametersAtomically else "")
    large = [Parameter(name="x" * limits.MESSAGE_BYTES)]
    answer = ros.ask(kind, f"tuned/{name}", parameters=large)
    results = answer.results if kind is SetParameters else [answer.result]

    assert [one.successful for one in results] == [False]
    assert results[0].reason.startswith(f"TOO_LARGE: {kind.__name__}_Request has 2622")


def test_number_of_parameters_per_request_is_limited(ros: Any) -> None:
    ros.add(BaseNode("tuned"))
    refused, taken = (
        ros.ask(SetParameters, "tuned/set_parameters", parameters=[Parameter()] * count).results
        for count in (1_001, 1_000)
    )

    expected = "SetParameters_Request.parameters has 1001 entries, expected at most 1000"
    assert [one.reason for one in refused] == [f"TOO_LARGE: {expected}"]
    assert len(taken) == 1_000


def test_malformed_bytes_reach_no_callback_and_log_once(
    ros: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    heard: list[Any] = []
    ros.node.create_subscription(Heartbeat, "beats", heard.append, qos.EVENTS)
    publisher = ros.node.create_publisher(Heartbeat, "beats", qos.EVENTS)
    ros.until(publisher.get_subscription_count)
    for _ in range(20):
        publisher.publish(b"\x00\x01\x00\x00\xff\xff\xff\x7f")
    publisher.publish(Heartbeat(agent="leo"))
    ros.until(lambda: heard)

    assert [one.agent for one in heard] == ["leo"]
    assert capfd.readouterr().err.count("MALFORMED: /beats: 8 bytes are not a Heartbeat") == 1
