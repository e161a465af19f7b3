# SPDX-License-Identifier: Apache-2.0
"""Base class of every node of the system, with what all nodes offer to ROS operators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import rclpy.logging
from rcl_interfaces.msg import LoggerLevel, SetLoggerLevelsResult, SetParametersResult
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_ros import qos
from bt_agents_ros.qos_overrides import create_overridden
from bt_agents_ros.workarounds.local_endpoints import LocalNode
from bt_agents_ros.workarounds.parameter_services import GuardedParameterService
from bt_agents_ros.workarounds.quick_logger import QuickLogger

_OF_ROS = frozenset({"rcl", "rclpy", "rmw_fastrtps_cpp", "rmw_cyclonedds_cpp"})
_LEVELS = (0, 10, 20, 30, 40, 50)
_MOST_CHILDREN = 1_000


class LoggerServices:
    """``~/get_logger_levels`` and ``~/set_logger_levels`` of a node.

    rcutils keeps a name forever once it has a level, so these services set levels only for the
    logger of the node, the loggers below it, and the loggers of ROS itself.
    """

    def __init__(self, node: Node) -> None:
        self._name = node.get_logger().name
        self._children: set[str] = set()
        node.create_service(
            GetLoggerLevels, "~/get_logger_levels", self._get, qos_profile=qos.SERVICE
        )
        node.create_service(
            SetLoggerLevels, "~/set_logger_levels", self._set, qos_profile=qos.SERVICE
        )

    def _get(self, request: Any, response: Any) -> Any:
        response.levels = [
            LoggerLevel(name=name, level=int(rclpy.logging.get_logger_level(name)))
            for name in request.names
        ]
        return response

    def _set(self, request: Any, response: Any) -> Any:
        response.results = [self._set_one(one) for one in request.levels]
        return response

    def _set_one(self, one: Any) -> SetLoggerLevelsResult:
        try:
            self._check(one.name, one.level)
        except Refused as refused:
            return SetLoggerLevelsResult(successful=False, reason=str(refused))
        rclpy.logging.set_logger_level(one.name, one.level)
        return SetLoggerLevelsResult(successful=True)

    def _check(self, name: str, level: int) -> None:
        if level not in _LEVELS:
            raise Refused(RefusalCode.UNKNOWN_CHOICE, f"level {level}, expected one of {_LEVELS}")
        if name == self._name or name in _OF_ROS or name in self._children:
            return
        shown = ellipsize(printable_line(name))
        if not name.startswith(f"{self._name}."):
            raise Refused(
                RefusalCode.UNKNOWN_LOGGER,
                f"'{shown}', expected '{self._name}', a name below it, or one of "
                f"{', '.join(sorted(_OF_ROS))}",
            )
        if len(self._children) >= _MOST_CHILDREN:
            raise Refused(RefusalCode.TOO_MANY, f"{_MOST_CHILDREN} loggers have a level already")
        self._children.add(name)


class BaseNode(LocalNode):
    """Node that refuses non-finite parameters and survives malformed requests.

    Services set the levels of loggers, and parameters override QoS policies.

    Attributes:
        may_be_infinite: Parameters that accept infinity.
    """

    may_be_infinite: frozenset[str] = frozenset()

    def __init__(self, name: str, **node_kwargs: Any) -> None:
        super().__init__(name, start_parameter_services=False, **node_kwargs)
        self._logger = QuickLogger(self.get_logger().name)
        self.add_on_set_parameters_callback(self._check_finite)
        self._parameter_service = GuardedParameterService(self)
        self._logger_services = LoggerServices(self)

    def create_publisher(
        self, msg_type: Any, topic: str, qos_profile: QoSProfile | int, **more: Any
    ) -> Publisher[Any]:
        create = super().create_publisher
        return create_overridden(
            lambda profile, options: create(
                msg_type, topic, profile, qos_overriding_options=options, **more
            ),
            self._parameter_overrides,
            self.resolve_topic_name(topic),
            "publisher",
            qos_profile,
        )

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., None],
        qos_profile: QoSProfile | int,
        **more: Any,
    ) -> Subscription[Any]:
        create = super().create_subscription
        return create_overridden(
            lambda profile, options: create(
                msg_type, topic, callback, profile, qos_overriding_options=options, **more
            ),
            self._parameter_overrides,
            self.resolve_topic_name(topic),
            "subscription",
            qos_profile,
        )

    def _check_finite(self, parameters: list[Parameter[Any]]) -> SetParametersResult:
        for parameter in parameters:
            value = parameter.value
            if parameter.name in self.may_be_infinite and value == math.inf:
                continue
            if isinstance(value, float) and not math.isfinite(value):
                return SetParametersResult(
                    successful=False,
                    reason=f"{RefusalCode.NOT_FINITE}: parameter '{parameter.name}' is {value}, "
                    "expected a finite number",
                )
        return SetParametersResult(successful=True)
