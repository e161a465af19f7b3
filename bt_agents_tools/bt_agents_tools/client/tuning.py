# SPDX-License-Identifier: Apache-2.0
"""Tunables and profiles of a running system, for commands that show and change them."""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rclpy.parameter import parameter_value_to_python

from bt_agents.host.tuning.tunable import TunableParameter, profile_values
from bt_agents.host.tuning.tune_service import SOMEBODY, info_from_msg
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.feedback import TUNING, FeedbackKind
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_ros.limits import MOST_PARAMETERS
from bt_agents_tools.client.observer import Observer
from bt_agents_tools.client.write_back import ParameterState

_LATCHED_LIMIT_S = 3.0
"""Longest time for a latched message [s]."""


def tunings(observer: Observer, host: str) -> Any:
    """Return the latched ``Tunings`` of a host.

    Raises:
        BtAgentsError: It publishes none.
    """
    return _latched(observer, f"{host}/tunings")


def parameters(observer: Observer, host: str, agents: Sequence[str] = ()) -> list[ParameterState]:
    """Return the parameters of a host, or of some of its agents, sorted by name.

    The values of profiles, from the card of the host, come after the others.

    Raises:
        BtAgentsError: The host does not answer.
    """
    message = _latched(observer, f"{host}/tunables")
    described = [info_from_msg(o) for o in message.tunables if not agents or o.agent in agents]
    described.sort(key=lambda parameter: parameter.name)
    starts = range(0, len(described), MOST_PARAMETERS)
    chunks = (described[start : start + MOST_PARAMETERS] for start in starts)
    states = [state for some in chunks for state in _with_values(observer, host, some)]
    card = observer.cards.get(host)
    return [*states, *(profile_states(card, agents) if card is not None else ())]


def _with_values(
    observer: Observer, host: str, some: Sequence[TunableParameter]
) -> Iterator[ParameterState]:
    names = [parameter.name for parameter in some]
    answer = observer.ask(f"{host}/get_parameters", names=names)
    if answer is None:
        raise _no_answer(f"{host}/get_parameters")
    # Agents may come and go between the messages.
    for parameter, value in zip(some, answer.values, strict=False):
        yield ParameterState(parameter=parameter, value=parameter_value_to_python(value))


def profile_states(card: Any, agents: Sequence[str] = ()) -> Iterator[ParameterState]:
    """Yield the values of the profiles on a ``HostCard``, of all agents or of some."""
    for one in card.agents:
        if not agents or one.name in agents:
            values = profile_values(one.name, card.parameters, one.profile)
            for parameter, value in zip(values, one.current, strict=True):
                yield ParameterState(parameter=parameter, value=float(value))


def set_profile(
    observer: Observer, agent: str, values: Mapping[str, float], *, author: str, reason: str
) -> Any:
    """Ask the feedback node to set values of a profile; return its response, or None.

    Raises:
        Refused: ``UNKNOWN_PARAMETER``.
    """
    observer.spin_until(lambda: observer.profiles is not None, _LATCHED_LIMIT_S)
    names = list(observer.profiles.parameters) if observer.profiles is not None else []
    for name in values:
        if names and name not in names:
            raise Refused(
                RefusalCode.UNKNOWN_PARAMETER,
                f"{quote(agent)} has no {quote(f'profile.{name}')}; {did_you_mean(name, names)}",
            )
    return observer.ask(
        "feedback/give",
        feedback_id=f"{TUNING}/{uuid.uuid4()}",
        agent=agent,
        kind=FeedbackKind.SET,
        values=[values.get(name, math.nan) for name in names],
        source=TUNING,
        reason=f"tuned by {author or SOMEBODY}" + (f": {reason}" if reason else ""),
    )


def tuned_profile(observer: Observer, agent: str, since: float) -> str:
    """Return the agent whose profile has the newest tuning that an undo would revert.

    It is the given agent, or any if that is empty, and the tuning is newer than ``since``
    [s since 1970]. The result is empty if there is none, or without an answer.
    """
    found, newest = "", max(since, 0.0)
    profiles = _history(observer, "profiles")
    for one in sorted(profiles, key=lambda one: float(one["stamp"]), reverse=True):
        if one["stamp"] <= newest:
            break
        if not one["layer"] and agent in ("", one["agent"]):
            stamp = tuned_at(_history(observer, "revisions", agent=one["agent"]))
            if stamp > newest:
                found, newest = str(one["agent"]), stamp
    return found


def _history(observer: Observer, what: str, **fields: Any) -> list[Mapping[str, Any]]:
    answer = observer.ask("feedback/manage", find_s=_LATCHED_LIMIT_S, action="HISTORY", **fields)
    if answer is None or not answer.accepted:
        return []
    return list(json.loads(answer.document)[what])


def tuned_at(revisions: Iterable[Mapping[str, Any]]) -> float:
    """Return when the current values in exported revisions were tuned [s since 1970], or 0."""
    by_number = {one["revision"]: one for one in revisions}
    # An undo is a revision that restores an earlier revision.
    in_force = by_number.get(max(by_number, default=0))
    while in_force is not None and in_force.get("restores"):
        in_force = by_number.get(in_force["restores"])
    tuned = in_force is not None and in_force.get("source") == TUNING
    return float(in_force["stamp"]) if in_force is not None and tuned else 0.0


def _latched(observer: Observer, topic: str) -> Any:
    received = observer.received(topic)
    observer.spin_until(lambda: bool(received), _LATCHED_LIMIT_S)
    if not received:
        raise _no_answer(topic)
    return received[-1]


def _no_answer(name: str) -> BtAgentsError:
    return BtAgentsError(f"{name}: no answer; look at 'bt-agents status'")
