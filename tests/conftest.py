# SPDX-License-Identifier: Apache-2.0
"""Settings of all tests: the same examples, a private ROS domain, no silent skip in CI."""

from __future__ import annotations

import gc
import os
from typing import Any

import pytest
from hypothesis import settings

from bt_agents_tools.launcher.domain_lock import reserve_domain, runtime_folder
from bt_agents_tools.launcher.supervisor import set_discovery
from skipped_tests import judge

# The same examples in each run, and no deadline: laws do not depend on the speed of the machine.
settings.load_profile("ci")

# Child processes inherit the domain, and the folder of its lock: with their own state folder
# they would find another lock, and take a domain that a test has reserved.
os.environ["XDG_RUNTIME_DIR"] = str(runtime_folder())
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
set_discovery(os.environ)
if "HOME" not in os.environ:  # contains the logs of rclpy
    os.environ.setdefault("ROS_LOG_DIR", os.path.join(os.environ["XDG_RUNTIME_DIR"], "log"))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Separate tests of processes from tests that compute."""
    if config.getvalue("dist") != "load":
        return None
    from scheduling import Scheduling

    return Scheduling(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Any:
    report = yield
    judge(report)
    return report


pytest_make_collect_report = pytest_runtest_makereport


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Any:
    """Exempt permanent objects from garbage collection: the tests and their imports."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()
