# SPDX-License-Identifier: Apache-2.0
"""Topics, services and actions of the system: the only table of their types and users.

Names that are not below a node's own name are below :data:`PREFIX`, so that they do not clash with
other names on a robot, such as ``scene`` or ``feedback``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

HOST = "{host}"
"""Placeholder for the name of each host in names of topics and nodes."""

NODES = ("marketplace", "scene_layer", "feedback", HOST, "robot", "selector", "journal", "studio")
"""Names of the nodes of the system."""

PREFIX = "bt_agents/"
"""Prefix of the names of topics and services that do not belong to a single node."""

_OWN_PACKAGE = "bt_agents_interfaces"


@dataclass(frozen=True, kw_only=True, slots=True)
class _SystemName:
    """A name on the graph.

    Attributes:
        name: Relative name, except for topics that ROS itself names.
        type: Type, such as ``package/msg/Name``.
    """

    name: str
    type: str

    def is_called(self, name: str) -> bool:
        """Return whether a name, perhaps of a host, is this one; a leading slash is ignored."""
        name = name.removeprefix("/")
        host, slash, rest = self.name.partition("/")
        if host != HOST:
            return name == self.name.removeprefix("/")
        return name.endswith(slash + rest) and name != slash + rest


_Named = TypeVar("_Named", bound=_SystemName)


@dataclass(frozen=True, kw_only=True, slots=True)
class SystemTopic(_SystemName):
    """A topic that nodes of the system publish or listen to, whatever the trees are.

    Attributes:
        profile: Name of the QoS profile of its publishers in :mod:`bt_agents_ros.qos`.
        publishers: Names of nodes, and of roles of the command line.
        listeners: The same, including nodes that listen only while they act.
    """

    profile: str
    publishers: frozenset[str]
    listeners: frozenset[str]


def _full_type(kind: str, folder: str) -> str:
    package, _, name = kind.rpartition("/")
    return f"{package or _OWN_PACKAGE}/{folder}/{name}"


def _topic(name: str, kind: str, profile: str, publishers: str, listeners: str) -> SystemTopic:
    return SystemTopic(
        name=name,
        type=_full_type(kind, "msg"),
        profile=profile,
        publishers=frozenset(publishers.split()),
        listeners=frozenset(listeners.split()),
    )


_TEXT, _YES, _BEAT = "std_msgs/String", "std_msgs/Bool", "std_msgs/Empty"
_STATE = "lifecycle_msgs/TransitionEvent"
_SHOWN = "journal studio watch"

TOPICS = (
    _topic(
        *("/diagnostics", "diagnostic_msgs/DiagnosticArray", "EVENTS"),
        f"{HOST} feedback journal marketplace operate scene_layer",
        "journal studio watch",
    ),
    _topic("answers", _TEXT, "EVENTS", "operate studio visitors", "robot"),
    _topic("bt_agents/auctions", "Auction", "HISTORY", "marketplace", _SHOWN),
    _topic("bt_agents/bids", "Bids", "EVENTS", HOST, "journal marketplace"),
    _topic("bt_agents/bookmarks", "Bookmark", "FACTS", "journal", "studio watch"),
    _topic("bt_agents/calls", "CallForBids", "EVENTS", "marketplace", f"{HOST} journal"),
    _topic("bt_agents/cards", "HostCard", "FACT", HOST, f"feedback selector {_SHOWN}"),
    _topic("bt_agents/feedback", "Feedback", "HISTORY", "feedback", _SHOWN),
    _topic(
        *("bt_agents/market", "MarketStatus", "FACT", "marketplace"),
        f"{HOST} robot scene_layer visitors {_SHOWN}",
    ),
    _topic("bt_agents/mood_traces", "MoodTrace", "HISTORY", "feedback", "journal watch"),
    _topic("bt_agents/open_goals", "OpenGoals", "FACT", HOST, "marketplace robot"),
    _topic("bt_agents/profiles", "Profiles", "FACT", "feedback", _SHOWN),
    _topic(
        "bt_agents/runs",
        "Run",
        "HISTORY",
        "marketplace",
        f"{HOST} feedback scene_layer visitors {_SHOWN}",
    ),
    _topic("bt_agents/scene", "Scene", "FACT", "scene_layer", f"marketplace visitors {_SHOWN}"),
    _topic(
        "bt_agents/scene/live",
        "Scene",
        "SENSOR",
        "scene_layer",
        f"{HOST} feedback visitors {_SHOWN}",
    ),
    _topic("bt_agents/scene/persons", "Persons", "FACT", "scene_layer", "journal watch"),
    _topic("bt_agents/scene_ends", "SceneEnd", "FACTS", "marketplace", f"scene_layer {_SHOWN}"),
    _topic("feedback/transition_event", _STATE, "EVENTS", "feedback", "watch"),
    _topic("journal/status", "RecordingStatus", "FACT", "journal", "studio watch"),
    _topic(
        *("marketplace/heartbeat", "MarketHeartbeat", "EVENTS", "marketplace"),
        f"{HOST} marketplace scene_layer studio watch",
    ),
    _topic("marketplace/transition_event", _STATE, "EVENTS", "marketplace", "watch"),
    _topic("robot/heartbeat", _BEAT, "SENSOR", "robot", "studio watch"),
    _topic("robot/open_questions", "OpenQuestions", "FACT", "robot", "studio watch"),
    _topic("robot/questions", _TEXT, "EVENTS", "robot", "visitors"),
    _topic("robot/state", "RobotState", "FACT", "robot", "studio"),
    _topic("robot/transcript", _TEXT, "HISTORY", "robot", "studio visitors watch"),
    _topic("scene_layer/trigger", _BEAT, "EVENTS", "operate visitors", "scene_layer"),
    _topic("scene_layer/transition_event", _STATE, "EVENTS", "scene_layer", "watch"),
    _topic("sound", _TEXT, "EVENTS", "", "robot"),
    _topic("studio/person/heartbeat", _BEAT, "SENSOR", "studio", "robot"),
    _topic("visitors/current", _TEXT, "FACT", "visitors", "watch"),
    _topic("visitors/done", _YES, "FACT", "visitors", "watch"),
    _topic("visitors/remarks", _TEXT, "FACTS", "visitors", "watch"),
    _topic(f"{HOST}/details", "NodeDetails", "EVENTS", HOST, "studio watch"),
    _topic(f"{HOST}/files", "AgentFiles", "FACT", HOST, "journal studio"),
    _topic(f"{HOST}/heartbeat", "Heartbeat", "EVENTS", HOST, "marketplace robot studio watch"),
    _topic(f"{HOST}/run_control", "RunControl", "FACT", HOST, _SHOWN),
    _topic(f"{HOST}/status", "TreeStatus", "EVENTS", HOST, f"feedback {_SHOWN}"),
    _topic(f"{HOST}/transition_event", _STATE, "EVENTS", HOST, "watch"),
    _topic(f"{HOST}/trees", "Trees", "FACT", HOST, _SHOWN),
    _topic(f"{HOST}/tunables", "Tunables", "FACT", HOST, _SHOWN),
    _topic(f"{HOST}/tunings", "Tunings", "FACT", HOST, _SHOWN),
)
"""All topics of the system; sensors and the topics of skills are in the files of the authors."""

TREE_STREAMS = (
    _topic(f"{HOST}/blackboard_streams/*", _TEXT, "FACT", HOST, ""),
    _topic(
        f"{HOST}/snapshot_streams/*", "py_trees_ros_interfaces/BehaviourTree", "FACT", HOST, ""
    ),
    _topic(f"{HOST}/snapshots", "py_trees_ros_interfaces/BehaviourTree", "FACT", HOST, ""),
)
"""Topics of a host for the tools of py_trees_ros, if ``py_trees_ros_interfaces`` is installed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SystemService(_SystemName):
    """A service or an action of a node of the system.

    Attributes:
        server: Name of the node.
        callers: Names of nodes, and of roles of the command line, each of which may do what those
            before it may; agents call what their skills name.
    """

    server: str
    callers: frozenset[str]


