# SPDX-License-Identifier: Apache-2.0
"""Client of the marketplace for the command line; each request is bounded in time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import parameter_value_to_python

from bt_agents_interfaces.msg import Scene, SceneValue
from bt_agents_interfaces.srv import OperateMarket, PreviewAuction
from bt_agents_tools.client.observer import Observer

ACTS = {
    "pin": OperateMarket.Request.PIN,
    "unpin": OperateMarket.Request.UNPIN,
    "veto": OperateMarket.Request.VETO,
    "allow": OperateMarket.Request.ALLOW,
    "award": OperateMarket.Request.AWARD,
}

_NODE = "marketplace"
_STATUS_LIMIT_S = 10.0  # discovery may take long on a busy machine
_PREVIEW_LIMIT_S = 70.0  # more than the longest deadline of a round, with a program outside


@dataclass(frozen=True, kw_only=True)
class StrategyOption:
    """Option of a strategy with its value in force and its range."""

    name: str
    value: float
    minimum: float
    maximum: float
    description: str


@dataclass(frozen=True, kw_only=True)
class Strategies:
    """Strategies of a running market.

    Attributes:
        descriptions: What each is for, by name.
        options: Of each strategy, by name; empty for one without.
        current: The one in force.
        shadow: The one that only scores; empty for none.
    """

    descriptions: Mapping[str, str]
    options: Mapping[str, tuple[StrategyOption, ...]]
    current: str
    shadow: str


def operate(
    observer: Observer, act: str, *, agent: str = "", reason: str = "", scene: Any = None
) -> Any:
    """Have a say in who gets the run; return the market's response, None without an answer.

    Args:
        observer: In the graph of the system.
        act: One of :data:`ACTS`.
        agent: Whom it is about.
        reason: Why, in words.
        scene: Of an award; None means the last scene.
    """
    request = OperateMarket.Request(action=ACTS[act], agent=agent, reason=reason)
    if scene is not None:
        request.scene = scene
    return observer.call(OperateMarket, f"{_NODE}/operate", request)


def preview(observer: Observer, strategy: str, scene: Any = None) -> Any:
    """Ask who would win; return the market's response, None without an answer.

    Args:
        observer: In the graph of the system.
        strategy: Empty for the one in force.
        scene: None means the last scene.
    """
    request = PreviewAuction.Request(strategy=strategy)
    if scene is not None:
        request.scene = scene
    return observer.call(PreviewAuction, f"{_NODE}/preview", request, limit_s=_PREVIEW_LIMIT_S)


def scene_of(
    observer: Observer,
    names: Sequence[str],
    given: Mapping[str, float],
    *,
    scene_id: str,
    like: Any = None,
    person: bool | None = None,
    label: str = "",
) -> Any:
    """Return a scene message with some values given.

    Args:
        observer: In the graph of the system.
        names: All parameters, in order.
        given: Values by name.
        scene_id: Its id.
        like: A scene from which the other values are taken; None leaves them missing.
        person: Whether somebody is there; None is as in ``like``, else yes.
        label: Words for people.
    """
    known = {value.name: value for value in like.values} if like is not None else {}
    scene = Scene(
        stamp=observer.node.get_clock().now().to_msg(),
        scene_id=scene_id,
        label=label,
        person=person if person is not None else (like is None or bool(like.person)),
        values=[_value(name, given, known) for name in names],
    )
    if like is not None:
        scene.person_id, scene.place, scene.persons = like.person_id, like.place, like.persons
    return scene


def _value(name: str, given: Mapping[str, float], known: Mapping[str, Any]) -> Any:
    if name in given:
        return SceneValue(name=name, value=given[name], origin=SceneValue.GIVEN)
    if name in known:
        return known[name]
    return SceneValue(name=name, value=math.nan, origin=SceneValue.MISSING, age_s=math.nan)


def strategies(observer: Observer) -> Strategies | None:
    """Return the strategies of the market with the values in force; None without an answer."""
    if not observer.spin_until(lambda: observer.market is not None, _STATUS_LIMIT_S):
        return None
    found = {info.name: info for info in observer.market.strategies}
    dotted = [f"{name}.{option}" for name, info in found.items() for option in info.options]
    names = ["strategy", "shadow_strategy", *dotted]
    told = observer.call(
        DescribeParameters,
        f"{_NODE}/describe_parameters",
        DescribeParameters.Request(names=names),
    )
    got = observer.call(
        GetParameters, f"{_NODE}/get_parameters", GetParameters.Request(names=names)
    )
    if told is None or got is None or not len(told.descriptors) == len(got.values) == len(names):
        return None
    values = dict(zip(names, map(parameter_value_to_python, got.values), strict=True))
    described = dict(zip(names, told.descriptors, strict=True))
    return Strategies(
        descriptions={name: info.description for name, info in found.items()},
        options={
            name: tuple(
                _option(option, values[f"{name}.{option}"], described[f"{name}.{option}"])
                for option in info.options
            )
            for name, info in found.items()
        },
        current=str(values["strategy"]),
        shadow=str(values["shadow_strategy"]),
    )


def _option(name: str, value: float, descriptor: Any) -> StrategyOption:
    span = descriptor.floating_point_range[0]
    return StrategyOption(
        name=name,
        value=float(value),
        minimum=span.from_value,
        maximum=span.to_value,
        description=descriptor.description,
    )


def set_parameters(observer: Observer, changes: Mapping[str, str | float]) -> str | None:
    """Set parameters of the market together.

    Returns:
        Why it refuses, empty when they are set, None without an answer.
    """
    request = SetParametersAtomically.Request(
        parameters=[Parameter(name=name, value=_typed(value)) for name, value in changes.items()]
    )
    answer = observer.call(SetParametersAtomically, f"{_NODE}/set_parameters_atomically", request)
    if answer is None:
        return None
    return "" if answer.result.successful else str(answer.result.reason or "it gives no reason")


def _typed(value: str | float) -> Any:
    if isinstance(value, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(value))
