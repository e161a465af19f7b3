# SPDX-License-Identifier: Apache-2.0
"""Base class of every node of the system, with what all nodes offer to ROS operators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_ros.logger_services import LoggerServices
from bt_agents_ros.qos_overrides import create_overridden
from bt_agents_ros.workarounds.local_endpoints import LocalNode
from bt_agents_ros.workarounds.parameter_services import GuardedParameterService
from bt_agents_ros.workarounds.quick_logger import QuickLogger


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
