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
from bt_agents.ros.calls import Calls
from bt_agents.ros.installed import InstalledInterfaces
from bt_agents.ros.introductions import host_card, tree_structures
from bt_agents.ros.messages import scene_from_msg
from bt_agents.ros.parameters import declare, describe
from bt_agents.ros.run_server import RunServer
from bt_agents.ros.runner import run
from bt_agents.ros.startup import TREES, StartParameter, make_from_parameters
from bt_agents.ros.tunables import TunableParameters
from bt_agents.roster import Roster
from bt_agents.scene import Scene
from bt_agents.trees_folder import find_trees
from bt_agents_interfaces.msg import (
    Bids,
    CallForBids,
    Heartbeat,
    HostCard,
    MarketStatus,
    Trees,
)
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import RegisterHost, SetProfile

HEARTBEAT_S = 0.1
_REGISTER_LIMIT_S = 2.0
_REGISTER_AGAIN_S = 1.0


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
        self._live: Scene | None = None
        self._epoch = ""
        self._registering = False
        self._beats = 0
        self._calls = Calls(self)
        for broken in folder.broken:
            self.get_logger().error(f"agent file left out, the others run:\n{broken.error.report}")
        for problem in folder.plugin_problems:
            self.get_logger().warning(f"a node of a package is left out: {problem}")
        self._introduce_publishers()
        self._runs = RunServer(self, self.roster, self.instance, self._live_scene)
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
        self.create_subscription(SceneMsg, "scene/live", self._take_live, qos.SENSOR)
        self.create_subscription(MarketStatus, "market", self._meet_market, qos.FACT)
        self._register_client = self.create_client(
            RegisterHost, "marketplace/register", qos_profile=qos.SERVICE
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(HEARTBEAT_S, self._beat, clock=steady)
        self.create_timer(_REGISTER_AGAIN_S, self._register_again, clock=steady)
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
        return bool(self._epoch) and all(m.agent_id for m in self.roster.members.values())

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

    def _meet_market(self, status: MarketStatus) -> None:
        if status.epoch != self._epoch:
            self._register(status.epoch)

    def _register_again(self) -> None:
        if self._epoch and any(member.refusal for member in self.roster.members.values()):
            self._register(self._epoch)

    def _register(self, epoch: str) -> None:
        if self._registering:
            return
        self._registering = True
        names = list(self.roster.members)
        request = RegisterHost.Request(
            host=self.host,
            host_instance=self.instance,
            # Actions are not remapped by rclpy, so neither is the name that the market is told.
            run_action=f"{self.host}/run",
            heartbeat=self.resolve_topic_name("~/heartbeat"),
            parameters=list(self.roster.space.names),
            agents=names,
        )
        self._calls.call(
            self._register_client,
            request,
            deadline_s=_REGISTER_LIMIT_S,
            on_answer=lambda answer: self._registered(names, answer),
            on_failure=lambda reason: self._not_registered(epoch, reason),
        )

    def _registered(self, names: list[str], answer: RegisterHost.Response) -> None:
        self._registering = False
        if not answer.accepted:
            if self._epoch != answer.epoch:
                self.get_logger().error(f"the market refuses this host: {answer.message}")
            self._epoch = answer.epoch
            self._runs.close()
            refused = [answer.message] * len(names)
            self._enrol(names, [0] * len(names), refused)
            return
        self._epoch = answer.epoch
        self._runs.open()
        self._runs.end_orphan(answer.epoch)
        self._enrol(names, answer.agent_ids, answer.reasons)

    def _enrol(self, names: Sequence[str], ids: Sequence[int], reasons: Sequence[str]) -> None:
        before = {n: (m.agent_id, m.refusal) for n, m in self.roster.members.items()}
        if not len(names) == len(ids) == len(reasons):
            self.get_logger().error("the market's answer to the registration is malformed")
            return
        self.roster.enrol(names, ids, reasons)
        after = {n: (m.agent_id, m.refusal) for n, m in self.roster.members.items()}
        for name, (_, refusal) in after.items():
            if refusal and refusal != before[name][1]:
                self.get_logger().error(f"agent '{name}' is not registered: {refusal}")
        if after != before:
            self._introduce()

    def _not_registered(self, epoch: str, reason: str) -> None:
        self._registering = False
        self.get_logger().warning(f"registration at market {epoch}: {reason}; trying again")
        self._register(epoch)

    def _bid(self, call: CallForBids) -> None:
        if call.epoch != self._epoch or list(call.parameters) != list(self.roster.space.names):
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

    def _take_live(self, message: SceneMsg) -> None:
        try:
            self._live = scene_from_msg(message, self.roster.space)
        except Refused as refused:
            self.get_logger().warning(f"live scene refused: {refused}", throttle_duration_sec=5.0)

    def _live_scene(self, scene_id: str) -> Scene | None:
        return self._live if self._live and self._live.scene_id == scene_id else None

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
