# SPDX-License-Identifier: Apache-2.0
"""Base class of every node of the system: checked parameters, quick log lines."""

from __future__ import annotations

import math
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents_ros.workarounds.parameter_services import GuardedParameterService
from bt_agents_ros.workarounds.quick_logger import QuickLogger


class BaseNode(Node):
    """Node that refuses parameters that are not finite, and survives malformed requests."""

    def __init__(self, name: str, **node_kwargs: Any) -> None:
        super().__init__(name, start_parameter_services=False, **node_kwargs)
        self._logger = QuickLogger(self.get_logger().name)
        self.add_on_set_parameters_callback(_check_finite)
        self._parameter_service = GuardedParameterService(self)


def _check_finite(parameters: list[Parameter[Any]]) -> SetParametersResult:
    for parameter in parameters:
        if isinstance(parameter.value, float) and not math.isfinite(parameter.value):
            return SetParametersResult(
                successful=False,
                reason=f"NOT_FINITE: parameter '{parameter.name}' is {parameter.value}, "
                "expected a finite number",
            )
    return SetParametersResult(successful=True)
