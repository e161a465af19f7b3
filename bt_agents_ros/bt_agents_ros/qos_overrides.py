# SPDX-License-Identifier: Apache-2.0
"""QoS overrides: parameters ``qos_overrides.<topic>.<publisher|subscription>.<policy>``."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from typing import TypeVar

from rclpy.exceptions import ParameterException
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QosCallbackResult,
    QoSOverridingOptions,
)

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, printable_line

PREFIX = "qos_overrides."
"""Start of the names of these parameters; a resolved topic follows."""

MOST_DEPTH = 10_000
"""Largest depth of a queue."""

_KINDS = {
    kind.name.lower(): kind
    for kind in QoSPolicyKind
    if kind not in (QoSPolicyKind.INVALID, QoSPolicyKind.AVOID_ROS_NAMESPACE_CONVENTIONS)
}

EndpointT = TypeVar("EndpointT")


def create_overridden(
    create: Callable[[QoSProfile | int, QoSOverridingOptions | None], EndpointT],
    given: Iterable[str],
    topic: str,
    endpoint: str,
    profile: QoSProfile | int,
) -> EndpointT:
    """Create an endpoint with the overrides that were given for it.

    rclpy declares a parameter for each policy that could be overridden; this function declares
    only the given ones, so that ``ros2 param list`` does not show hundreds.

    Args:
        create: Creates the endpoint with a profile and rclpy's options.
        given: Names of all parameters that were given to the node.
        topic: Its resolved topic.
        endpoint: ``publisher`` or ``subscription``.
        profile: Its profile without overrides, which is not changed.

    Raises:
        Refused: ``BAD_QOS_OVERRIDE``: a policy or a value that does not exist.
    """
    start = f"{PREFIX}{topic}.{endpoint}."
    names = sorted(name.removeprefix(start) for name in given if name.startswith(start))
    if not names:
        return create(profile, None)
    unknown = [name for name in names if name not in _KINDS]
    if unknown:
        raise _refused(start, f"'{unknown[0]}' is none of {', '.join(sorted(_KINDS))}")
    options = QoSOverridingOptions([_KINDS[name] for name in names], callback=_check)
    try:
        # rclpy writes the overrides into the profile, which other endpoints share.
        return create(copy.copy(profile), options)
    except (ParameterException, InvalidQosOverridesError, RuntimeError) as error:
        raise _refused(start, str(error)) from error


def _refused(start: str, reason: str) -> Refused:
    text = f"parameters '{start}*': {reason}"
    return Refused(RefusalCode.BAD_QOS_OVERRIDE, ellipsize(printable_line(text), 400))


def _check(profile: QoSProfile) -> QosCallbackResult:
    fits = 0 <= profile.depth <= MOST_DEPTH
    return QosCallbackResult(
        successful=fits,
        reason="" if fits else f"depth is {profile.depth}, expected 0 to {MOST_DEPTH}",
    )
