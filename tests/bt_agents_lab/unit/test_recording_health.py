# SPDX-License-Identifier: Apache-2.0
"""Health of the journal: stopped, or unable to write."""

from __future__ import annotations

from bt_agents_core.health import Health
from bt_agents_lab.recorder.health import recording_health


def test_failed_recording_is_error_but_stopped_is_ok():
    full = recording_health(is_recording=True, file="j.mcap", trouble="disk full", dropped=7)
    assert (full.level, full.message) == (Health.ERROR, "j.mcap cannot be written: disk full")
    assert full.values["dropped"] == "7"
    stopped = recording_health(is_recording=False, file="j.mcap", trouble="", dropped=0)
    assert (stopped.level, stopped.message) == (Health.OK, "the recording is stopped")
