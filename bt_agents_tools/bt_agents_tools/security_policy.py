# SPDX-License-Identifier: Apache-2.0
"""SROS2 policy for a trees folder: the rights of each node and each role of the command line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from xml.etree import ElementTree as Xml

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.field_types import BindingKind
from bt_agents_core.ros_names import is_full_name
from bt_agents_core.text import quote
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.specs import iter_nodes
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.node_type import Resources
from bt_agents_ros.system_topics import (
    ACTIONS,
    HOST,
    NODES,
    SERVICES,
    TOPICS,
    TREE_STREAM_SERVICES,
    TREE_STREAMS,
)

OBSERVER = "_bt_agents_observer"
"""Node name of every command of the command line."""

ROLES = ("watch", "operate", "author")
"""Roles of the command line; each may do what those before it may."""

Rights = dict[str, set[str]]
"""Right as SROS2 names it → names of its topics, services or actions; ``~`` means the node."""

_KINDS = {
    **dict.fromkeys(("publish", "subscribe"), "topic"),
    **dict.fromkeys(("reply", "request"), "service"),
    **dict.fromkeys(("execute", "call"), "action"),
}
_OF_SKILLS = {
    BindingKind.TOPIC: "publish",
    BindingKind.SERVICE: "request",
    BindingKind.ACTION: "call",
}

_EVERY_NODE: Rights = {
    "publish": {"/parameter_events", "/rosout"},
    "reply": {"~/get_type_description"},
}
_PARAMETERS: Rights = {
    "reply": {f"~/{verb}_parameters" for verb in ("describe", "get", "list", "set")}
    | {"~/get_parameter_types", "~/set_parameters_atomically"}
    | {"~/get_logger_levels", "~/set_logger_levels"}
}
_MANAGED: Rights = {
    "reply": {f"~/get_{what}" for what in ("state", "available_states", "transition_graph")}
    | {"~/change_state", "~/get_available_transitions"}
}
_TREE_STREAMS: Rights = {
    "publish": {one.name.replace(HOST, "~") for one in TREE_STREAMS},
    "reply": {one.name.replace(HOST, "~") for one in TREE_STREAM_SERVICES},
}
"""Rights of a host if the tools of py_trees_ros are installed."""


def policy_xml(trees: Trees, hosts: Sequence[str], namespace: str = "/") -> str:
    """Return the policy file that ``ros2 security`` makes the permissions of a keystore from.

    Raises:
        BtAgentsError: A host has a name that ROS refuses, or that of another enclave.
    """
    place = f"/{namespace.strip('/')}".rstrip("/")
    for host in hosts:
        taken = host in (*NODES, *ROLES)
        if taken or "/" in host or not is_full_name(f"{place}/{host}"):
            raise BtAgentsError(
                f"{quote(f'{place}/{host}')} cannot be a host, expected a name that ROS takes and "
                "no other enclave has, such as '/robot1/agents'"
            )
    root = Xml.Element("policy", version="0.2.0")
    enclaves = Xml.SubElement(root, "enclaves")
    for name, rights in rights_of(trees, hosts).items():
        enclave = Xml.SubElement(enclaves, "enclave", path=f"/bt_agents/{name}")
        of_node = {"ns": place or "/", "node": OBSERVER if name in ROLES else name}
        profile = Xml.SubElement(Xml.SubElement(enclave, "profiles"), "profile", of_node)
        for right, names in rights.items():
            if names:
                group = Xml.SubElement(profile, f"{_KINDS[right]}s", {right: "ALLOW"})
                for one in sorted(names):
                    inside = "" if one.startswith("/") else f"{place}/"
                    Xml.SubElement(group, _KINDS[right]).text = inside + one
    Xml.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Xml.tostring(root, encoding="unicode")}\n'


def rights_of(trees: Trees, hosts: Sequence[str]) -> dict[str, Rights]:
    """Return the rights of each node, including ``hosts``, and then of each role."""
    scene, skills = trees.scene, _rights_of_skills(trees)
    sensors = {one.topic for one in (*scene.sources, *filter(None, (scene.person,)))}
    if scene.persons is not None:
        sensors.add(scene.persons.tracked.topic)
    extra: dict[str, Rights] = {
        "marketplace": {  # cancels the goals of a host that is gone
            "subscribe": {f"{one}/_action/status" for one in skills["call"]},
            "request": {f"{one}/_action/cancel_goal" for one in skills["call"]},
        },
        "scene_layer": {"subscribe": sensors},
        HOST: _joined("~", [skills, _TREE_STREAMS]),
        "studio": {"publish": {one.topic[0] for one in _resources(trees) if one.topic}},
        "operate": {"publish": sensors},
    }
    found = {}
    for node in NODES:
        for name in hosts if node == HOST else (node,):
            parts = [_EVERY_NODE, _PARAMETERS, _of_table(node, hosts), extra.get(node, {})]
            if any(one.name == f"{node}/transition_event" for one in TOPICS):
                parts.append(_MANAGED)
            found[name] = _joined(name, parts)
    allowed = [_EVERY_NODE]
    for role in ROLES:
        allowed += [_of_table(role, hosts), extra.get(role, {})]
        found[role] = _joined(OBSERVER, allowed)
    return found


def _of_table(node: str, hosts: Sequence[str]) -> Rights:
    """Return the rights that do not depend on the trees; a host offers only its own names."""

    def own(names: Iterable[str]) -> set[str]:
        return {name.replace(HOST, "~") for name in names}

    def of_all(names: Iterable[str]) -> set[str]:
        return {name.replace(HOST, host) for name in names for host in hosts}

    return {
        "publish": own(one.name for one in TOPICS if node in one.publishers),
        "subscribe": of_all(one.name for one in TOPICS if node in one.listeners),
        "reply": own(one.name for one in SERVICES if node == one.server),
        "request": of_all(one.name for one in SERVICES if node in one.callers),
        "execute": own(one.name for one in ACTIONS if node == one.server),
        "call": of_all(one.name for one in ACTIONS if node in one.callers),
    }


def _rights_of_skills(trees: Trees) -> Rights:
    found: Rights = {right: set() for right in _KINDS}
    for used in _resources(trees):
        if used.topic is not None:
            found["subscribe"].add(used.topic[0])
        if used.binding is not None:
            found[_OF_SKILLS[used.binding.kind]].add(used.binding.name)
            if used.binding.heartbeat is not None:
                found["subscribe"].add(used.binding.heartbeat.topic)
    return found


def _resources(trees: Trees) -> Iterator[Resources]:
    for agent in trees.agents:
        for root in filter(None, (agent.tree, agent.on_cancel)):
            yield from (type_of(spec).resources(spec) for spec in iter_nodes(root))


def _joined(node: str, parts: Sequence[Rights]) -> Rights:
    return {
        right: {one.replace("~", node, 1) for part in parts for one in part.get(right, ())}
        for right in _KINDS
    }
