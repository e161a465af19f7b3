# SPDX-License-Identifier: Apache-2.0
"""What a command line can ask of the tuning of a running host, each request bounded in time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python

from bt_agents.host.tuning.tunable import TICK_RATE, Setting, TunableKind, TunableParameter
from bt_agents.host.tuning.tunable_parameters import DEFAULT
from bt_agents_core.errors import BtAgentsError
from bt_agents_interfaces.msg import Tunings
from bt_agents_interfaces.srv import Tune
from bt_agents_language.model.quantities import QuantityError
from bt_agents_language.model.specs import FieldType
from bt_agents_ros import qos
from bt_agents_tools.client.observer import Observer

ACTIONS = {
    "set": Tune.Request.SET,
    "undo": Tune.Request.UNDO,
    "redo": Tune.Request.REDO,
    "apply": Tune.Request.APPLY,
    "save": Tune.Request.SAVE,
    "forget": Tune.Request.FORGET,
}

_MOST = 500
"""Parameters of one request."""

_UNIT = re.compile(r"(.*) \[(s|m|rad)\]")
_UNITS = {"s": FieldType.DURATION, "m": FieldType.LENGTH, "rad": FieldType.ANGLE}
_TYPES = {bool: FieldType.BOOLEAN, int: FieldType.INTEGER, str: FieldType.TEXT}


@dataclass(frozen=True, kw_only=True)
class KnobState:
    """A knob of a running host and where it stands."""

    knob: TunableParameter
    value: Setting


def tune(observer: Observer, host: str, action: str, **fields: Any) -> Any:
    """Ask a host to tune; return its response, None without an answer.

    Args:
        observer: In the graph of the system.
        host: Fully qualified name of the host.
        action: One of :data:`ACTIONS`.
        fields: Of the request.
    """
    request = Tune.Request(action=ACTIONS[action], **fields)
    return observer.call(Tune, f"{host}/tune", request)


def tunings(observer: Observer, host: str) -> Any:
    """Return what was tuned on a host.

    Raises:
        BtAgentsError: It does not say.
    """
    heard: list[Any] = []
    subscription = observer.node.create_subscription(
        Tunings, f"{host}/tunings", heard.append, qos.FACT
    )
    observer.spin_until(lambda: bool(heard), 3.0)
    observer.node.destroy_subscription(subscription)
    if not heard:
        raise BtAgentsError(f"{host} does not say what was tuned; look at 'bt-agents status'")
    return heard[-1]


def knobs(observer: Observer, host: str, agents: Sequence[str] = ()) -> list[KnobState]:
    """Return the knobs of a host, or of some of its agents, in the order of their names.

    Raises:
        BtAgentsError: The host does not answer.
    """
    listed = _asked(observer, ListParameters, host, "list_parameters", ListParameters.Request())
    names = [n for n in sorted(listed.result.names) if not agents or n.split(".")[0] in agents]
    return [state for some in _parts(names) for state in _described(observer, host, some)]


def _described(observer: Observer, host: str, names: Sequence[str]) -> Iterator[KnobState]:
    described = _asked(
        observer,
        DescribeParameters,
        host,
        "describe_parameters",
        DescribeParameters.Request(names=names),
    )
    got = _asked(
        observer, GetParameters, host, "get_parameters", GetParameters.Request(names=names)
    )
    # Agents may come and go between the requests.
    for descriptor, message in zip(described.descriptors, got.values, strict=False):
        value = parameter_value_to_python(message)
        if descriptor.additional_constraints.startswith(DEFAULT):
            yield KnobState(knob=_knob(descriptor, value), value=value)


def _asked(observer: Observer, kind: Any, host: str, service: str, request: Any) -> Any:
    answer = observer.call(kind, f"{host}/{service}", request)
    if answer is None:
        raise BtAgentsError(f"{host}/{service} does not answer; look at 'bt-agents status'")
    return answer


def _parts(names: Sequence[str]) -> Iterator[Sequence[str]]:
    return (names[start : start + _MOST] for start in range(0, len(names), _MOST))


def _knob(descriptor: Any, value: Setting) -> TunableParameter:
    """Return the knob that a parameter describes."""
    agent, _, rest = descriptor.name.partition(".")
    kind, key = TunableKind.TUNABLE, rest
    if not rest:
        kind, key, agent = TunableKind.TICK_RATE, TICK_RATE.key, ""
    elif rest == "learning_rate":
        kind = TunableKind.LEARNING_RATE
    elif rest.startswith("profile."):
        kind, key = TunableKind.PROFILE, rest.partition(".")[2]
    unit = _UNIT.fullmatch(descriptor.description) if isinstance(value, float) else None
    field_type = _UNITS[unit[2]] if unit else _TYPES.get(type(value), FieldType.NUMBER)
    [limits] = [*descriptor.integer_range, *descriptor.floating_point_range][:1] or [None]
    knob = TunableParameter(
        name=descriptor.name,
        agent=agent,
        key=key,
        kind=kind,
        type=field_type,
        default=value,
        minimum=limits.from_value if limits else None,
        maximum=limits.to_value if limits else None,
        step=float(limits.step) if limits else 0.0,
        description=unit[1] if unit else descriptor.description,
    )
    return _with_default(knob, descriptor.additional_constraints[len(DEFAULT) :])


def _with_default(knob: TunableParameter, text: str) -> TunableParameter:
    try:
        return replace(knob, default=knob.meant(text))
    except QuantityError:
        return knob
