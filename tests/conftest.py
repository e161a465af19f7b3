# SPDX-License-Identifier: Apache-2.0
"""What holds for all tests: the same examples, a private ROS domain, and who runs what."""

from __future__ import annotations

import os
from typing import Any

import pytest
from hypothesis import settings

from bt_agents_tools.launcher.domain_lock import reserve_domain
from bt_agents_tools.launcher.supervisor import set_local_discovery

# The same examples in each run, and no deadline: whether a law holds is no matter of the machine.
settings.load_profile("ci")

# Child processes inherit the domain.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
set_local_discovery(os.environ)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Have one worker run all tests of packaging, which share a build; the largest group is first.

    The mark ``xdist_group`` would say so too, but does nothing from pytest 9.2 on.
    """
    if config.getvalue("dist") != "load":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class PackagingTogether(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            together = "tests/packaging/"
            return together if nodeid.startswith(together) else nodeid

    return PackagingTogether(config, log)
