# SPDX-License-Identifier: Apache-2.0
"""Table of the topics, services and actions that each node and each role may use."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

from bt_agents_core.field_types import BindingKind
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.specs import iter_nodes
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_ros.system_topics import HOST, heard_by, published_by


@dataclass(frozen=True, kw_only=True)
class Access:
    """Rights of one node, or of one role of the command line.

    Names are those of the code: relative, and with ``~`` for the node's own.
    """

    name: str
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()
    executes: tuple[str, ...] = ()
    sends_goals: tuple[str, ...] = ()


_EVERY_NODE = Access(
    name="", publishes=("/parameter_events", "/rosout"), serves=("~/get_type_description",)
)
_PARAMETERS = Access(
    name="",
    serves=(
        "~/describe_parameters",
        "~/get_logger_levels",
        "~/get_parameter_types",
        "~/get_parameters",
        "~/list_parameters",
        "~/set_logger_levels",
        "~/set_parameters",
        "~/set_parameters_atomically",
    ),
)

_MANAGED = Access(
    name="",
    serves=(
        *("~/change_state", "~/get_available_states", "~/get_available_transitions"),
        *("~/get_state", "~/get_transition_graph"),
    ),
)
"""What the services of a life cycle need."""

_TREE_STREAMS = Access(
    name="",
    publishes=("~/blackboard_streams/*", "~/snapshot_streams/*", "~/snapshots"),
    serves=(
        *("~/blackboard_streams/close", "~/blackboard_streams/get_variables"),
        *("~/blackboard_streams/open", "~/snapshot_streams/close"),
        *("~/snapshot_streams/open", "~/snapshot_streams/reconfigure"),
    ),
)
"""What a host has besides where the tools of py_trees_ros are installed."""

_NODES = (
    Access(
        name="marketplace",
        serves=("~/cancel", "~/operate", "~/preview", "~/register"),
        calls=("bt_agents/select", "feedback/collect"),
        sends_goals=("{host}/run",),
    ),
    Access(name="scene_layer", serves=("~/analyze", "~/manage", "~/remember")),
    Access(
        name="feedback",
        serves=("~/collect", "~/give", "~/manage"),
        calls=("marketplace/cancel", "{host}/set_profile"),
    ),
    Access(
        name=HOST,
        serves=(
            *("~/control", "~/reload", "~/roll_back", "~/set_profile", "~/tune", "~/versions"),
        ),
        calls=("feedback/give", "marketplace/register", "scene_layer/remember"),
        executes=("~/run",),
    ),
    Access(name="robot", serves=("set_light",), executes=("ask", "drive", "say", "show")),
    Access(name="selector", serves=("bt_agents/select",)),
    Access(name="journal", serves=("~/record",)),
    Access(
        name="studio",
        calls=(
            *("feedback/give", "feedback/manage", "journal/record", "marketplace/cancel"),
            *("marketplace/operate", "marketplace/preview", "scene_layer/analyze"),
            *("{host}/control", "{host}/get_parameters", "{host}/tune"),
        ),
    ),
)

_WATCH = Access(
    name="watch",
    calls=(
        *("marketplace/describe_parameters", "marketplace/get_parameters"),
        *("{host}/get_parameters", "{host}/versions"),
    ),
)
_OPERATE = Access(
    name="operate",
    calls=(
        *("feedback/give", "journal/record", "marketplace/cancel", "marketplace/operate"),
        *("marketplace/preview", "marketplace/set_parameters_atomically", "scene_layer/analyze"),
        "{host}/control",
    ),
)
_AUTHOR = Access(
    name="author",
    calls=(
        *("feedback/manage", "scene_layer/manage"),
        *("{host}/reload", "{host}/roll_back", "{host}/tune"),
    ),
)

ROLES = ("watch", "operate", "author")
"""Roles of the command line; each may do what those before it may."""


def access_table(trees: Trees, hosts: Sequence[str] = ("agents",)) -> tuple[Access, ...]:
    """Return the rights of all nodes, and then those of the roles, for a trees folder.

    Args:
        trees: Names the sensors that the scene layer hears, and what the skills use.
        hosts: Names of the hosts of its agents.
    """
    sources = _source_topics(trees)
    skills = _skill_access(trees)
    extra = {
        "marketplace": _takeover_access(skills.sends_goals),
        "scene_layer": Access(name="", subscribes=sources),
        HOST: _joined("", skills, _TREE_STREAMS),
        "studio": Access(name="", publishes=_awaited_topics(trees)),
    }
    nodes = [
        _joined(
            node.name,
            *(node, _topics(node.name), _EVERY_NODE, _PARAMETERS),
            *((_MANAGED,) if _is_managed(node.name) else ()),
            extra.get(node.name, Access(name="")),
        )
        for node in _NODES
    ]
    watching = (_EVERY_NODE, _WATCH, _topics("watch"))
    operating = (*watching, _OPERATE, _topics("operate"), Access(name="", publishes=sources))
    roles = [
        _joined("watch", *watching),
        _joined("operate", *operating),
        _joined("author", *operating, _AUTHOR),
    ]
    return tuple(
        _for_hosts(replace(access, name=access.name.replace(HOST, host)), hosts)
        for access in (*nodes, *roles)
        for host in (hosts if access.name == HOST else ("",))
    )


def _is_managed(name: str) -> bool:
    return any(topic.name.endswith("/transition_event") for topic in published_by(name))


def _topics(name: str) -> Access:
    """Return what a node or a role publishes and hears whatever the trees are."""
    return Access(
        name="",
        # A host publishes only below its own name, and may hear all others.
        publishes=tuple(
            topic.name.replace(HOST, "~") if name == HOST else topic.name
            for topic in published_by(name)
        ),
        subscribes=tuple(topic.name for topic in heard_by(name)),
    )


def _takeover_access(actions: Iterable[str]) -> Access:
    """Return what cancels goals of hosts that are gone."""
    return Access(
        name="",
        subscribes=tuple(f"{action}/_action/status" for action in actions),
        calls=tuple(f"{action}/_action/cancel_goal" for action in actions),
    )


def _joined(name: str, *parts: Access) -> Access:
    kinds = [one.name for one in fields(Access) if one.name != "name"]
    return Access(
        name=name,
        **{
            kind: tuple(sorted({entry for part in parts for entry in getattr(part, kind)}))
            for kind in kinds
        },
    )


def _for_hosts(access: Access, hosts: Sequence[str]) -> Access:
    def named(entries: Iterable[str]) -> tuple[str, ...]:
        return tuple(
            dict.fromkeys(entry.replace(HOST, host) for entry in entries for host in hosts)
        )

    kinds = [one.name for one in fields(Access) if one.name != "name"]
    return Access(name=access.name, **{kind: named(getattr(access, kind)) for kind in kinds})


def _source_topics(trees: Trees) -> tuple[str, ...]:
    scene = trees.scene
    found = [*scene.sources, *filter(None, (scene.person,))]
    topics = {source.topic for source in found}
    if scene.persons is not None:
        topics.add(scene.persons.tracked.topic)
    return tuple(sorted(topics))


def _awaited_topics(trees: Trees) -> tuple[str, ...]:
    """Return the topics that trees wait for, which people may publish."""
    roots = (root for agent in trees.agents for root in (agent.tree, agent.on_cancel))
    resources = (
        type_of(spec).resources(spec) for root in filter(None, roots) for spec in iter_nodes(root)
    )
    return tuple(sorted({one.topic[0] for one in resources if one.topic is not None}))


def _skill_access(trees: Trees) -> Access:
    """Return what the trees of all agents use by their skills and nodes."""
    used: dict[BindingKind, set[str]] = {kind: set() for kind in BindingKind}
    heard: set[str] = set()
    for agent in trees.agents:
        for root in filter(None, (agent.tree, agent.on_cancel)):
            for spec in iter_nodes(root):
                resources = type_of(spec).resources(spec)
                if resources.binding is not None:
                    used[resources.binding.kind].add(resources.binding.name)
                    if resources.binding.heartbeat is not None:
                        heard.add(resources.binding.heartbeat.topic)
                if resources.topic is not None:
                    heard.add(resources.topic[0])
    return Access(
        name="",
        publishes=tuple(used[BindingKind.TOPIC]),
        subscribes=tuple(heard),
        calls=tuple(used[BindingKind.SERVICE]),
        sends_goals=tuple(used[BindingKind.ACTION]),
    )
