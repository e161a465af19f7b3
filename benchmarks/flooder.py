# SPDX-License-Identifier: Apache-2.0
"""A process that floods nodes: each line of its input is ``KIND, NODE, SECONDS``.

A kind is one of :data:`FLOODS`. The process knows nothing of the system except names and types,
like any process on the same ROS domain.
"""

from __future__ import annotations

import faulthandler
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import count
from typing import Any

import rclpy
from action_msgs.msg import GoalStatusArray
from action_msgs.srv import CancelGoal
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosidl_parser import definition as idl
from std_msgs.msg import Empty, String

from bare import EVENTS
from bt_agents_interfaces.action import RunAgent, Say
from bt_agents_interfaces.msg import Bids, CallForBids, HostCard, OpenGoals, Run, Scene
from bt_agents_interfaces.srv import (
    Analyze,
    CancelRun,
    GiveFeedback,
    ManageProfiles,
    OperateMarket,
    RegisterHost,
    Remember,
    SetLight,
    SetProfile,
    Tune,
)
from bt_agents_ros import limits
from bt_agents_ros.size_check import is_own, largest_bytes, most_entries
from bt_agents_ros.types import resolved, slots_of

MATCHED_S = 20.0
"""Time after which a flood stops looking for its node [s]."""

TOPICS: Mapping[str, tuple[tuple[Any, str], ...]] = {
    "marketplace": (
        (Scene, "bt_agents/scene"),
        (Bids, "bt_agents/bids"),
        (OpenGoals, "bt_agents/open_goals"),
    ),
    "scene_layer": ((Empty, "scene_layer/trigger"), (Run, "bt_agents/runs")),
    "feedback": (
        (HostCard, "bt_agents/cards"),
        (Scene, "bt_agents/scene/live"),
        (Run, "bt_agents/runs"),
    ),
    "agents": ((CallForBids, "bt_agents/calls"), (Run, "bt_agents/runs")),
    "robot": ((String, "sound"), (String, "answers"), (OpenGoals, "bt_agents/open_goals")),
}
SERVICES: Mapping[str, tuple[tuple[Any, str], ...]] = {
    "marketplace": (
        (OperateMarket, "marketplace/operate"),
        (CancelRun, "marketplace/cancel"),
        (RegisterHost, "marketplace/register"),
    ),
    "scene_layer": ((Analyze, "scene_layer/analyze"), (Remember, "scene_layer/remember")),
    "feedback": ((GiveFeedback, "feedback/give"), (ManageProfiles, "feedback/manage")),
    "agents": ((SetProfile, "agents/set_profile"), (Tune, "agents/tune")),
    "robot": ((SetLight, "set_light"),),
}
ACTIONS: Mapping[str, tuple[Any, str]] = {
    "agents": (RunAgent, "agents/run"),
    "robot": (Say, "say"),
}
PARAMETERS = (
    (SetParameters, "set_parameters"),
    (GetParameters, "get_parameters"),
    (ListParameters, "list_parameters"),
)

_UNDER_WAY = 50
"""Requests that a flood sends before it waits for answers."""

_UNDER_WAY_BYTES = 32 * limits.MIB
"""Bytes of the requests that a flood sends before it waits for answers."""

_MOST_PARAMETERS = limits.ENTRIES_OF["SetParameters_Request.parameters"]

_LATE_S = 1.0
_HANG_S = 60.0
"""Time after which a flood that does not end prints where it hangs, and ends the process [s]."""

_OVER = 1.5
"""Ratio of an oversized message to the limit."""

