# SPDX-License-Identifier: Apache-2.0
"""Health of the feedback node: a ledger that cannot write, profiles that no host has."""

from __future__ import annotations

from bt_agents_core.health import Health
from feedback_node.health import ledger_health, profiles_health


def test_failed_ledger_write_is_an_error_with_reason():
    assert ledger_health("l.sqlite", "").level is Health.OK
    health = ledger_health("l.sqlite", "the disk takes no more")
    assert (health.level, health.message) == (
        Health.ERROR,
        "nothing is learned: the disk takes no more",
    )


def test_undelivered_profiles_are_a_warning_naming_agents():
    assert profiles_health(2, ()).level is Health.OK
    health = profiles_health(2, ["guide"])
    assert health.level is Health.WARN
    assert health.message == "their hosts bid with other profiles: guide"
