# SPDX-License-Identifier: Apache-2.0
"""Messages of py_trees_ros_interfaces, which exists only if py_trees_ros is installed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from uuid import UUID

from py_trees.common import Status

from bt_agents.host.tree_streams.blackboard import Activity
from bt_agents.host.tree_streams.stream import TickStatistics
from bt_agents.host.tree_streams.tree_snapshot import NodeState, ShownNode
from bt_agents_core.text import printable_line

PACKAGE = "py_trees_ros_interfaces"

_STATUS = {Status.INVALID: 1, Status.RUNNING: 2, Status.SUCCESS: 3, Status.FAILURE: 4}
_NOT_A_BLACKBOX = 4


@dataclass(frozen=True, kw_only=True)
class WatcherInterfaces:
    """The modules of the types that the tools of py_trees_ros use."""

    msg: Any
    srv: Any
    diagnostics: Any
    identifiers: Any

    @classmethod
    def installed(cls) -> WatcherInterfaces | None:
        """Return the modules; None if the package or one of its dependencies is not installed."""
        try:
            return cls(
                msg=import_module(f"{PACKAGE}.msg"),
                srv=import_module(f"{PACKAGE}.srv"),
                diagnostics=import_module("diagnostic_msgs.msg"),
                identifiers=import_module("unique_identifier_msgs.msg"),
            )
        except ImportError:
            return None

    def behaviour(self, node: ShownNode, state: NodeState) -> Any:
        """Return the message of a node."""
        return self.msg.Behaviour(
            name=printable_line(node.name),
            class_name=node.class_name,
            own_id=self._uuid(node.own_id),
            parent_id=self._uuid(node.parent_id),
            tip_id=self._uuid(state.tip_id),
            child_ids=[self._uuid(child) for child in node.child_ids],
            current_child_id=self._uuid(state.current_child_id),
            type=int(node.type),
            additional_detail=node.detail,
            blackbox_level=_NOT_A_BLACKBOX,
            status=_STATUS[state.status],
            message=printable_line(state.message),
            is_active=state.active,
            blackboard_access=[
                self.msg.KeyValue(key=key, value=access) for key, access in node.accesses
            ],
        )

    def values(self, values: Sequence[tuple[str, str]]) -> list[Any]:
        """Return the messages of variables with their values."""
        return [self.diagnostics.KeyValue(key=key, value=value) for key, value in values]

    def activity(self, accesses: Sequence[Activity]) -> list[Any]:
        """Return the messages of accesses to the blackboard."""
        return [
            self.msg.ActivityItem(
                key=one.key,
                client_name=one.path,
                activity_type=one.type,
                previous_value=one.previous,
                current_value=one.current,
            )
            for one in accesses
        ]

    def statistics(self, count: int, stamp: Any, ticks: TickStatistics) -> Any:
        """Return the message with the tick statistics of a tree."""
        interval, duration = ticks.interval, ticks.duration
        return self.msg.Statistics(
            count=count,
            stamp=stamp,
            tick_duration=duration.last,
            tick_duration_average=duration.average,
            tick_duration_variance=duration.variance,
            tick_interval=interval.last,
            tick_interval_average=interval.average,
            tick_interval_variance=interval.variance,
        )

    def _uuid(self, identifier: UUID | None) -> Any:
        if identifier is None:
            return self.identifiers.UUID()
        return self.identifiers.UUID(uuid=list(identifier.bytes))