_FLOODER = QoSProfile(
    depth=5, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""Matches every subscription."""


class Flood:
    """One flooding process: its node, its target and its duration."""

    def __init__(self, target: str, seconds: float) -> None:
        self.node = rclpy.create_node("flooder", enable_rosout=False)
        self.target = target
        self.seconds = seconds
        self.sent = 0

    def lasts(self) -> Callable[[], bool]:
        """Start the time; return a function that reports whether it continues."""
        end = time.monotonic() + self.seconds
        print("begins", flush=True)
        return lambda: not self.sent or time.monotonic() < end

    def publish(self, *topics: tuple[Any, str, bytes]) -> None:
        """Publish bytes on topics in turn, as fast as possible."""
        made = []
        for kind, topic, message in topics:
            made.append((self.publisher(kind, topic), message))
        goes_on = self.lasts()
        while goes_on():
            for publisher, message in made:
                publisher.publish(message)
                self.sent += 1
        for publisher, _ in made:
            publisher.wait_for_all_acked(Duration(seconds=_LATE_S))

    def publisher(self, kind: Any, topic: str) -> Publisher[Any]:
        """Return a publisher matched with the target, not only with others on the topic."""
        made = self.node.create_publisher(kind, topic, _FLOODER)

        def is_heard() -> bool:
            found = self.node.get_subscriptions_info_by_topic(made.topic_name)
            has_node = any(one.node_name == self.target for one in found)
            return has_node and made.get_subscription_count() >= len(found)

        until(is_heard)
        return made

    def ask(self, *services: tuple[Any, str, Callable[[int], Any]]) -> None:
        """Send requests to services in turn, several at a time."""
        made = []
        largest = 1
        for kind, name, make in services:
            client = self.node.create_client(kind, name, qos_profile=EVENTS)
            until(client.service_is_ready)
            made.append((client, make))
            largest = max(largest, len(serialize_message(make(0))))
        most = min(_UNDER_WAY, _UNDER_WAY_BYTES // largest)
        goes_on = self.lasts()
        answers: list[Any] = []
        for number in count():
            if not goes_on():
                break
            for client, make in made:
                answers.append(client.call_async(make(number)))
                self.sent += 1
            late = time.monotonic() + _LATE_S
            while len(answers) > most and time.monotonic() < late:
                rclpy.spin_once(self.node, timeout_sec=0.01)
                answers = [answer for answer in answers if not answer.done()]


def until(condition: Callable[[], Any]) -> None:
    """Wait for a condition, or end the process."""
    end = time.monotonic() + MATCHED_S
    while not condition():
        if time.monotonic() > end:
            sys.exit("the node is not found")
        time.sleep(0.02)


def filled(kind: Any, size: int) -> Any:
    """Return a message of a given size with as many small objects in it as possible.

    Lists and texts stay within their limits unless the whole message exceeds its own.
    """
    message = kind()
    is_over = size > largest_bytes(kind)
    left = size - len(serialize_message(message))
    for field, slot in slots_of(kind).items():
        if isinstance(slot, idl.NamespacedType):
            inner = resolved(slot)
            part = filled(inner, left if is_over else min(left, int(largest_bytes(inner))))
            setattr(message, field, part)
        elif isinstance(slot, idl.AbstractSequence):
            entry = _entry(slot.value_type)
            ten, one = (
                len(serialize_message(kind(**{field: [entry] * number}))) for number in (11, 1)
            )
            fitting = max(0, 10 * left // max(ten - one, 1))
            most = most_entries(kind, field, slot.value_type)
            number = fitting if is_over or most is None else min(fitting, most)
            setattr(message, field, [entry] * number)
        elif isinstance(slot, idl.AbstractGenericString):
            most = limits.CHARACTERS_OF.get(f"{kind.__name__}.{field}", limits.TEXT_CHARACTERS)
            longest = left if is_over or not is_own(kind) else min(left, most)
            setattr(message, field, "x" * max(0, longest - 100))
        left = size - len(serialize_message(message))
    return message


def _entry(slot: Any) -> Any:
    kind = resolved(slot)
    if hasattr(kind, "SLOT_TYPES"):
        return kind()
    if isinstance(kind, idl.AbstractGenericString):
        return ""
    return {"boolean": False, "float": 0.0, "double": 0.0, "octet": b"\0"}.get(kind.typename, 0)


def messages(flood: Flood, share: float) -> None:
    """Publish on all topics; each message is a share of its limit."""
    flood.publish(
        *(
            (kind, topic, _serialized(kind, int(share * largest_bytes(kind))))
            for kind, topic in TOPICS[flood.target]
        )
    )


@cache
def _serialized(kind: Any, size: int) -> bytes:
    return bytes(serialize_message(filled(kind, size)))


def malformed(flood: Flood) -> None:
    """Publish bytes that do not form a message."""
    flood.publish(
        *(
            (kind, topic, b"\0\1\0\0" + b"\xff" * 60)
            for kind, topic in TOPICS[flood.target]
            if kind is not Empty
        )
    )


def requests(flood: Flood, share: float) -> None:
    """Call all services; each request is a share of its limit."""
    services = []
    for kind, name in SERVICES[flood.target]:
        request = filled(kind.Request, int(share * largest_bytes(kind.Request)))
        services.append((kind, name, lambda _number, request=request: request))
    flood.ask(*services)


def goals(flood: Flood, share: float) -> None:
    """Send goals."""
    kind, action = ACTIONS[flood.target]
    service = kind.Impl.SendGoalService

    def goal(number: int) -> Any:
        request = filled(service.Request, int(share * limits.MESSAGE_BYTES))
        request.goal_id.uuid = list(number.to_bytes(16, "big"))
        return request

    flood.ask((service, f"{action}/_action/send_goal", goal))


def cancels(flood: Flood) -> None:
    """Cancel all goals of an action, and goals that do not exist."""
    _, action = ACTIONS[flood.target]

    def some(number: int) -> Any:
        request = CancelGoal.Request()
        request.goal_info.goal_id.uuid = list((number % 2).to_bytes(16, "big"))
        return request

    flood.ask((CancelGoal, f"{action}/_action/cancel_goal", some))


def parameters(flood: Flood, entries: int) -> None:
    """Set, get and list parameters that do not exist."""
    made = {
        SetParameters: SetParameters.Request(parameters=[Parameter(name="x")] * entries),
        GetParameters: GetParameters.Request(names=["x"] * entries),
        ListParameters: ListParameters.Request(prefixes=["x"] * entries),
    }
    flood.ask(
        *(
            (kind, f"{flood.target}/{name}", lambda _number, kind=kind: made[kind])
            for kind, name in PARAMETERS
        )
    )


def names(flood: Flood) -> None:
    """Introduce one host after another, each with its own topics."""
    if flood.target == "marketplace":
        flood.ask((RegisterHost, "marketplace/register", _registration))
        return
    kind, topic = (
        (HostCard, "bt_agents/cards")
        if flood.target == "feedback"
        else (OpenGoals, "bt_agents/open_goals")
    )
    publisher = flood.publisher(kind, topic)
    goes_on = flood.lasts()
    for number in count():
        if not goes_on():
            break
        message = kind(host=f"/flood{number}", host_instance="one")
        if kind is OpenGoals:
            message.heartbeat = f"/flood{number}/heartbeat"
        publisher.publish(message)
        flood.sent += 1


def _registration(number: int) -> Any:
    host = f"/flood{number}"
    return RegisterHost.Request(
        host=host,
        host_instance="one",
        run_action=f"{host}/run",
        heartbeat=f"{host}/heartbeat",
        parameters=["age", "familiarity", "mood"],
        agents=[f"agent{number}"],
    )


def participants(flood: Flood) -> None:
    """Join and leave repeatedly, each time with some endpoints."""
    goes_on = flood.lasts()
    while goes_on():
        context = Context()
        rclpy.init(context=context)
        node = Node("joining", context=context, enable_rosout=False)
        for kind, topic in TOPICS[flood.target]:
            node.create_publisher(kind, topic, EVENTS)
        for kind, name in SERVICES[flood.target]:
            node.create_client(kind, name)
        flood.sent += 1
        node.destroy_node()
        context.try_shutdown()


def states(flood: Flood) -> None:
    """Publish feedback and states of actions, like a server that answers a host."""
    states = filled(GoalStatusArray, limits.MESSAGE_BYTES)
    feedback = filled(Say.Impl.FeedbackMessage, limits.MESSAGE_BYTES)
    flood.publish(
        (GoalStatusArray, "say/_action/status", serialize_message(states)),
        (Say.Impl.FeedbackMessage, "say/_action/feedback", serialize_message(feedback)),
    )


FLOODS: Mapping[str, tuple[Callable[[Flood], None], tuple[str, ...]]] = {
    "small messages": (lambda flood: messages(flood, 0.0), tuple(TOPICS)),
    "messages over the limit": (lambda flood: messages(flood, _OVER), tuple(TOPICS)),
    "messages at the limit": (lambda flood: messages(flood, 1.0), tuple(TOPICS)),
    "malformed messages": (malformed, tuple(TOPICS)),
    "small requests": (lambda flood: requests(flood, 0.0), tuple(SERVICES)),
    "requests over the limit": (lambda flood: requests(flood, _OVER), tuple(SERVICES)),
    "requests at the limit": (lambda flood: requests(flood, 1.0), tuple(SERVICES)),
    "goals": (lambda flood: goals(flood, 0.0), tuple(ACTIONS)),
    "goals over the limit": (lambda flood: goals(flood, _OVER), tuple(ACTIONS)),
    "cancels": (cancels, tuple(ACTIONS)),
    "parameters": (lambda flood: parameters(flood, 1), tuple(TOPICS)),
    "many parameters": (lambda flood: parameters(flood, _MOST_PARAMETERS), tuple(TOPICS)),
    "names": (names, ("marketplace", "feedback", "robot")),
    "participants": (participants, tuple(TOPICS)),
    "states of goals": (states, ("agents",)),
}
"""Name → function that floods a node, and the nodes that it applies to.

What is over the limit comes first, so that the middleware has room for what is at the limit.
"""

ROUNDS: Mapping[str, int] = {"messages over the limit": 2}
"""Repeats of a flood in a test, if not once: the middleware keeps memory, which a leak exceeds."""


def pairs() -> Iterator[tuple[str, str]]:
    """Yield each flood with each node that it applies to."""
    for name, (_, targets) in FLOODS.items():
        yield from ((name, target) for target in targets)


def main() -> None:
    """Flood one node after the other, and print how much was sent to each."""
    rclpy.init()
    for line in sys.stdin:
        name, target, seconds = line.strip().split(", ")
        faulthandler.dump_traceback_later(float(seconds) + _HANG_S, exit=True)
        flood = Flood(target, float(seconds))
        FLOODS[name][0](flood)
        flood.node.destroy_node()
        faulthandler.cancel_dump_traceback_later()
        print(f"sent {flood.sent}", flush=True)
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
