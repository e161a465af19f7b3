# SPDX-License-Identifier: Apache-2.0
"""Settings of a robot that has joined a fleet: a private file in its state folder."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import Refused
from bt_agents_core.private_files import make_private_file, make_private_folder
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.state_folder import FLEET_SETTINGS
from feedback_node.learning.fleet_steps import ROBOT_NAME

STATUS_FILE = "fleet-status.json"
"""File of a state folder with the progress of the robot, as last written by its process."""

_LONGEST = 20_000


@dataclass(frozen=True, kw_only=True)
class FleetSettings:
    """Identity of this robot and its fleet.

    Attributes:
        address: Address of the database, from :func:`database.checked_address`.
    """

    robot: str
    address: str


def checked_robot(name: str) -> str:
    """Return the name of a robot.

    Raises:
        Refused: ``BAD_ROBOT``.
    """
    if not ROBOT_NAME.fullmatch(name):
        raise Refused(
            RefusalCode.BAD_ROBOT,
            f"the robot '{name[:80]}': expected 1 to 63 small letters, digits, '-' and '_', for "
            "example --robot robot-07",
        )
    return name


def write_settings(folder: Path, settings: FleetSettings) -> Path:
    """Write the settings into a state folder; return the file.

    Raises:
        OSError: It cannot be written.
    """
    make_private_folder(folder)
    file = folder / FLEET_SETTINGS
    write_private(file, json.dumps(asdict(settings), indent=2) + "\n")
    return file


def write_private(file: Path, text: str, *, durable: bool = True) -> None:
    """Replace the text of a private file.

    Raises:
        OSError: It cannot be written.
    """
    make_private_file(file)
    write_atomically(file, text, durable=durable)


def read_settings(folder: Path) -> FleetSettings:
    """Return the settings in a state folder.

    Raises:
        Refused: ``NOT_JOINED``, ``BAD_SETTINGS`` or ``BAD_ROBOT``.
    """
    file = folder / FLEET_SETTINGS
    try:
        with file.open(encoding="utf-8") as opened:
            found = json.loads(opened.read(_LONGEST))
        settings = FleetSettings(**found)
        if not all(isinstance(value, str) for value in vars(settings).values()):
            raise TypeError("expected texts")
    except FileNotFoundError:
        raise Refused(
            RefusalCode.NOT_JOINED,
            "this robot is in no fleet; 'bt-agents fleet join ADDRESS' joins one",
        ) from None
    except (OSError, ValueError, TypeError) as error:
        raise Refused(
            RefusalCode.BAD_SETTINGS, f"{file}: {error}; 'bt-agents fleet join' writes it anew"
        ) from None
    checked_robot(settings.robot)
    return settings


def read_status(folder: Path) -> dict[str, Any]:
    """Return the last status that the robot's process wrote; empty if there is none."""
    try:
        with (folder / STATUS_FILE).open(encoding="utf-8") as opened:
            found = json.loads(opened.read(1_000_000))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
