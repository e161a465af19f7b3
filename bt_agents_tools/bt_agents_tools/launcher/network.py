# SPDX-License-Identifier: Apache-2.0
"""Network of a system on several machines: access and speed."""

from __future__ import annotations

from collections.abc import MutableMapping

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.private_files import make_private_file
from bt_agents_ros.fastdds_profile import PROFILE, FastDdsProfile
from bt_agents_tools.launcher.domain_lock import runtime_folder
from bt_agents_tools.launcher.supervisor import (
    DISCOVERY_RANGE,
    LAN_PROFILE,
    LOOPBACK_PROFILE,
    set_discovery,
)


def open_to_network(environment: MutableMapping[str, str]) -> None:
    """Admit everybody on the network, as ``ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`` does.

    Raises:
        BtAgentsError: As in :func:`set_discovery`.
    """
    if environment.get(PROFILE) == str(LOOPBACK_PROFILE):
        del environment[PROFILE]
    environment[DISCOVERY_RANGE] = "SUBNET"
    set_discovery(environment)


def prolong_requests(environment: MutableMapping[str, str], factor: float) -> None:
    """Multiply the lifespan of requests by a factor, in a copy of the network profile.

    A profile of the user stays unchanged.
    """
    if factor == 1.0 or environment.get(PROFILE) != str(LAN_PROFILE):
        return
    profile = FastDdsProfile(str(LAN_PROFILE))
    profile.prolong_lifespans(factor)
    path = runtime_folder() / f"bt-agents-lan-{factor:g}.xml"
    make_private_file(path)
    write_atomically(path, profile.text(), durable=False)
    environment[PROFILE] = str(path)
