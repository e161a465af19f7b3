# SPDX-License-Identifier: Apache-2.0
"""The six parameter services of a node, which answer whatever they are asked."""

from __future__ import annotations

import traceback
import weakref
from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import ListParametersResult, SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents_core.errors import Refused
from bt_agents_ros import qos
from bt_agents_ros.workarounds.bounded_requests import (
    Measure,
    TooLarge,
    bounded,
    count_parameters,
    count_texts,
)

MOST = 1000
"""Parameters, names or entries of arrays in one request; to set so many takes 50 ms."""

MOST_PREFIXES = 100
"""Prefixes in one request for a list; each is compared with every parameter."""

_LONGEST_NAME = 80


class ParameterServices:
    """Serves the parameters of a node as ``rclpy.parameter_service`` does, and never raises.

    A parameter that cannot be set is answered with the reason. A request for the values of names
    that are not all declared is answered with nothing, which is what ROS tools expect.

    Args:
        node: Made with ``start_parameter_services=False``.
    """

    def __init__(self, node: Node) -> None:
        self._node: Callable[[], Node | None] = weakref.ref(node)
        for kind, name, answer, measure, most in (
            (DescribeParameters, "describe_parameters", self._describe, count_texts, MOST),
            (GetParameters, "get_parameters", self._get, count_texts, MOST),
            (GetParameterTypes, "get_parameter_types", self._get_types, count_texts, MOST),
            (ListParameters, "list_parameters", self._list, count_texts, MOST_PREFIXES),
            (SetParameters, "set_parameters", self._set, count_parameters, MOST),
            (
                SetParametersAtomically,
                "set_parameters_atomically",
                self._set_atomically,
                count_parameters,
                MOST,
            ),
        ):
            self._serve(node, kind, name, answer, measure, most)

    def _serve(
        self,
        node: Node,
        kind: Any,
        name: str,
        answer: Callable[[Node, Any, Any], None],
        measure: Measure,
        most: int,
    ) -> None:
        empty = kind.Response

        def callback(request: Any, response: Any) -> Any:
            owner = self._node()
            if owner is None:
                return response
            try:
                answer(owner, request, response)
            except Exception:
                owner.get_logger().error(f"~/{name} failed:\n{traceback.format_exc()}")
                return empty()
            return response

        node.create_service(
            bounded(kind, measure, most), f"~/{name}", callback, qos_profile=qos.SERVICE
        )

    def _describe(self, node: Node, request: Any, response: Any) -> None:
        if _all_declared(node, request):
            response.descriptors = node.describe_parameters(request.names)

    def _get(self, node: Node, request: Any, response: Any) -> None:
        if _all_declared(node, request):
            response.values = [
                node.get_parameter(name).get_parameter_value() for name in request.names
            ]

    def _get_types(self, node: Node, request: Any, response: Any) -> None:
        if _all_declared(node, request):
            response.types = node.get_parameter_types(request.names)

    def _list(self, node: Node, request: Any, response: Any) -> None:
        response.result = (
            ListParametersResult()
            if isinstance(request, TooLarge)
            else node.list_parameters(request.prefixes, request.depth)
        )

    def _set(self, node: Node, request: Any, response: Any) -> None:
        if isinstance(request, TooLarge):
            response.results = [_too_large(request)]
        else:
            response.results = [_set_together(node, [p]) for p in request.parameters]

    def _set_atomically(self, node: Node, request: Any, response: Any) -> None:
        if isinstance(request, TooLarge):
            response.result = _too_large(request)
        else:
            response.result = _set_together(node, request.parameters)


def _all_declared(node: Node, request: Any) -> bool:
    return not isinstance(request, TooLarge) and all(map(node.has_parameter, request.names))


def _too_large(request: TooLarge) -> SetParametersResult:
    return SetParametersResult(
        successful=False,
        reason=f"TOO_MANY: {request.entries} parameters and entries of arrays in one request, "
        f"expected at most {MOST}; nothing is set, send them in several requests",
    )


def _set_together(node: Node, messages: Sequence[Any]) -> SetParametersResult:
    """Set all or none of some parameters; say why not."""
    try:
        return node.set_parameters_atomically([_parameter(node, m) for m in messages])
    except Refused as refused:
        return SetParametersResult(successful=False, reason=str(refused))
    except Exception as error:
        node.get_logger().error(f"parameters could not be set:\n{traceback.format_exc()}")
        reason = str(Refused("FAILED", f"{type(error).__name__}: {error}; the log says more"))
        return SetParametersResult(successful=False, reason=reason)


def _parameter(node: Node, message: Any) -> Parameter[Any]:
    """Return what a message says.

    Raises:
        Refused: It names no parameter of the node, or a type that does not exist.
    """
    name = message.name[:_LONGEST_NAME]
    if not node.has_parameter(message.name):
        raise Refused(
            "UNKNOWN_PARAMETER",
            f"there is no parameter '{name}'; `ros2 param list {node.get_fully_qualified_name()}` "
            "shows those that there are",
        )
    try:
        return Parameter.from_parameter_msg(message)
    except ValueError:
        raise Refused(
            "UNKNOWN_TYPE",
            f"parameter '{name}' is sent with type {message.value.type}, expected one of "
            "rcl_interfaces/msg/ParameterType: 1 bool, 2 integer, 3 double, 4 string, 5-9 arrays",
        ) from None
