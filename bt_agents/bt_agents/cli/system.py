# SPDX-License-Identifier: Apache-2.0
"""Which processes make up a system, and where its logs and its ledger lie."""

from __future__ import annotations

import os
import time
from pathlib import Path

from bt_agents.cli.supervisor import Component


def state_folder() -> Path:
    """Return the folder for logs and learned profiles, by the XDG rules."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "bt-agents"


def new_log_folder() -> Path:
    """Return the name of a log folder for this start."""
    return state_folder() / "logs" / f"{time.strftime('%Y-%m-%d-%H%M%S')}-{os.getpid()}"


def market(trees: Path, on_new_scene: str = "") -> Component:
    """Return the marketplace; an empty ``on_new_scene`` leaves it at its own."""
    parameters = {"trees": str(trees)}
    if on_new_scene:
        parameters["on_new_scene"] = on_new_scene
    return Component(name="marketplace", module="marketplace_node.node", parameters=parameters)


def scene_layer(trees: Path, script: Path | None = None, agents: int = 1) -> Component:
    """Return the scene layer, which plays a script when one is given."""
    parameters: dict[str, str | float | bool | int] = {"trees": str(trees)}
    if script is not None:
        parameters |= {"script": str(script), "wait_for_agents": agents}
    return Component(name="scene_layer", module="scene_layer.node", parameters=parameters)


def host(trees: Path, tags: str = "", bindings: str = "", tunings: str = "") -> Component:
    """Return the host of all agents of a folder; it ends first, while the robot still listens."""
    return Component(
        name="agents",
        module="bt_agents.ros.host",
        parameters={"trees": str(trees), "tags": tags, "robot": bindings, "tunings": tunings},
        first=True,
    )


def feedback(trees: Path, ledger: str, simulated: Path | None = None) -> Component:
    """Return the feedback node."""
    parameters: dict[str, str | float | bool | int] = {"trees": str(trees), "ledger": ledger}
    if simulated is not None:
        parameters["simulated_feedback"] = str(simulated)
    return Component(name="feedback", module="feedback_node.node", parameters=parameters)


def robot(pace: float, voice: str) -> Component:
    """Return the simulated robot."""
    return Component(
        name="robot",
        module="bt_agents_robot.robot",
        parameters={"pace": pace, "voice": voice},
    )


def visitors(trees: Path, script: Path, pace: float) -> Component:
    """Return the scripted visitors, who would begin anew."""
    return Component(
        name="visitors",
        lasting=False,
        module="bt_agents_robot.visitors",
        parameters={
            "trees": str(trees),
            "script": str(script),
            "pace": pace,
        },
    )
