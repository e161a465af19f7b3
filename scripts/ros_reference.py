# SPDX-License-Identifier: Apache-2.0
"""Page of every topic, service, action and parameter, from the tables and nodes of the code."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from markdown_table import markdown_table

from bt_agents_ros.system_topics import (
    ACTIONS,
    HOST,
    SERVICES,
    TOPICS,
    TREE_STREAM_SERVICES,
    TREE_STREAMS,
    SystemTopic,
)

ROOT = Path(__file__).parents[1]

HANG_S = 60.0
"""Longest wait for the host's action [s]."""

_OF_ROS = (
    "change_state",
    "describe_parameters",
    "get_available_states",
    "get_available_transitions",
    "get_logger_levels",
    "get_parameter_types",
    "get_parameters",
    "get_state",
    "get_transition_graph",
    "get_type_description",
    "list_parameters",
    "set_logger_levels",
    "set_parameters",
    "set_parameters_atomically",
)
"""Last parts of the names of services that every node, or every managed node, of ROS has."""

_HEAD = """\
<!-- Made by scripts/generate from the code; do not edit. -->
# ROS reference

This page lists every topic, service, action and parameter of the system. All names except
`/diagnostics` are relative: nodes can run in a namespace, and topics and services can be remapped
as usual. `<host>` is the name of a host, `agents` by default. The comments in each file of
`bt_agents_interfaces` describe its fields, with their units. `ros2 interface show` prints them;
the site of the documentation has them all on one page. [The ROS graph](ros.md) describes the order
of events. The files of a trees folder name the sensors, and the topics, services and actions that
skills use, so those are not listed here."""

_ROLES = """\
`watch`, `operate` and `author` are the roles of the command line. Each role may do everything
that the roles before it may do: [who may do what](security.md). Some nodes subscribe to a topic
only while they need it."""

_TOOLS = """\
A host offers these if `py_trees_ros_interfaces` is installed: [the tools of
py_trees_ros](py_trees_ros.md#the-tools-of-py_trees_ros)."""

_PARAMETERS = """\
The nodes give these descriptions; `ros2 param describe /marketplace bid_deadline` prints
the same. [The ROS graph](ros.md#parameters) shows how to set parameters. Those that take effect at
the start cannot be set later. A host also has the [tunables](tuning.md) of its agents, as
`<agent>.<name>`. Every node of ROS 2 has `use_sim_time` and `start_type_description_service`."""


def ros_reference() -> str:
    """Return the page; the nodes are made in this process, in a domain of their own."""
    with TemporaryDirectory() as folder:
        given = _given(Path(folder))
        with _made_nodes(given) as nodes:
            return _page(nodes, given)


def _given(folder: Path) -> Mapping[str, object]:
    """Return the parameters that the nodes require; by default they are empty."""
    return {
        "trees": ROOT / "trees",
        "market": "none",  # a host offers its action at once
        "ledger": "':memory:'",
        "folder": folder,
        "base_url": "http://127.0.0.1:9/v1",
        "model": "none",
    }


@contextmanager
def _made_nodes(given: Mapping[str, object]) -> Iterator[Mapping[str, Any]]:
    """Make each node as its process does, by name; :data:`HOST` stands for a host."""
    import rclpy

    from bt_agents.host.node import make_node as make_host
    from bt_agents_lab.node import make_node as make_journal
    from bt_agents_robot.robot import RobotNode
    from bt_agents_ros.spinner import Spinner
    from bt_agents_tools.launcher.domain_lock import reserve_domain
    from feedback_node.node import make_node as make_feedback
    from marketplace_node.node import make_node as make_market
    from marketplace_node.node.selector import make_node as make_selector
    from scene_layer.node import make_node as make_scene_layer

    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    rclpy.init(args=["--ros-args", *words], domain_id=reserve_domain())
    try:
        with ExitStack() as owned:
            made = {}
            for name, make in (
                ("marketplace", make_market),
                ("selector", make_selector),
                ("scene_layer", make_scene_layer),
                (HOST, make_host),
                ("feedback", make_feedback),
                ("journal", make_journal),
                ("robot", RobotNode),
            ):
                spinner = Spinner(make())
                owned.callback(spinner.close)
                (made[name],) = spinner.nodes
                if name == HOST and not spinner.spin_until(
                    lambda: bool(_actions_of(made[HOST])), HANG_S
                ):
                    raise TimeoutError("the host does not offer its action")
            yield made
    finally:
        rclpy.try_shutdown()


