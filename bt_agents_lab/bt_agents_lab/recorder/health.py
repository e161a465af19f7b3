# SPDX-License-Identifier: Apache-2.0
"""Health of the journal: whether it records everything and can write."""

from __future__ import annotations

from bt_agents_core.health import Health, PartHealth


def recording_health(*, is_recording: bool, file: str, trouble: str, dropped: int) -> PartHealth:
    """Return the health of the recording.

    Args:
        is_recording: False while it is stopped.
        file: Current file, else the last one.
        trouble: Why writing fails; empty if it works.
        dropped: Messages dropped since the last one that was stored.
    """
    level, message = Health.OK, "everything is recorded"
    if trouble:
        level, message = Health.ERROR, f"{file} cannot be written: {trouble}"
    elif not is_recording:
        message = "the recording is stopped"
    values = {"file": file, "dropped": str(dropped)}
    return PartHealth(part="recording", level=level, message=message, values=values)
