# SPDX-License-Identifier: Apache-2.0
"""Table of the topics, services and actions that each node and each role may use."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

from bt_agents_core.field_types import BindingKind
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.specs import iter_nodes
from bt_agents_language.nodes.catalogue import type_of

HOST = "{host}"
"""Stands for the name of each host in the names of the table."""


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
        "~/get_parameter_types",
        "~/get_parameters",
        "~/list_parameters",
        "~/set_parameters",
        "~/set_parameters_atomically",
    ),
)

_NODES = (
    Access(
        name="marketplace",
        publishes=("auctions", "calls", "market", "~/heartbeat", "runs", "scene_ends"),
        subscribes=("bids", "marketplace/heartbeat", "open_goals", "scene", "{host}/heartbeat"),
        serves=("~/cancel", "~/operate", "~/preview", "~/register"),
        calls=("feedback/collect", "select"),
        sends_goals=("{host}/run",),
    ),
    Access(
        name="scene_layer",
        publishes=("scene", "scene/live", "scene/persons"),
        subscribes=("market", "marketplace/heartbeat", "runs", "scene_ends", "~/trigger"),
        serves=("~/analyze", "~/manage", "~/remember"),
    ),
    Access(
        name="feedback",
        publishes=("feedback", "mood_traces", "profiles"),
        subscribes=("cards", "runs", "scene/live", "{host}/status"),
        serves=("~/collect", "~/give", "~/manage"),
        calls=("marketplace/cancel", "{host}/set_profile"),
    ),
    Access(
        name=HOST,
        publishes=(
            *("bids", "cards", "~/files", "~/heartbeat", "open_goals", "~/records", "~/status"),
            *("~/trees", "~/tunables", "~/tunings"),
        ),
        subscribes=("calls", "market", "marketplace/heartbeat", "runs", "scene/live"),
        serves=("~/reload", "~/roll_back", "~/set_profile", "~/tune", "~/versions"),
        calls=("feedback/give", "marketplace/register", "scene_layer/remember"),
        executes=("~/run",),
    ),
    Access(
        name="robot",
        publishes=(
            *("robot/heartbeat", "robot/open_questions", "robot/questions", "robot/transcript"),
        ),
        subscribes=("answers", "open_goals", "sound", "{host}/heartbeat"),
        serves=("set_light",),
        executes=("ask", "drive", "say", "show"),
    ),
    Access(name="selector", subscribes=("cards",), serves=("select",)),
    Access(
        name="journal",
        subscribes=(
            *("auctions", "bids", "calls", "cards", "feedback", "market", "mood_traces"),
            *("profiles", "runs", "scene", "scene/live", "scene/persons", "scene_ends"),
            *("{host}/files", "{host}/records", "{host}/status", "{host}/trees"),
            *("{host}/tunables", "{host}/tunings"),
        ),
    ),
    Access(
        name="studio",
        subscribes=(
            *("auctions", "cards", "feedback", "market", "marketplace/heartbeat", "profiles"),
            *("robot/heartbeat", "robot/open_questions", "robot/transcript", "runs", "scene"),
            *("scene/live", "scene_ends", "{host}/files", "{host}/heartbeat", "{host}/status"),
            *("{host}/trees", "{host}/tunables", "{host}/tunings"),
        ),
        calls=(
            *("feedback/give", "feedback/manage", "marketplace/cancel", "marketplace/operate"),
            *("scene_layer/analyze", "{host}/get_parameters", "{host}/tune"),
        ),
    ),
)

_WATCH = Access(
    name="watch",
    subscribes=(
        *("auctions", "cards", "feedback", "market", "marketplace/heartbeat", "mood_traces"),
        *("profiles", "robot/heartbeat", "robot/open_questions", "robot/transcript", "runs"),
        *("scene", "scene/live", "scene/persons", "scene_ends"),
        *("visitors/current", "visitors/done"),
        *("{host}/heartbeat", "{host}/status", "{host}/trees", "{host}/tunables"),
        "{host}/tunings",
    ),
    calls=(
        *("marketplace/describe_parameters", "marketplace/get_parameters"),
        *("{host}/get_parameters", "{host}/versions"),
    ),
)
_OPERATE = Access(
    name="operate",
    publishes=("answers", "scene_layer/trigger"),
    calls=(
        *("feedback/give", "marketplace/cancel", "marketplace/operate", "marketplace/preview"),
        *("marketplace/set_parameters_atomically", "scene_layer/analyze"),
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
        HOST: skills,
    }
    nodes = [
        _joined(node.name, node, _EVERY_NODE, _PARAMETERS, extra.get(node.name, Access(name="")))
        for node in _NODES
    ]
    sensing = Access(name="", publishes=sources)
    roles = [
        _joined("watch", _EVERY_NODE, _WATCH),
        _joined("operate", _EVERY_NODE, _WATCH, _OPERATE, sensing),
        _joined("author", _EVERY_NODE, _WATCH, _OPERATE, sensing, _AUTHOR),
    ]
    return tuple(
        _for_hosts(replace(access, name=access.name.replace(HOST, host)), hosts)
        for access in (*nodes, *roles)
        for host in (hosts if access.name == HOST else ("",))
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
