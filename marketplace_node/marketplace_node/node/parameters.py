# SPDX-License-Identifier: Apache-2.0
"""The settings of the market as ROS parameters, described and checked before they count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents.errors import Refused
from bt_agents.ros.parameters import declare, describe
from marketplace_node.settings import (
    MAX_MARGIN,
    MAX_QUEUE,
    ON_NEW_SCENE,
    SECONDS,
    TIE_BREAKS,
    Settings,
)
from marketplace_node.strategies import STRATEGIES

_FIELDS = {name.removesuffix("_s"): name for name in Settings.__dataclass_fields__}
_MEANINGS = {
    "bid_deadline": "from the call for bids to the close of the round [s]",
    "host_lease": "a host without a heartbeat for this long is gone [s]",
    "goal_deadline": "time for a host to take or refuse a run [s]",
    "cancel_deadline": "time for a run to end after it was told to stop [s]",
    "collect_deadline": "time to wait for the feedback service after a run [s]",
    "preempt_cooldown": "after a run was stopped for a scene, no other is for this long [s]",
}


def declare_settings(node: Node) -> Settings:
    """Declare every setting and return the values, which a launch file may have set."""
    defaults = Settings()
    descriptors = _descriptors()
    values: dict[str, Any] = {
        field: declare(node, name, getattr(defaults, field), descriptors[name])
        for name, field in _FIELDS.items()
    }
    return Settings(**values)


def follow_settings(
    node: Node, current: Callable[[], Settings], take: Callable[[Settings], None]
) -> None:
    """Refuse changes of parameters that make no sense, and hand over all others.

    Args:
        node: Whose parameters.
        current: Returns the settings in force.
        take: Called with the settings after each change.
    """

    def changed(parameters: list[Parameter[Any]]) -> Settings:
        changes = {_FIELDS[p.name]: p.value for p in parameters if p.name in _FIELDS}
        return replace(current(), **changes)

    def check(parameters: list[Parameter[Any]]) -> SetParametersResult:
        try:
            changed(parameters)
        except Refused as refused:
            return SetParametersResult(successful=False, reason=str(refused))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(lambda parameters: take(changed(parameters)))


def _descriptors() -> dict[str, ParameterDescriptor]:
    descriptors = {
        "strategy": describe("how bids are compared to the scene", choices=tuple(STRATEGIES)),
        "on_new_scene": describe(
            "what happens to a scene that comes during an interaction", choices=ON_NEW_SCENE
        ),
        "tie_break": describe("which of equally distant bids wins", choices=TIE_BREAKS),
        "queue_limit": describe(
            "how many scenes may wait", minimum=0, maximum=MAX_QUEUE, integer=True
        ),
        "preempt_margin": describe(
            "a run is stopped for an agent that is nearer to the new scene by this distance",
            minimum=0.0,
            maximum=MAX_MARGIN,
        ),
    }
    for name, meaning in _MEANINGS.items():
        least, most = SECONDS[_FIELDS[name]]
        descriptors[name] = describe(meaning, minimum=least, maximum=most)
    return descriptors
