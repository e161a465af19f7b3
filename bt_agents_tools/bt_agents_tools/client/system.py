# SPDX-License-Identifier: Apache-2.0
"""Requests to a running system by a command line, each bounded in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters

from bt_agents_interfaces.msg import Auction, Feedback, MoodTrace, Persons, SceneEnd, Trees
from bt_agents_interfaces.srv import Analyze, CancelRun, GiveFeedback, ManageProfiles
from bt_agents_ros import qos
from bt_agents_tools.client.observer import Observer

_FIND_CARDS_S = 3.0

_MANAGE_LIMIT_S = 30.0
"""Longest time for managing profiles: erasing a person rewrites the whole ledger [s]."""

KINDS = {
    "direct": Feedback.DIRECT,
    "positive": Feedback.POSITIVE,
    "negative": Feedback.NEGATIVE,
    "set": Feedback.SET,
}


def analyze(
    observer: Observer,
    names: Sequence[str],
    values: Sequence[float],
    *,
    label: str = "",
    person: bool | None = None,
    urgent: bool = False,
    announce: bool,
) -> Any:
    """Ask the scene layer for a scene; return its response, None without an answer.

    Args:
        observer: In the graph of the system.
        names: Parameters whose value is given.
        values: Their values, same order.
        label: Name for people.
        person: Presence of a person; None takes what is measured.
        urgent: True may stop a running tree, where new scenes preempt.
        announce: False changes the live scene only.
    """
    presence = Analyze.Request.AS_MEASURED
    if person is not None:
        presence = Analyze.Request.PRESENT if person else Analyze.Request.ABSENT
    request = Analyze.Request(
        label=label, names=names, values=values, person=presence, urgent=urgent, announce=announce
    )
    return observer.call(Analyze, "scene_layer/analyze", request)


def cancel_run(observer: Observer, reason: str, round_number: int = 0) -> Any:
    """Stop a run; return the market's response, None without an answer.

    Args:
        observer: In the graph of the system.
        reason: Reason for people.
        round_number: Round of the run; 0 stops whatever runs and drops the scenes that wait.
    """
    request = CancelRun.Request(reason=reason, round=round_number)
    return observer.call(CancelRun, "marketplace/cancel", request)


def admission_settings(observer: Observer) -> tuple[str, int] | None:
    """Return the market's ``on_new_scene`` and ``queue_limit``; None without an answer."""
    request = GetParameters.Request(names=["on_new_scene", "queue_limit"])
    answer = observer.call(GetParameters, "marketplace/get_parameters", request)
    if answer is None or len(answer.values) != len(request.names):
        return None
    mode, limit = answer.values
    return mode.string_value, int(limit.integer_value)


def give_feedback(
    observer: Observer, agent: str, kind: str, values: Sequence[float], reason: str
) -> Any:
    """Give feedback; return the feedback node's response, None without an answer.

    Args:
        observer: In the graph of the system.
        agent: The agent; empty means the one that runs, else the one that ran last.
        kind: One of :data:`KINDS`.
        values: The wanted profile of direct and set, NaN for no opinion; otherwise empty.
        reason: Reason for people.
    """
    request = GiveFeedback.Request(
        agent=agent, kind=KINDS[kind], values=values, source="command line", reason=reason
    )
    return observer.call(GiveFeedback, "feedback/give", request)


def manage_profiles(
    observer: Observer, action: str, *, node: str = "feedback", find_s: float = 10.0, **fields: Any
) -> Any:
    """List or change learned profiles; return the response, None without an answer.

    Args:
        observer: In the graph of the system.
        action: Name of a constant of ``ManageProfiles.srv``.
        node: Node to ask, ``feedback`` or ``scene_layer``.
        find_s: Longest time for discovery of the service [s].
        fields: The other fields of the request.
    """
    request = ManageProfiles.Request(action=getattr(ManageProfiles.Request, action), **fields)
    return observer.call(ManageProfiles, f"{node}/manage", request, _MANAGE_LIMIT_S, find_s=find_s)


def decisions(observer: Observer) -> list[Any]:
    """Return a list that fills with the last decisions while the observer is spun."""
    received: list[Any] = []
    observer.node.create_subscription(Auction, "auctions", received.append, qos.HISTORY)
    return received


def scene_ends(observer: Observer) -> list[Any]:
    """Return a list that fills with the last ends of scenes while the observer is spun."""
    received: list[Any] = []
    observer.node.create_subscription(SceneEnd, "scene_ends", received.append, qos.HISTORY)
    return received


def mood_traces(observer: Observer) -> list[Any]:
    """Return a list that fills with the last traces of moods while the observer is spun."""
    received: list[Any] = []
    observer.node.create_subscription(MoodTrace, "mood_traces", received.append, qos.HISTORY)
    return received


def trees(observer: Observer) -> dict[tuple[str, str], str]:
    """Return agent and path of a node → its name, for the trees of all hosts that are known.

    The mapping fills while the observer is spun.
    """
    names: dict[tuple[str, str], str] = {}

    def handle(message: Any) -> None:
        for tree in message.trees:
            names.update({(tree.agent, node.path): node.name for node in tree.nodes})

    observer.spin_until(lambda: bool(observer.cards), _FIND_CARDS_S)
    for host in observer.cards:
        observer.node.create_subscription(Trees, f"{host}/trees", handle, qos.FACT)
    return names


def persons(observer: Observer) -> list[Any]:
    """Return a list that fills with the tracked persons while the observer is spun."""
    received: list[Any] = []
    observer.node.create_subscription(Persons, "scene/persons", received.append, qos.FACT)
    return received


def watch_decisions(
    observer: Observer, auction: Callable[[Any], None], feedback: Callable[[Any], None]
) -> None:
    """Call back for every decision and every applied feedback."""
    observer.node.create_subscription(Auction, "auctions", auction, qos.FACTS)
    observer.node.create_subscription(Feedback, "feedback", feedback, qos.FACTS)
