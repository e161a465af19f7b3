# SPDX-License-Identifier: Apache-2.0
"""Conversion of tunable parameters to ``TunableInfo`` and back."""

from __future__ import annotations

from typing import Any

from rclpy.parameter import Parameter, parameter_value_to_python

from bt_agents.host.tuning.tunable import TunableKind, TunableParameter
from bt_agents_core.field_types import FieldType
from bt_agents_interfaces.msg import TunableInfo

_KINDS = {
    getattr(TunableInfo, one.name): one for one in TunableKind if hasattr(TunableInfo, one.name)
}
_TYPES = {
    getattr(TunableInfo, one.name): one for one in FieldType if hasattr(TunableInfo, one.name)
}


def info_to_msg(parameter: TunableParameter) -> TunableInfo:
    """Return the message that describes a parameter."""
    message = TunableInfo(
        name=parameter.name,
        agent=parameter.agent,
        key=parameter.key,
        kind=getattr(TunableInfo, parameter.kind.name),
        type=getattr(TunableInfo, parameter.type.name),
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
        kind=_KINDS[message.kind],
        type=_TYPES[message.type],
        default=parameter_value_to_python(message.default_value),
        minimum=message.minimum if message.has_range else None,
        maximum=message.maximum if message.has_range else None,
        step=message.step,
        description=message.description,
    )
