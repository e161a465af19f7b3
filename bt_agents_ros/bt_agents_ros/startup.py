# SPDX-License-Identifier: Apache-2.0
"""Start parameters: read before a node is constructed, since they say what it is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import rclpy
from rclpy.node import Node

from bt_agents_ros.parameters import declare, describe

NodeT = TypeVar("NodeT", bound=Node)


@dataclass(frozen=True, kw_only=True)
class StartParameter:
    """Read-only string parameter that is read once at the start; empty unless it is set."""

    name: str
    description: str


TREES = StartParameter(
    name="trees", description="trees folder; empty means ./trees, else the installed one"
)


def make_from_parameters(
    name: str, parameters: tuple[StartParameter, ...], make: Callable[[Mapping[str, str]], NodeT]
) -> NodeT:
    """Return a node that is constructed from the parameters of its process; ``make`` may raise.

    A temporary node reads them; then they are declared on the node itself, too.
    """
    reader = rclpy.create_node(name, start_parameter_services=False, enable_rosout=False)
    try:
        values = {p.name: str(_declare(reader, p)) for p in parameters}
    finally:
        reader.destroy_node()
    node = make(values)
    for parameter in parameters:
        _declare(node, parameter)
    return node


def _declare(node: Node, parameter: StartParameter) -> object:
    return declare(node, parameter.name, "", describe(parameter.description, read_only=True))