def _service(
    name: str, kind: str, server: str, callers: str = "", *, folder: str = "srv"
) -> SystemService:
    return SystemService(
        name=name, type=_full_type(kind, folder), server=server, callers=frozenset(callers.split())
    )


_action = partial(_service, folder="action")


_READ, _DESCRIBE = "rcl_interfaces/GetParameters", "rcl_interfaces/DescribeParameters"
_SET = "rcl_interfaces/SetParametersAtomically"

SERVICES = (
    _service("bt_agents/select", "SelectAgent", "selector", "marketplace"),
    _service("feedback/collect", "CollectFeedback", "feedback", "marketplace"),
    _service("feedback/give", "GiveFeedback", "feedback", f"{HOST} operate studio"),
    _service("feedback/manage", "ManageProfiles", "feedback", "author studio"),
    _service("journal/record", "Record", "journal", "operate studio"),
    _service("marketplace/cancel", "CancelRun", "marketplace", "feedback operate studio"),
    _service("marketplace/describe_parameters", _DESCRIBE, "marketplace", "studio watch"),
    _service("marketplace/get_parameters", _READ, "marketplace", "studio watch"),
    _service("marketplace/operate", "OperateMarket", "marketplace", "operate studio"),
    _service("marketplace/preview", "PreviewAuction", "marketplace", "operate studio"),
    _service("marketplace/register", "RegisterHost", "marketplace", HOST),
    _service("marketplace/set_parameters_atomically", _SET, "marketplace", "operate studio"),
    _service("scene_layer/analyze", "Analyze", "scene_layer", "operate studio"),
    _service("scene_layer/manage", "ManageProfiles", "scene_layer", "author"),
    _service("scene_layer/remember", "Remember", "scene_layer", HOST),
    _service("set_light", "SetLight", "robot"),
    _service(f"{HOST}/control", "ControlRun", HOST, "operate studio"),
    _service(f"{HOST}/get_parameters", _READ, HOST, "studio watch"),
    _service(f"{HOST}/reload", "ReloadAgents", HOST, "author"),
    _service(f"{HOST}/set_profile", "SetProfile", HOST, "feedback"),
    _service(f"{HOST}/tune", "Tune", HOST, "author studio"),
)
"""All services of the system except those that every ROS node has."""

