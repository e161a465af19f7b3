# SPDX-License-Identifier: Apache-2.0
"""Every test has a private ROS domain on this machine only; child processes inherit it."""

from __future__ import annotations

import os

from bt_agents_tools.launcher.domain_lock import reserve_domain
from bt_agents_tools.launcher.supervisor import set_local_discovery

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
set_local_discovery(os.environ)
