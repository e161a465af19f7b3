# SPDX-License-Identifier: Apache-2.0
"""Components of a system: the process of each node, with its parameters."""

from __future__ import annotations

from pathlib import Path

from bt_agents_tools.launcher.supervisor import Component


def market(
    trees: Path, on_new_scene: str = "", strategy: str = "", orders: str = "", scenes: str = ""
) -> Component:
    """Return the marketplace; empty arguments leave its own defaults."""
    overrides = {
        "on_new_scene": on_new_scene,
        "strategy": strategy,
        "orders": orders,
        "scenes": scenes,
    }
    parameters = {"trees": str(trees)} | {name: text for name, text in overrides.items() if text}
    return Component(name="marketplace", module="marketplace_node.node", parameters=parameters)


def scene_layer(
    trees: Path, script: Path | None = None, agents: int = 1, memory: str = ""
) -> Component:
    """Return the scene layer, which plays a script when one is given."""
    parameters: dict[str, str | float | bool | int] = {"trees": str(trees)}
    if memory:
        parameters["memory"] = memory
    if script is not None:
        parameters |= {"script": str(script), "wait_for_agents": agents}
    return Component(name="scene_layer", module="scene_layer.node", parameters=parameters)


def selector(
    trees: Path, base_url: str, model: str, key_variable: str = "", key: str = ""
) -> Component:
    """Return the selector, which asks a language model how to rank bids.

    It alone gets the key of the server, in the variable of its environment.
    """
    return Component(
        name="selector",
        module="marketplace_node.node.selector",
        parameters={
            "trees": str(trees),
            "base_url": base_url,
            "model": model,
            "key_variable": key_variable,
        },
        environment={key_variable: key} if key else {},
    )


def host(
    trees: Path,
    tags: str = "",
    bindings: str = "",
    tunings: str = "",
    language: str = "",
    open_goals: str = "",
) -> Component:
    """Return the host of all agents of a folder; it stops first, while the robot still runs."""
    return Component(
        name="agents",
        module="bt_agents.host.node",
        parameters={
            "trees": str(trees),
            "tags": tags,
            "robot": bindings,
            "language": language,
            "tunings": tunings,
            "open_goals": open_goals,
        },
        stops_first=True,
    )


def feedback(trees: Path, ledger: str, simulated: Path | None = None) -> Component:
    """Return the feedback node."""
    parameters: dict[str, str | float | bool | int] = {"trees": str(trees), "ledger": ledger}
    if simulated is not None:
        parameters["simulated_feedback"] = str(simulated)
    return Component(name="feedback", module="feedback_node.node", parameters=parameters)


def journal(folder: Path) -> Component:
    """Return the journal, which records all messages."""
    return Component(
        name="journal", module="bt_agents_lab.node", parameters={"folder": str(folder)}
    )


def robot(pace: float, voice: str) -> Component:
    """Return the simulated robot."""
    return Component(
        name="robot", module="bt_agents_robot.robot", parameters={"pace": pace, "voice": voice}
    )


def visitors(trees: Path, script: Path, pace: float) -> Component:
    """Return the scripted visitors; a restart would begin the script anew, so there is none."""
    return Component(
        name="visitors",
        restarts=False,
        module="bt_agents_robot.visitors",
        parameters={"trees": str(trees), "script": str(script), "pace": pace},
    )
