# SPDX-License-Identifier: Apache-2.0
"""Activation of a node: everything made during it is destroyed together at its end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient, ActionServer

_CALLBACKS = (
    "_pre_set_parameters_callbacks",
    "_on_set_parameters_callbacks",
    "_post_set_parameters_callbacks",
)

_DESTROY = {
    "timers": "destroy_timer",
    "subscriptions": "destroy_subscription",
    "services": "destroy_service",
    "clients": "destroy_client",
    "publishers": "destroy_publisher",
    "guards": "destroy_guard_condition",
}
"""Node attribute that lists entities → its method that destroys one and its event handlers."""


class Activation:
    """Endpoints, timers, parameters and callbacks that a node gets after this object is made.

    In rclpy, their only scope is the node itself.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        # The objects themselves, because the id of a deleted object may be reused.
        self._before = [one for kind in (*_DESTROY, "waitables") for one in getattr(node, kind)]
        self._parameters = frozenset(node._parameters)
        self._callbacks = {name: list(getattr(node, name)) for name in _CALLBACKS}

    def end(self, *, keeps: Callable[[str], bool]) -> None:
        """Destroy everything that was made.

        Args:
            keeps: Whether a parameter keeps its value when it is declared again.
        """
        node = self._node
        before = {id(entity) for entity in self._before}

        def made(kind: str) -> list[Any]:
            return [one for one in getattr(node, kind) if id(one) not in before]

        for waitable in made("waitables"):
            if isinstance(waitable, (ActionClient, ActionServer)):
                waitable.destroy()
        for kind, destroy in _DESTROY.items():
            for entity in made(kind):
                getattr(node, destroy)(entity)
        for waitable in made("waitables"):
            node.remove_waitable(waitable)
        for name, callbacks in self._callbacks.items():
            getattr(node, name)[:] = callbacks
        for name in node._parameters.keys() - self._parameters:
            # Read-only parameters cannot be undeclared.
            parameter = node._parameters.pop(name)
            del node._descriptors[name]
            if keeps(name):
                node._parameter_overrides[name] = parameter
