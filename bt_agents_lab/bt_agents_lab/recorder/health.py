# SPDX-License-Identifier: Apache-2.0
"""Health of the journal: whether everything is recorded, and can be written."""

from __future__ import annotations

from bt_agents_core.health import Health, PartHealth


def recording_health(*, is_recording: bool, file: str, trouble: str, dropped: int) -> PartHealth:
    """Return the health of the recording.

    Args:
        is_recording: False while it is stopped.
        file: The one that is written, else the last one.
        trouble: Why nothing can be written; empty when it can.
        dropped: Messages that have found no room since the last that did.
    """
    level, message = Health.OK, "everything is recorded"
    if trouble:
        level, message = Health.ERROR, f"{file} cannot be written: {trouble}"
    elif not is_recording:
        message = "the recording is stopped"
    values = {"file": file, "dropped": str(dropped)}
    return PartHealth(part="recording", level=level, message=message, values=values)
