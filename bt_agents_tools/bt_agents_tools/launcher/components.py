# SPDX-License-Identifier: Apache-2.0
"""Components of a system: the process of each node, with its parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from bt_agents_core.liveness import SLOW_NETWORK
from bt_agents_tools.launcher.supervisor import Component

HOST = "agents"
"""Name of the host of a system on one machine."""

ONE_PROCESS = "system"
"""Name of the process of all nodes if they share one."""

BEATING = ("marketplace_node.node", "bt_agents.host.node", "bt_agents_robot.robot")
"""Modules of the nodes with heartbeats, which hold leases on each other."""

MANAGED = (
    "marketplace_node.node",
    "bt_agents.host.node",
    "scene_layer.node",
    "feedback_node.node",
)
"""Modules of the nodes that can leave the system and come back on request."""


def nodes_of(processes: Iterable[Component], modules: Collection[str] = ()) -> set[str]:
    """Return the names of the nodes of some processes, of all or those of some modules."""
    return {
        name
        for process in processes
        for name, module in (process.parts or {process.name: process.module}).items()
        if not modules or module in modules
    }


def market(
    trees: Path, on_new_scene: str = "", strategy: str = "", orders: str = "", scenes: str = ""
) -> Component:
    """Return the marketplace; empty arguments keep its own defaults."""
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
    """Return the scene layer, which plays a script if one is given."""
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

    Only its process gets the key of the server, in an environment variable.
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
    name: str = HOST,
) -> Component:
    """Return the host of all agents in a folder; it stops first, while the robot still runs."""
    return Component(
        name=name,
        node=name if name != HOST else "",
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


def robot(voice: str, *, needs_screen: bool = False) -> Component:
    """Return the simulated robot; one that needs a screen appears on the page Person only."""
    return Component(
        name="robot",
        module="bt_agents_robot.robot",
        parameters={"pace": 1.0, "voice": voice, "needs_screen": needs_screen},
    )


def visitors(trees: Path, script: Path) -> Component:
    """Return the scripted visitors; they never restart, because that would repeat the script."""
    return Component(
        name="visitors",
        restarts=False,
        module="bt_agents_robot.visitors",
        parameters={"trees": str(trees), "script": str(script), "pace": 1.0},
    )


def studio(trees: Path, state: Path, journal: Path, listening: int) -> Component:
    """Return the studio, which shows the system in a browser; the system can run without it.

    It serves the socket with the descriptor ``listening``.
    """
    return Component(
        name="studio",
        module="bt_agents_studio.process",
        arguments=(str(trees), str(state), str(journal), str(listening)),
        descriptors=(listening,),
        needed=False,
    )


def fleet(trees: Path, state: Path, ledger: str, pipe: int) -> Component:
    """Return the process that learns with other robots; the system can run without it.

    It is a client, like the command, and writes a line to the descriptor ``pipe`` at each change
    of its state.
    """
    return Component(
        name="fleet",
        module="bt_agents_fleet.process",
        arguments=(str(trees), str(state), ledger, str(pipe)),
        descriptors=(pipe,),
        needed=False,
        keeps_enclave=True,
    )


def on_slow_network(part: Component, factor: float) -> Component:
    """Return a component, with the longer timeouts for a slow network if it waits for others."""
    if part.module not in BEATING:
        return part
    return replace(part, parameters={**part.parameters, SLOW_NETWORK: factor})


def one_process(parts: Sequence[Component]) -> Component:
    """Return the process that runs the nodes of several components together.

    They stop in the given order, except that those that stop first come before the others.
    """
    ordered = sorted(parts, key=lambda part: not part.stops_first)
    return Component(
        name=ONE_PROCESS,
        module="bt_agents_ros.one_process",
        arguments=tuple(part.module for part in ordered),
        parts={part.name: part.module for part in ordered},
        parameters={
            f"{part.name}:{name}": value
            for part in ordered
            for name, value in part.parameters.items()
        },
        stops_first=True,
        keeps_enclave=True,
    )
