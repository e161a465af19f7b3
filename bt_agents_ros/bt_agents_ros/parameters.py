# SPDX-License-Identifier: Apache-2.0
"""Declaration of ROS parameters with description and range."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents_core.errors import Refused
from bt_agents_core.liveness import LIVE_LEASE_S, SLOW_NETWORK
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_ros.qos_overrides import PREFIX as QOS_OVERRIDES
from bt_agents_ros.signals import check_interrupt
from bt_agents_ros.workarounds.bounded_end import ending_in_time

Value = bool | int | float | str

NodeT = TypeVar("NodeT", bound=Node)

LIVE_LEASE = "live_lease"
"""Parameter of hosts and the feedback node: how long a live scene is valid."""


def describe(
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    step: float = 0.0,
    integer: bool = False,
    read_only: bool = False,
    choices: tuple[str, ...] = (),
) -> ParameterDescriptor:
    """Return the descriptor of one parameter.

    Args:
        description: Its meaning and unit.
        minimum: Smallest value; None for no range.
        maximum: Largest value; given together with ``minimum``.
        step: Distance between allowed values, from ``minimum`` on; 0 allows all.
        integer: True for a range of integers.
        read_only: True if it is read once, at the start.
        choices: Allowed texts, named in the additional constraints.
    """
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    if choices:
        descriptor.additional_constraints = "one of: " + ", ".join(choices)
    if minimum is not None and maximum is not None:
        if integer:
            descriptor.integer_range = [
                IntegerRange(from_value=int(minimum), to_value=int(maximum), step=int(step))
            ]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(
                    from_value=float(minimum), to_value=float(maximum), step=float(step)
                )
            ]
    return descriptor


def declare(node: Node, name: str, default: Value, descriptor: ParameterDescriptor) -> Value:
    """Declare a parameter and return its value, which a launch file may have set.

    Raises:
        Refused: ``OUT_OF_RANGE`` or ``WRONG_TYPE``: the value that it was given at the start.
    """
    given = node._parameter_overrides.get(name)
    if given is not None and isinstance(default, float) and type(given.value) is int:
        # In a parameter file, 12 is an integer and only 12.0 a double.
        node._parameter_overrides[name] = Parameter(name, value=float(given.value))
    try:
        value: Value = node.declare_parameter(name, default, descriptor).value
    except InvalidParameterValueException as error:
        raise Refused(RefusalCode.OUT_OF_RANGE, str(error)) from None
    except InvalidParameterTypeException as error:
        hint = f"; a text needs quotes: -p \"{name}:='off'\"" if isinstance(default, str) else ""
        raise Refused(RefusalCode.WRONG_TYPE, f"{error}{hint}") from None
    return value


def declare_and_watch(
    node: Node,
    name: str,
    default: Value,
    descriptor: ParameterDescriptor,
    changed: Callable[[Any], None],
) -> Value:
    """Declare a parameter like :func:`declare`, and call back with each later value."""

    def take(parameters: list[Parameter[Any]]) -> None:
        for parameter in parameters:
            if parameter.name == name:
                changed(parameter.value)

    value = declare(node, name, default, descriptor)
    node.add_post_set_parameters_callback(take)
    return value


def declare_live_lease(node: Node, changed: Callable[[float], None]) -> float:
    """Declare :data:`LIVE_LEASE`; return its value, and call back with each later one [s]."""
    limits = describe(
        "silence after which the live scene is stale, at least 2 / live_rate [s]",
        minimum=0.1,
        maximum=60.0,
    )
    return float(declare_and_watch(node, LIVE_LEASE, LIVE_LEASE_S, limits, changed))


def declare_slow_network(node: Node) -> float:
    """Declare :data:`~bt_agents_core.liveness.SLOW_NETWORK`; return the factor."""
    limits = describe(
        "factor that prolongs deadlines and leases for a slow network, the same for market, hosts "
        "and robot; 4 suits 300 ms each way",
        minimum=1.0,
        maximum=20.0,
        read_only=True,
    )
    return float(declare(node, SLOW_NETWORK, 1.0, limits))


def report_unknown(node: Node, *others: Node) -> dict[str, str]:
    """Log each parameter that was given to a node but that no node of the process has.

    Args:
        node: The node.
        others: Other nodes of the process, which gets the parameters of all its nodes.

    Returns:
        Each parameter that the node itself does not have → the nearest one that it has, empty for
        none. QoS overrides are left out, because their endpoints may still come.
    """
    unknown: dict[str, str] = {}
    for name in sorted(getattr(node, "_parameter_overrides", {})):
        if node.has_parameter(name):
            continue
        is_of_process = any(one.has_parameter(name) for one in others)
        if name.startswith(QOS_OVERRIDES):
            if not is_of_process:
                node.get_logger().warning(
                    f"QOS_OVERRIDE: '{ellipsize(printable_line(name), 200)}' is for a publisher "
                    f"or subscription that {node.get_name()} does not have, at least not yet"
                )
            continue
        known = difflib.get_close_matches(name, node.list_parameters([], 0).names, n=1)
        unknown[name] = near = known[0] if known else ""
        if is_of_process:
            continue
        hint = f"did you mean '{near}'?" if near else "'ros2 param list' shows what it has"
        node.get_logger().warning(
            f"{RefusalCode.UNKNOWN_PARAMETER}: {node.get_name()} has no parameter "
            f"'{ellipsize(printable_line(name))}', so its value counts for nothing; {hint}"
        )
    return unknown


@dataclass(frozen=True, kw_only=True)
class StartParameter:
    """Read-only text parameter that is read before the node is made; empty by default."""

    name: str
    description: str


TREES = StartParameter(
    name="trees",
    description="trees folder; empty means the current folder or ./trees, shipped the installed "
    "one",
)


def make_from_parameters(
    name: str, parameters: tuple[StartParameter, ...], make: Callable[[Mapping[str, str]], NodeT]
) -> NodeT:
    """Return a node that is constructed from the parameters of its process; ``make`` may raise.

    A temporary node reads them; then the node itself declares them, too. A second one keeps the
    participant of the process meanwhile: Fast DDS sometimes hangs while it ends a participant.
    """
    bare = partial(rclpy.create_node, start_parameter_services=False, enable_rosout=False)
    keeper = bare(f"_{name}", use_global_arguments=False)
    try:
        reader = bare(name)
        try:
            values = {p.name: str(declare_start(reader, p)) for p in parameters}
        finally:
            reader.destroy_node()
        check_interrupt()
        node = make(values)
    finally:
        with ending_in_time():
            keeper.destroy_node()
    for parameter in parameters:
        declare_start(node, parameter)
    return node


def declare_start(node: Node, parameter: StartParameter) -> object:
    """Declare a start parameter; return its value."""
    return declare(node, parameter.name, "", describe(parameter.description, read_only=True))
