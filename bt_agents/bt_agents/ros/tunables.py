# SPDX-License-Identifier: Apache-2.0
"""Tunables and learning rates as ROS parameters that act on the running tree."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents.language.specs import FieldType, Tunable
from bt_agents.ros.parameters import declare, describe
from bt_agents.roster import Roster

LEARNING_RATE = "learning_rate"
"""Name of the parameter beside an agent's tunables; a tunable cannot have it."""


class TunableParameters:
    """Declares ``<agent>.<tunable>`` and ``<agent>.learning_rate``, and applies what is set.

    Args:
        node: The host's node.
        roster: Its agents; their values are changed between two ticks.
        changed: Called after a learning rate has changed.
    """

    def __init__(self, node: Node, roster: Roster, changed: Callable[[], None]) -> None:
        self._roster = roster
        self._changed = changed
        for name, member in roster.members.items():
            for tunable in member.spec.tunables:
                value = declare(
                    node, f"{name}.{tunable.name}", _native(tunable), _descriptor(tunable)
                )
                member.tunables[tunable.name] = value
            rate = declare(
                node,
                f"{name}.{LEARNING_RATE}",
                member.learning_rate,
                describe("step of a profile towards feedback", minimum=0.0, maximum=1.0),
            )
            member.learning_rate = float(rate)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _check(self, parameters: list[Parameter[Any]]) -> SetParametersResult:
        for parameter in parameters:
            if isinstance(parameter.value, float) and not math.isfinite(parameter.value):
                return SetParametersResult(
                    successful=False,
                    reason=f"{parameter.name} is {parameter.value}, expected a finite number",
                )
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter[Any]]) -> None:
        rate_changed = False
        for parameter in parameters:
            agent, _, name = parameter.name.partition(".")
            member = self._roster.members.get(agent)
            if member is None:
                continue
            if name == LEARNING_RATE:
                member.learning_rate = float(parameter.value)
                rate_changed = True
            elif name in member.tunables:
                member.tunables[name] = parameter.value
        if rate_changed:
            self._changed()


def _native(tunable: Tunable) -> bool | int | float | str:
    if tunable.type in (FieldType.NUMBER, FieldType.DURATION):
        return float(tunable.default)
    return tunable.default


def _descriptor(tunable: Tunable) -> ParameterDescriptor:
    unit = " [s]" if tunable.type is FieldType.DURATION else ""
    return describe(
        tunable.description + unit,
        minimum=tunable.minimum,
        maximum=tunable.maximum,
        step=tunable.step,
        integer=tunable.type is FieldType.INTEGER,
    )
