# SPDX-License-Identifier: Apache-2.0
"""The host node: many agents from one trees folder, bidding and running as one."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from bt_agents.errors import Refused
from bt_agents.language.folder_reader import Trees as TreesFolder
from bt_agents.language.folder_reader import read_trees
from bt_agents.language.specs import NodeSpec
from bt_agents.language.walking import every_node
from bt_agents.ros import qos
from bt_agents.ros.installed import InstalledInterfaces
from bt_agents.ros.introductions import host_card, tree_structures
from bt_agents.ros.live_scene import LiveScene
from bt_agents.ros.membership import Membership
from bt_agents.ros.messages import scene_from_msg
from bt_agents.ros.parameters import declare, describe
from bt_agents.ros.run_server import RunServer
from bt_agents.ros.runner import run
from bt_agents.ros.startup import TREES, StartParameter, make_from_parameters
from bt_agents.ros.tunables import TunableParameters
from bt_agents.roster import Roster
from bt_agents.trees_folder import find_trees
from bt_agents_interfaces.msg import (
    Bids,
    CallForBids,
    Heartbeat,
    HostCard,
    Trees,
)
from bt_agents_interfaces.srv import SetProfile

HEARTBEAT_S = 0.1


class HostNode(Node):
    """Offers the agents of a trees folder: registers them, bids for them, ticks the winner's tree.

    Args:
        folder: What the trees folder says.
        node_kwargs: For :class:`rclpy.node.Node`.
    """

    def __init__(self, folder: TreesFolder, **node_kwargs: Any) -> None:
        super().__init__("agents", **node_kwargs)
        self.instance = uuid.uuid4().hex[:12]
        self.roster = Roster(folder.scene.space, folder.agents)
        self._folder = folder
        self._beats = 0
        for broken in folder.broken:
            self.get_logger().error(f"agent file left out, the others run:\n{broken.error.report}")
        for problem in folder.plugin_problems:
            self.get_logger().warning(f"a node of a package is left out: {problem}")
        self._introduce_publishers()
        live = LiveScene(self, self.roster.space)
        self._runs = RunServer(self, self.roster, self.instance, live.of)
        for member in self.roster.members.values():
            self._prepare(member.spec.tree)
            if member.spec.on_cancel is not None:
                self._prepare(member.spec.on_cancel)
        TunableParameters(self, self.roster, self._introduce)
        rate = declare(
            self,
            "tick_rate",
            20.0,
            describe("ticks of the running tree [1/s]", minimum=1.0, maximum=200.0),
        )
        self._runs.set_rate(float(rate))
        self.add_post_set_parameters_callback(self._take_rate)
        self.create_service(
            SetProfile, "~/set_profile", self._set_profile, qos_profile=qos.SERVICE
        )
        self.create_subscription(CallForBids, "calls", self._bid, qos.EVENTS)
        self._membership = Membership(
            self, self.roster, self._runs, self.instance, self._introduce
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(HEARTBEAT_S, self._beat, clock=steady)
        self._introduce()
        self._trees.publish(
            tree_structures(self.host, self.instance, self.roster.members.values())
        )
        self.get_logger().info(
            f"{len(self.roster.members)} agents: {', '.join(self.roster.members)}"
        )

    def _introduce_publishers(self) -> None:
        self._bids = self.create_publisher(Bids, "bids", qos.EVENTS)
        self._heartbeats = self.create_publisher(Heartbeat, "~/heartbeat", qos.EVENTS)
        self._cards = self.create_publisher(HostCard, "cards", qos.FACT)
        self._trees = self.create_publisher(Trees, "~/trees", qos.FACT)

    @property
    def host(self) -> str:
        """The fully qualified name, under which the market knows this host."""
        return str(self.get_fully_qualified_name())

    @property
    def registered(self) -> bool:
        """True when the market has taken every agent of this host."""
        return self._membership.complete

    def request_stop(self) -> None:
        """Cancel the running tree, so that nothing goes on behind the host's back."""
        self._runs.stop("the host is stopping")

    def stopped(self) -> bool:
        """Return True when no tree runs."""
        return not self._runs.busy

    def destroy_node(self) -> None:
        """Leave the graph, the action first."""
        self._runs.close()
        super().destroy_node()

    def _prepare(self, tree: NodeSpec) -> None:
        for spec in every_node(tree):
            binding = spec.skill.binding if spec.skill is not None else None
            if binding is not None:
                self._runs.world.prepare(binding.kind, binding.name, binding.type)
            if spec.kind == "give_feedback":
                self._runs.world.prepare_feedback()

    def _introduce(self) -> None:
        card = host_card(self.host, self.instance, self.roster, self._folder)
        self._cards.publish(card)

    def _bid(self, call: CallForBids) -> None:
        same_space = list(call.parameters) == list(self.roster.space.names)
        if call.epoch != self._membership.epoch or not same_space:
            return
        try:
            scene = scene_from_msg(call.scene, self.roster.space)
        except Refused as refused:
            self.get_logger().warning(f"call of round {call.round} not answered: {refused}")
            return
        answer = self.roster.answer(scene, call.excluded)
        self._bids.publish(
            Bids(
                epoch=call.epoch,
                round=call.round,
                host=self.host,
                host_instance=self.instance,
                agents=[member.spec.name for member in answer.bids],
                agent_ids=[member.agent_id for member in answer.bids],
                vectors=[value for member in answer.bids for value in member.profile],
                declined=list(answer.declined),
                decline_reasons=list(answer.declined.values()),
            )
        )

    def _set_profile(
        self, request: SetProfile.Request, response: SetProfile.Response
    ) -> SetProfile.Response:
        try:
            member = self.roster.set_profile(request.agent, request.values, request.revision)
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        response.accepted = True
        response.message = f"{request.agent} bids with revision {member.revision}"
        self._introduce()
        return response

    def _take_rate(self, parameters: list[Parameter[Any]]) -> None:
        for parameter in parameters:
            if parameter.name == "tick_rate":
                self._runs.set_rate(float(parameter.value))

    def _beat(self) -> None:
        self._beats += 1
        goal = self._runs.goal
        self._heartbeats.publish(
            Heartbeat(
                host=self.host,
                host_instance=self.instance,
                epoch=goal.epoch if goal else "",
                round=goal.round if goal else 0,
                agent=goal.agent if goal else "",
                sequence=self._beats % 2**32,
            )
        )


TAGS = StartParameter(
    name="tags",
    description="agents with one of these tags, commas between them; empty takes every agent",
)
ROBOT = StartParameter(
    name="robot",
    description="robot whose bindings of skills are preferred; empty takes the first that fits",
)


def make_node() -> HostNode:
    """Create the node with the agents of the folder that its parameter names.

    Raises:
        BtAgentsError: There is no such folder, or its scene or skills are broken.
    """

    def make(values: Mapping[str, str]) -> HostNode:
        folder = find_trees(values["trees"])
        trees = read_trees(folder, InstalledInterfaces(), values["robot"])
        return HostNode(trees.tagged(values["tags"]))

    return make_from_parameters("agents", (TREES, TAGS, ROBOT), make)


def main(args: Sequence[str] | None = None) -> int:
    """Run a host until it is told to stop; return the exit code."""
    return run(make_node, args)


if __name__ == "__main__":
    raise SystemExit(main())
