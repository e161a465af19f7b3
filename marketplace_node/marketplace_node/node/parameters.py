# SPDX-License-Identifier: Apache-2.0
"""Parameters of the market: descriptions, and checks before a value comes into force."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents_core.errors import Refused
from bt_agents_core.liveness import SLOW_NETWORK
from bt_agents_core.text import single_spaced
from bt_agents_ros.parameters import declare, declare_slow_network, describe
from marketplace_node.settings import EXTERNAL, ON_NEW_SCENE, RANGES, Settings, all_options
from marketplace_node.strategies import STRATEGIES, TIE_BREAKS

_FIELDS = {
    name.removesuffix("_s"): name for name in Settings.__dataclass_fields__ if name != "options"
}
_MEANINGS = {
    "shadow_strategy": "second strategy that also ranks each round, without deciding; empty for "
    "none",
    "bid_deadline": "time from the call for bids to the close of the round [s]",
    "host_lease": "time without a heartbeat after which a host counts as gone [s]",
    "host_wait": "time that queued scenes wait for a host that is gone, before they end without a "
    "bid [s]",
    "goal_deadline": "time for a host to accept or refuse a run [s]",
    "cancel_deadline": "time for a run to end after it is told to stop [s]",
    "takeover_deadline": "time for the open goals of a host that is gone to end, before the next "
    "agent may act [s]",
    "collect_deadline": "time to wait for the feedback service after a run [s]",
    "on_new_scene": "what happens to a scene that arrives during an interaction",
    "queue_limit": "maximum number of waiting scenes",
    "preempt_margin": "how much nearer to the new scene another agent must be for the market to "
    "stop the run",
    "preempt_cooldown": "time after a preemption during which the market stops no other run for a "
    "scene [s]",
    "tie_break": "which of equally good bids wins",
    "starvation_rounds": "an agent that bids in this number of rounds without a run counts as "
    "starved; 0 for never",
}


_PROLONGED = ("bid_deadline_s", "host_lease_s", "goal_deadline_s", "takeover_deadline_s")
"""Settings that a slow network prolongs."""


def declare_settings(node: Node) -> Settings:
    """Declare every setting as a parameter and return the values.

    Settings that a slow network prolongs are multiplied by its factor.

    Raises:
        Refused: As :class:`Settings`.
    """
    uses = (f"{name}: {single_spaced(spec.description)}" for name, spec in STRATEGIES.items())
    meanings = {"strategy": "\n".join(["how the market ranks bids", *uses]), **_MEANINGS}
    choices: dict[str, tuple[str, ...]] = {
        "strategy": tuple(STRATEGIES),
        "shadow_strategy": tuple(name for name in STRATEGIES if name != EXTERNAL),
        "on_new_scene": ON_NEW_SCENE,
        "tie_break": TIE_BREAKS,
    }
    defaults = Settings()
    values: dict[str, Any] = {}
    for name, field in _FIELDS.items():
        default = getattr(defaults, field)
        least, most = RANGES.get(field, (None, None))
        descriptor = describe(
            meanings[name],
            minimum=least,
            maximum=most,
            integer=isinstance(default, int),
            choices=choices.get(name, ()),
        )
        values[field] = declare(node, name, default, descriptor)
    values["options"] = {
        name: declare(
            node,
            name,
            option.default,
            describe(option.description, minimum=option.minimum, maximum=option.maximum),
        )
        for name, option in all_options()
    }
    return Settings(**_prolonged(values, declare_slow_network(node)))


def watch_settings(
    node: Node, current: Callable[[], Settings], take: Callable[[Settings], None]
) -> None:
    """Refuse invalid parameters; pass on the settings after every valid change."""

    def changed(parameters: list[Parameter[Any]]) -> Settings:
        changes = {_FIELDS[p.name]: p.value for p in parameters if p.name in _FIELDS}
        changes = _prolonged(changes, float(node.get_parameter(SLOW_NETWORK).value))
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


def _prolonged(values: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Return settings prolonged for a slow network, within their ranges."""
    return {
        field: min(value * factor, max(value, RANGES[field][1])) if field in _PROLONGED else value
        for field, value in values.items()
    }
