# SPDX-License-Identifier: Apache-2.0
"""Parameter services of rclpy whose setters refuse requests that end the node in rclpy 7.1."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

_LONGEST_NAME = 80


class GuardedParameterService(ParameterService):
    """Callbacks of the two setters, which refuse types or names that do not exist."""

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        response.results = [_set_together(self._get_node(), [p]) for p in request.parameters]
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        response.result = _set_together(self._get_node(), request.parameters)
        return response


def _set_together(node: Node, messages: Sequence[Any]) -> SetParametersResult:
    try:
        return node.set_parameters_atomically([_parameter(node, one) for one in messages])
    except Refused as refused:
        return SetParametersResult(successful=False, reason=str(refused))
    except Exception as error:
        node.get_logger().error(f"parameters could not be set:\n{traceback.format_exc()}")
        reason = str(
            Refused(RefusalCode.FAILED, f"{type(error).__name__}: {error}; the log says more")
        )
        return SetParametersResult(successful=False, reason=reason)


def _parameter(node: Node, message: Any) -> Parameter[Any]:
    name = message.name[:_LONGEST_NAME]
    if not node.has_parameter(message.name):
        raise Refused(
            RefusalCode.UNKNOWN_PARAMETER,
            f"there is no parameter '{name}'; `ros2 param list {node.get_fully_qualified_name()}` "
            "shows those that there are",
        )
    try:
        return Parameter.from_parameter_msg(message)
    except ValueError:
        raise Refused(
            RefusalCode.UNKNOWN_TYPE,
            f"parameter '{name}' is sent with type {message.value.type}, expected one of "
            "rcl_interfaces/msg/ParameterType: 1 bool, 2 integer, 3 double, 4 string, 5-9 arrays",
        ) from None
