# SPDX-License-Identifier: Apache-2.0
"""Conversion of tunable parameters to ``TunableInfo`` and back."""

from __future__ import annotations

from typing import Any

from rclpy.parameter import Parameter, parameter_value_to_python

from bt_agents.host.tuning.tunable import TunableKind, TunableParameter
from bt_agents_core.field_types import FieldType
from bt_agents_interfaces.msg import TunableInfo

_KINDS = {
    TunableKind.TUNABLE: TunableInfo.TUNABLE,
    TunableKind.LEARNING_RATE: TunableInfo.LEARNING_RATE,
    TunableKind.TICK_RATE: TunableInfo.TICK_RATE,
}
_TYPES = {
    FieldType.NUMBER: TunableInfo.NUMBER,
    FieldType.DURATION: TunableInfo.DURATION,
    FieldType.LENGTH: TunableInfo.LENGTH,
    FieldType.ANGLE: TunableInfo.ANGLE,
    FieldType.INTEGER: TunableInfo.INTEGER,
    FieldType.BOOLEAN: TunableInfo.BOOLEAN,
    FieldType.TEXT: TunableInfo.TEXT,
}
_KIND_OF = {number: kind for kind, number in _KINDS.items()}
_TYPE_OF = {number: field_type for field_type, number in _TYPES.items()}


def info_to_msg(parameter: TunableParameter) -> TunableInfo:
    """Return the message that describes a parameter."""
    message = TunableInfo(
        name=parameter.name,
        agent=parameter.agent,
        key=parameter.key,
        kind=_KINDS[parameter.kind],
        type=_TYPES[parameter.type],
        unit=parameter.unit,
        default_value=Parameter(parameter.name, value=parameter.default).get_parameter_value(),
        step=float(parameter.step),
        description=parameter.description,
    )
    if parameter.minimum is not None and parameter.maximum is not None:
        message.has_range = True
        message.minimum, message.maximum = float(parameter.minimum), float(parameter.maximum)
    return message


def info_from_msg(message: Any) -> TunableParameter:
    """Return the parameter that a message describes."""
    return TunableParameter(
        name=message.name,
        agent=message.agent,
        key=message.key,
        kind=_KIND_OF[message.kind],
        type=_TYPE_OF[message.type],
        default=parameter_value_to_python(message.default_value),
        minimum=message.minimum if message.has_range else None,
        maximum=message.maximum if message.has_range else None,
        step=message.step,
        description=message.description,
    )
