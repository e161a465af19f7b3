# SPDX-License-Identifier: Apache-2.0
"""Process of the studio within a system: TREES STATE JOURNAL SOCKET."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
from collections.abc import Mapping
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.state_folder import STUDIO_ADDRESSES
from bt_agents_core.text import printable
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros.spinner import die_with_parent, report_ready
from bt_agents_studio.access import SessionRole
from bt_agents_studio.access_file import AccessFile
from bt_agents_studio.service import Address, serve


def main() -> int:
    """Serve the studio until a signal ends it; return the exit code."""
    die_with_parent()
    trees, state, journal = map(Path, sys.argv[1:4])
    # The parent listens, so the port survives a restart, and no connection is refused.
    listening = socket.socket(fileno=int(sys.argv[4]))

    def ready(addresses: Mapping[SessionRole, str]) -> None:
        AccessFile(state / STUDIO_ADDRESSES).write(json.dumps(addresses))
        report_ready()

    try:
        space = read_scene(trees / "scene.yaml").space
        address = Address(listening=listening)
        asyncio.run(serve(address, space=space, journal=journal, kept=state, ready=ready))
    except BtAgentsError as error:
        print(f"error: {printable(str(error))}", file=sys.stderr)
        return 1
    return 0