TREE_STREAM_SERVICES = tuple(
    _service(f"{HOST}/{name}", f"py_trees_ros_interfaces/{kind}", HOST)
    for name, kind in (
        ("blackboard_streams/close", "CloseBlackboardStream"),
        ("blackboard_streams/get_variables", "GetBlackboardVariables"),
        ("blackboard_streams/open", "OpenBlackboardStream"),
        ("snapshot_streams/close", "CloseSnapshotStream"),
        ("snapshot_streams/open", "OpenSnapshotStream"),
        ("snapshot_streams/reconfigure", "ReconfigureSnapshotStream"),
    )
)
"""Services that open and close :data:`TREE_STREAMS`."""

ACTIONS = (
    _action("ask", "Ask", "robot"),
    _action("drive", "Drive", "robot"),
    _action("say", "Say", "robot"),
    _action("show", "Show", "robot"),
    _action(f"{HOST}/run", "RunAgent", HOST, "marketplace"),
)


def heard_by(name: str) -> tuple[SystemTopic, ...]:
    """Return the topics that a node or a role listens to."""
    return tuple(topic for topic in TOPICS if name in topic.listeners)


def topic_called(name: str) -> SystemTopic:
    """Return the topic with a name, which may contain the name of a host.

    Raises:
        KeyError: The system has no such topic.
    """
    return _called(name, TOPICS)


def service_called(name: str) -> SystemService:
    """Return the service with a name, which may contain the name of a host.

    Raises:
        KeyError: The system has no such service.
    """
    return _called(name, SERVICES)


def _called(name: str, table: Iterable[_Named]) -> _Named:
    for entry in table:
        if entry.is_called(name):
            return entry
    raise KeyError(name)
