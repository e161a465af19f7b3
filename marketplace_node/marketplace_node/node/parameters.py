# SPDX-License-Identifier: Apache-2.0
"""Parameters of the market, described, and checked before they count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents_core.errors import Refused
from bt_agents_ros.parameters import declare, describe
from marketplace_node.settings import (
    EXTERNAL,
    MAX_MARGIN,
    MAX_QUEUE,
    MAX_STARVATION,
    ON_NEW_SCENE,
    SECONDS,
    Settings,
    all_options,
)
from marketplace_node.strategies import STRATEGIES, TIE_BREAKS

_FIELDS = {
    name.removesuffix("_s"): name for name in Settings.__dataclass_fields__ if name != "options"
}
_MEANINGS = {
    "bid_deadline": "from the call for bids to the close of the round [s]",
    "host_lease": "a host without a heartbeat for this long is gone [s]",
    "goal_deadline": "time for a host to take or refuse a run [s]",
    "cancel_deadline": "time for a run to end after it was told to stop [s]",
    "collect_deadline": "time to wait for the feedback service after a run [s]",
    "preempt_cooldown": "after a run was stopped for a scene, no other is for this long [s]",
}


def declare_settings(node: Node) -> Settings:
    """Declare every setting and return the values, which a launch file may have set.

    Raises:
        Refused: As :class:`Settings`.
    """
    defaults = Settings()
    descriptors = _descriptors()
    values: dict[str, Any] = {
        field: declare(node, name, getattr(defaults, field), descriptors[name])
        for name, field in _FIELDS.items()
    }
    values["options"] = {
        name: declare(
            node,
            name,
            option.default,
            describe(option.description, minimum=option.minimum, maximum=option.maximum),
        )
        for name, option in all_options()
    }
    return Settings(**values)


def watch_settings(
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
        names = dict(all_options())
        options = {p.name: p.value for p in parameters if p.name in names}
        return replace(current(), **changes, options={**current().options, **options})

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
        "strategy": describe(_strategies(), choices=tuple(STRATEGIES)),
        "shadow_strategy": describe(
            "a second strategy that only scores, to see where it would decide otherwise; empty "
            "for none",
            choices=tuple(name for name in STRATEGIES if name != EXTERNAL),
        ),
        "on_new_scene": describe(
            "what happens to a scene that comes during an interaction", choices=ON_NEW_SCENE
        ),
        "tie_break": describe("which of equally good bids wins", choices=TIE_BREAKS),
        "queue_limit": describe(
            "how many scenes may wait", minimum=0, maximum=MAX_QUEUE, integer=True
        ),
        "starvation_rounds": describe(
            "an agent is starved once it has bid in so many rounds and got no run; 0 never",
            minimum=0,
            maximum=MAX_STARVATION,
            integer=True,
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


def _strategies() -> str:
    """Return what the strategies are for, one a line behind its name."""
    lines = [f"{name}: {' '.join(spec.description.split())}" for name, spec in STRATEGIES.items()]
    return "\n".join(["how bids are ranked", *lines])
