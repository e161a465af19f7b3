# SPDX-License-Identifier: Apache-2.0
"""Strategies of a running market, and scenes for its operators."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

from rclpy.parameter import Parameter, parameter_value_to_python

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_interfaces.msg import Scene, SceneValue
from bt_agents_ros.messages import header_at
from bt_agents_tools.client.observer import Observer
from bt_agents_tools.client.printable_messages import make_printable
from bt_agents_tools.client.strategies import Strategies, parameter_names, strategies_of

_OF_LAST_SCENE = ("person_id", "place", "persons", "visits", "remembered")
"""Fields that a scene with given values takes from the last scene."""

_NO_ANSWER = "the marketplace does not answer; look at 'bt-agents status'"


def scene_of(
    node: Any,
    names: Sequence[str],
    given: Mapping[str, float],
    last: Any = None,
    *,
    scene_id: str,
    person: bool | None = None,
    label: str = "",
) -> Any:
    """Return a scene message with some given values; others are as in the last scene or missing.

    Without ``person``, a person is present as in the last scene, or if there is no last scene.
    """
    known = {value.name: value for value in last.values} if last is not None else {}
    scene = Scene(
        header=header_at(node.get_clock().now().to_msg()),
        scene_id=scene_id,
        label=label,
        person=person if person is not None else (last is None or bool(last.person)),
        values=[_value(name, given, known) for name in names],
    )
    if last is not None:
        for field in _OF_LAST_SCENE:
            setattr(scene, field, getattr(last, field))
    return scene


def next_scene(last: Any, present: Any) -> Any:
    """Return the scene for another round, None before the first one.

    During a run it is the live scene, which has the id of the run's scene. Otherwise it is the
    last scene, with values that the person has told since and that the ``present`` scene still
    has.
    """
    if last is None or present is None:
        return last
    if present.scene_id:
        return present if present.scene_id == last.scene_id else last
    told = {one.name: one for one in present.values if one.origin == SceneValue.TOLD}
    scene = deepcopy(last)
    scene.values = [told.get(one.name, one) for one in last.values]
    return scene


def _value(name: str, given: Mapping[str, float], known: Mapping[str, Any]) -> Any:
    if name in given:
        return SceneValue(name=name, value=given[name], origin=SceneValue.GIVEN)
    if name in known:
        return known[name]
    nan = math.nan
    return SceneValue(name=name, value=nan, origin=SceneValue.MISSING, age_s=nan, std=nan)


def strategies(observer: Observer) -> Strategies:
    """Return the strategies of the market with their current values.

    Raises:
        Refused: ``NO_ANSWER``: there is none, or it lacks a part.
    """
    infos = observer.market.strategies
    names = parameter_names(infos)
    described = observer.ask("marketplace/describe_parameters", names=names)
    got = observer.ask("marketplace/get_parameters", names=names)
    if described is None or got is None:
        raise Refused(RefusalCode.NO_ANSWER, _NO_ANSWER)
    values = [parameter_value_to_python(make_printable(one)) for one in got.values]
    return strategies_of(infos, described.descriptors, values)


def set_parameters(observer: Observer, changes: Mapping[str, str | float]) -> None:
    """Set parameters of the market together.

    Raises:
        BtAgentsError: It refuses them, or does not answer (``NO_ANSWER``).
    """
    parameters = [
        Parameter(name, value=value).to_parameter_msg() for name, value in changes.items()
    ]
    answer = observer.ask("marketplace/set_parameters_atomically", parameters=parameters)
    if answer is None:
        raise Refused(RefusalCode.NO_ANSWER, _NO_ANSWER)
    if not answer.result.successful:
        raise BtAgentsError(answer.result.reason or "it gives no reason")