def _page(nodes: Mapping[str, Any], given: Collection[str]) -> str:
    parts = [
        _HEAD,
        "## Topics",
        _ROLES,
        markdown_table(("topic", "type", "QoS", "publishers", "subscribers"), _topics(TOPICS)),
        "## Services",
        "QoS: reliable, volatile, the last 1000.",
        markdown_table(("service", "type", "served by", "called by"), _services(nodes)),
        "## For the tools of py_trees_ros",
        _TOOLS,
        markdown_table(
            ("topic", "type", "QoS", "publishers", "subscribers"), _topics(TREE_STREAMS)
        ),
        markdown_table(
            ("service", "type"),
            ((_code(one.name), _code(one.type)) for one in TREE_STREAM_SERVICES),
        ),
        "## Actions",
        markdown_table(("action", "type", "served by", "goals from"), _actions(nodes)),
        "## Parameters",
        _PARAMETERS,
    ]
    for name, node in nodes.items():
        if rows := [*_parameters(node, given)]:
            head = ("parameter", "default", "allowed", "takes effect", "description")
            parts += [f"### {_shown(name)}", markdown_table(head, rows)]
    return "\n\n".join(parts) + "\n"


def _topics(topics: Iterable[SystemTopic]) -> Iterator[tuple[str, ...]]:
    from bt_agents_ros import qos

    for topic in topics:
        profile = qos.PROFILES[topic.profile]
        words = (profile.reliability, profile.durability)
        held = [word.name.lower().replace("_", " ") for word in words]
        yield (
            _code(topic.name),
            _code(topic.type),
            f"{', '.join(held)}, the last {profile.depth}",
            _codes(topic.publishers) or "other programs",
            _codes(topic.listeners) or "other programs",
        )


def _services(nodes: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    callers = {one.name: one.callers for one in SERVICES}
    of_tools = {one.name for one in TREE_STREAM_SERVICES}
    for name, node in nodes.items():
        served = node.get_service_names_and_types_by_node(node.get_name(), node.get_namespace())
        for path, kinds in sorted(served):
            service = _relative(path, node, name)
            last = service.rpartition("/")[2]
            if last not in _OF_ROS and "/_action/" not in path and service not in of_tools:
                yield _code(service), _code(kinds[0]), _code(name), _callers(callers[service])


def _actions(nodes: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    callers = {one.name: one.callers for one in ACTIONS}
    for name, node in nodes.items():
        for path, kinds in sorted(_actions_of(node)):
            action = _relative(path, node, name)
            yield _code(action), _code(kinds[0]), _code(name), _callers(callers[action])


def _actions_of(node: Any) -> Any:
    """Return names and types of a node's actions."""
    from rclpy.action.graph import get_action_server_names_and_types_by_node

    return get_action_server_names_and_types_by_node(node, node.get_name(), node.get_namespace())


def _callers(names: Collection[str]) -> str:
    return _codes(names) or "agents, through their skills"


def _relative(path: str, node: Any, name: str) -> str:
    own = f"/{node.get_name()}/"
    return f"{name}/{path.removeprefix(own)}" if path.startswith(own) else path.removeprefix("/")


def _parameters(node: Any, given: Collection[str]) -> Iterator[tuple[str, ...]]:
    for name in sorted(_own_names(node)):
        descriptor = node.describe_parameter(name)
        default = "" if name in given else node.get_parameter(name).value
        yield (
            _code(name),
            "" if default == "" else _code(json.dumps(default)),
            _allowed(descriptor),
            "at the start" if descriptor.read_only else "at once",
            descriptor.description,
        )


def _own_names(node: Any) -> list[str]:
    of_ros = ("start_type_description_service", "use_sim_time")
    return [name for name in node._parameters if "." not in name and name not in of_ros]


def _allowed(descriptor: Any) -> str:
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    shown = [f"{one.from_value:g} to {one.to_value:g}" for one in ranges]
    return ", ".join(shown) or str(descriptor.additional_constraints)


def _shown(name: str) -> str:
    return name.replace(HOST, "<host>")


def _code(text: str) -> str:
    return f"`{_shown(text)}`"


def _codes(names: Iterable[str]) -> str:
    return ", ".join(_code(name) for name in sorted(names))
