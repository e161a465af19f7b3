# SPDX-License-Identifier: Apache-2.0
"""The host node: bids with and runs many agents from one trees folder."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node

from bt_agents.host.agent_registry import AgentRegistry, HostedAgent
from bt_agents.host.control_service import ControlService
from bt_agents.host.detail_publisher import DetailPublisher
from bt_agents.host.environment.open_goal_list import EarlierGoals
from bt_agents.host.environment.open_goals_file import OpenGoalsFile
from bt_agents.host.health import TickCounts, files_health, servers_health, ticks_health
from bt_agents.host.host_card import HostCardPublisher
from bt_agents.host.market_registration import NO_TOKEN, MarketRegistration
from bt_agents.host.reload.reload_service import ReloadService
from bt_agents.host.reload.versions import AgentVersions, ReloadAction, ReloadEffect
from bt_agents.host.run_monitors import LiveSceneView
from bt_agents.host.run_server import RunServer
from bt_agents.host.tree_streams.stream_server import DEFAULT_PERIOD, offer_tree_streams
from bt_agents.host.tuning.tunable_parameters import TunableParameters
from bt_agents_core.errors import Refused
from bt_agents_core.health import PartHealth
from bt_agents_core.liveness import HEARTBEAT_S
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_core.trees_folder import find_trees
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Bids, CallForBids, Heartbeat
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import SetProfile
from bt_agents_language.files.folder_reader import Trees as TreesFolder
from bt_agents_language.files.folder_reader import binding_problems, read_trees
from bt_agents_language.files.preset_reader import PRESETS_FOLDER
from bt_agents_language.model.specs import AgentSpec, NodeSpec, iter_nodes
from bt_agents_ros import qos
from bt_agents_ros.bid_encoding import BidEncoder
from bt_agents_ros.discovery import is_matched
from bt_agents_ros.health_publisher import HealthPublisher
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.managed_node import ManagedNode, make_managed
from bt_agents_ros.messages import answering, scene_from_msg
from bt_agents_ros.parameters import (
    TREES,
    StartParameter,
    declare_live_lease,
    declare_slow_network,
)
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import steady_timer

_NAMES_SHOWN = 20


TAGS = StartParameter(
    name="tags",
    description="tags, separated by commas; the host takes the agents with one of them; empty "
    "takes every agent",
)
ROBOT = StartParameter(
    name="robot",
    description="robots whose skill bindings are preferred, separated by commas; empty takes the "
    "first binding that fits",
)
LANGUAGE = StartParameter(
    name="language",
    description="language of what agents say, ask and show; empty takes the language of "
    "scene.yaml",
)
TUNINGS = StartParameter(
    name="tunings",
    description="file that keeps tunings across restarts; empty keeps them in memory",
)
OPEN_GOALS = StartParameter(
    name="open_goals",
    description="file that keeps open goals, so that a restarted host can cancel the goals of a "
    "killed one; empty for none",
)
MARKET = StartParameter(
    name="market",
    description="none: any program runs an agent by its name, at ~/run; empty: the marketplace "
    "awards the runs",
)


@dataclass(frozen=True, kw_only=True)
class HostConfiguration:
    """Inputs of a host.

    Attributes:
        folder: The trees folder with its agents.
        tunings: File that keeps tunings across restarts; empty keeps them in memory.
        open_goals: File of its open goals, so that a later start can cancel them; empty for none.
        market: Whether a marketplace awards its runs; if not, any program runs an agent by name.
    """

    folder: TreesFolder
    tunings: str = ""
    open_goals: str = ""
    market: bool = True


class HostNode(ManagedNode[HostConfiguration]):
    """Host of the agents of a trees folder: registers them, bids, and ticks the winner's tree.

    Attributes:
        instance: Identifier of this activation, different from all earlier ones.
    """

    instance = ""
    _registration: MarketRegistration | None = None

    node_name = "agents"
    may_be_infinite = frozenset((DEFAULT_PERIOD,))
    start_parameters = (TREES, TAGS, ROBOT, LANGUAGE, TUNINGS, OPEN_GOALS, MARKET)

    def configure(self, values: Mapping[str, str]) -> HostConfiguration:
        if values["market"] not in ("", "none"):
            raise Refused(
                RefusalCode.UNKNOWN_CHOICE,
                f"the parameter 'market' is '{values['market']}', expected 'none', or nothing for "
                "the marketplace of this namespace",
            )
        folder = find_trees(values["trees"])
        trees = read_trees(folder, InstalledInterfaces(), values["robot"], values["language"])
        return HostConfiguration(
            folder=trees.tagged(values["tags"]),
            tunings=values["tunings"],
            open_goals=values["open_goals"],
            market=not values["market"],
        )

    def activate(self, configuration: HostConfiguration, closing: ExitStack) -> None:
        folder, market = configuration.folder, configuration.market
        earlier, self._registration = self._registration, None
        self.instance = uuid.uuid4().hex[:12]
        self.registry = AgentRegistry(folder.scene.space, folder.agents)
        self._beats = 0
        slowness = declare_slow_network(self)
        for broken in folder.broken:
            self.get_logger().error(f"agent file left out, the others run:\n{broken.error.report}")
        for problem in folder.plugin_problems:
            self.get_logger().warning(f"a node of a package is left out: {problem}")
        self._bids = self.create_publisher(Bids, "bt_agents/bids", qos.EVENTS)
        self._bid_encoder = BidEncoder(self.host, self.instance)
        self._heartbeats = self.create_publisher(Heartbeat, "~/heartbeat", qos.EVENTS)
        self._versions = AgentVersions(folder)
        self._host_card = HostCardPublisher(
            self, self.instance, self.registry, self._versions, self._other_problems
        )
        open_goals = configuration.open_goals
        self._open_goals_file = self._hold(Path(open_goals)) if open_goals else None
        file = self._open_goals_file
        if file is not None:
            closing.callback(file.close)
        self._earlier_goals = EarlierGoals(self, file) if file is not None else None
        live = LiveScene(self, self.registry.space)
        self._runs = RunServer(
            self,
            self.registry,
            self.instance,
            live.begin_run,
            open_goals_file=file,
            market=market,
            slowness=slowness,
        )
        self._runs.environment.graph_problems.on_change = self._host_card.card
        closing.callback(self._runs.environment.close)
        closing.callback(self._runs.close)
        for member in self.registry.members.values():
            self._prepare(member.spec)
        self._tunables = TunableParameters(
            self,
            self.registry,
            folder.folder / PRESETS_FOLDER,
            self._host_card.card,
            set_rate=self._runs.set_rate,
            tunings=configuration.tunings,
        )
        closing.callback(self._tunables.close)
        self.create_service(
            SetProfile, "~/set_profile", self._set_profile, qos_profile=qos.SERVICE
        )
        if market:
            self._calls = self.create_subscription(
                CallForBids, "bt_agents/calls", self._bid, qos.EVENTS
            )
            self._registration = MarketRegistration(
                self,
                self.registry,
                self._runs,
                self.instance,
                earlier.token if earlier is not None else NO_TOKEN,
                slowness,
                ready=self._is_ready,
                matched=lambda: is_matched(
                    self, self._bids, self._calls, partner="bt_agents/market"
                ),
                changed=self._on_registration,
            )
            # It reports to the market, before the tree acts, that the goal is not refused;
            # otherwise a host that dies at once would leave no sign that it has acted.
            self._runs.on_begin.append(lambda _: self._publish_heartbeat())
        self._reloading = ReloadService(
            self, self._versions, self._runs, apply=self._change, applied=self._publish_changes
        )
        closing.callback(self._reloading.close)
        ControlService(self, self._runs, self.instance)
        self._details = DetailPublisher(self, self._runs, self.instance)
        self._tree_streams = offer_tree_streams(self, self._runs)
        self._changed = False
        self._runs.on_end.append(lambda *_: self._tidy_up())
        steady_timer(self, HEARTBEAT_S, self._beat)
        self._host_card.trees()
        self._host_card.files()
        self._host_card.card()
        self._tick_counts = TickCounts()
        self._health = HealthPublisher(self, self._judge)
        self._runs.on_end.append(self._count_ticks)
        names = list(self.registry.members)
        shown = ", ".join(names[:_NAMES_SHOWN]) + (" …" if names[_NAMES_SHOWN:] else "")
        self.get_logger().info(f"{len(names)} agents: {shown}")

    @property
    def host(self) -> str:
        """The fully qualified name, which is this host's name in the market."""
        return str(self.get_fully_qualified_name())

    @property
    def registered(self) -> bool:
        """True when the market has taken every agent of this host."""
        return self._registration is not None and self._registration.complete

    def begin_stop(self) -> None:
        self._runs.stop("the host is stopping", process_ends=self.process_ends)

    def has_stopped(self) -> bool:
        """Return True when no tree runs and a live market has announced the last run's end."""
        awaited = self._registration is not None and self._registration.awaits_end
        return not self._runs.busy and not awaited

    def keeps(self, parameter: str) -> bool:
        """Return whether a parameter is not a tunable; the file of the tunings keeps tunables."""
        return parameter not in self._tunables

    def _other_problems(self) -> Iterator[str]:
        """Yield the problems outside the files, in words."""
        trees = self._versions.trees
        yield from binding_problems(trees.symbols.skills, trees.robot)
        yield from trees.plugin_problems
        yield from self._reloading.problems
        yield from self._tunables.left_out.values()
        yield from self._tunables.preset_problems
        yield from self._runs.environment.graph_problems.messages.values()

    def _judge(self) -> tuple[PartHealth, ...]:
        run = self._runs.run
        if run is not None:
            self._tick_counts = TickCounts(agent=run.spec.name, overruns=run.overruns)
        problems = [
            (one.file or one.agent, one.message)
            for one in self._host_card.problems
            if one.file or one.agent
        ]
        servers = self._runs.environment
        return (
            files_health(len(self.registry.members), problems),
            ticks_health(self._tick_counts),
            servers_health(servers.silent_servers.reasons, servers.graph_problems.messages),
        )

    def _count_ticks(self, goal: RunAgent.Goal, result: RunAgent.Result) -> None:
        self._tick_counts = TickCounts(agent=goal.agent, overruns=result.overruns)
        self._health.update()

    def _is_ready(self) -> bool:
        return self._earlier_goals is None or self._earlier_goals.ended

    def _on_registration(self) -> None:
        assert self._registration is not None, "it has called back"
        self._host_card.set_registered(self._registration.accepted)

    def _hold(self, path: Path) -> OpenGoalsFile | None:
        try:
            return OpenGoalsFile(path)
        except OSError as error:
            self.get_logger().error(
                f"{path} cannot be used ({error.strerror}), so goals that are open when this host "
                "is killed are not cancelled at its next start; does another host use the file?"
            )
            return None

    def _prepare(self, agent: AgentSpec) -> None:
        for spec in _nodes(agent):
            self._runs.environment.prepare(spec)

    def _tidy_up(self) -> None:
        """Destroy clients and topics that no agent uses any more, if no tree runs."""
        if self._changed and not self._runs.busy:
            self._changed = False
            members = self.registry.members.values()
            self._runs.environment.retain(
                node for member in members for node in _nodes(member.spec)
            )

    def _change(self, effect: ReloadEffect) -> None:
        """Apply a change of one agent completely or not at all; a running tree stays unchanged."""
        name, agent = effect.name, effect.agent
        if effect.action is ReloadAction.REMOVE:
            self.registry.remove(name)
            self._tunables.remove(name)
        elif effect.action is ReloadAction.ADD and agent is not None:
            self._add(agent)
        elif agent is not None:
            member = self.registry.members[name]
            if member.spec.profile != agent.profile and member.revision:
                self.get_logger().info(
                    f"{name}: what it has learned (revision {member.revision}) counts until the "
                    "feedback node has recorded the profile of the file"
                )
            if effect.action is ReloadAction.REPLACE_TREE:
                member.tunables = dict(member.tunables)
            self._replace(member, agent)
        if name in self.registry.members:
            reason = self._versions.states[name].removal_reason
            self.registry.members[name].removal_reason = reason

    def _add(self, agent: AgentSpec) -> None:
        try:
            self._tunables.add(self.registry.add(agent))
        except Exception:
            self.registry.remove(agent.name)
            self._tunables.remove(agent.name)
            raise
        self._prepare(agent)

    def _replace(self, member: HostedAgent, agent: AgentSpec) -> None:
        before = member.spec
        try:
            self._tunables.replace(member, agent)
        except Exception:
            self._tunables.replace(member, before)
            raise
        self._prepare(agent)

    def _publish_changes(self, effects: Sequence[ReloadEffect]) -> None:
        """Publish changed agents, once on each topic."""
        actions = {effect.action for effect in effects}
        if self._registration and actions & {ReloadAction.ADD, ReloadAction.REMOVE}:
            self._registration.refresh()
        if actions - {ReloadAction.REPORT}:
            self._host_card.trees()
            self._changed = True
            self._tidy_up()
        # Always, because the files include the rules of the market.
        self._host_card.files()
        self._host_card.card()
        self._health.update()

    def _bid(self, call: CallForBids) -> None:
        same_space = list(call.parameters) == list(self.registry.space.profiles.names)
        registration = self._registration
        if registration is None:
            return
        if call.epoch != registration.epoch and registration.defer(lambda: self._bid(call)):
            return
        if not (registration.accepted and call.epoch == registration.epoch and same_space):
            return
        try:
            scene = scene_from_msg(call.scene, self.registry.space)
        except Refused as refused:
            self.get_logger().warning(f"call of round {call.round} not answered: {refused}")
            return
        answer = self.registry.bids_for(
            scene,
            frozenset(call.excluded),
            obstacle=self._runs.environment.clock.obstacle(),
            clock=self._runs.environment.local_time,
        )
        self._bids.publish(
            self._bid_encoder.message(call.epoch, call.round, registration.token, answer)
        )
        if answer.undecided != self.registry.undecided:
            self.registry.undecided = answer.undecided
            for name, reason in answer.undecided.items():
                self.get_logger().error(f"agent '{name}' does not bid: it {reason}")
            self.executor.create_task(self._host_card.card)

    def _set_profile(
        self, request: SetProfile.Request, response: SetProfile.Response
    ) -> SetProfile.Response:
        agent, layer = request.agent, request.layer
        with answering(response):
            if request.remove:
                self.registry.remove_layer(agent, layer)
                response.message = f"{agent or 'everybody here'} has no {layer or 'layers'} now"
            else:
                self.registry.set_profile(agent, request.values, request.revision, layer)
                whose = f" for {layer}" if layer else ""
                response.message = f"{agent} bids with revision {request.revision}{whose}"
            if not layer and not request.remove:
                # The feedback node waits for the answer; the card can follow later.
                self.executor.create_task(self._host_card.card)
        return response

    def _beat(self) -> None:
        self._publish_heartbeat()
        if self._registration is not None:
            self._registration.check_lease()
        elif self._is_ready():
            self._runs.open()
        self._runs.check_stall()
        self._details.check_subscribers()
        if self._tree_streams is not None:
            self._tree_streams.check_subscribers()
        self._runs.environment.look_again()
        self._health.update()

    def _publish_heartbeat(self) -> None:
        self._beats += 1
        goal = self._runs.goal
        tip, tip_name = self._runs.tip
        self._heartbeats.publish(
            Heartbeat(
                token=self._registration.token if self._registration is not None else NO_TOKEN,
                host=self.host,
                host_instance=self.instance,
                epoch=goal.epoch if goal else "",
                round=goal.round if goal else 0,
                agent=goal.agent if goal else "",
                tip=tip,
                tip_name=tip_name,
                sequence=self._beats % 2**32,
            )
        )


class LiveScene:
    """Subscription to the live scene, for the current run."""

    def __init__(self, node: Node, space: SceneSpace) -> None:
        self._node = node
        self._space = space
        self._view: LiveSceneView | None = None
        self._lease_s = declare_live_lease(node, self._set_lease)
        node.create_subscription(SceneMsg, "bt_agents/scene/live", self._on_live_scene, qos.SENSOR)

    def begin_run(self, awarded: Scene) -> Callable[[], Scene]:
        """Start with the scene of a run; return a function for its current state."""
        self._view = LiveSceneView(awarded, time.monotonic, self._lease_s)
        return self._view.now

    def _set_lease(self, seconds: float) -> None:
        self._lease_s = seconds
        if self._view is not None:
            self._view.lease_s = seconds

    def _on_live_scene(self, message: SceneMsg) -> None:
        view = self._view
        if view is None or message.scene_id != view.scene_id:
            return
        try:
            view.receive(scene_from_msg(message, self._space))
        except Refused as refused:
            self._node.get_logger().warning(
                f"live scene refused: {refused}", throttle_duration_sec=5.0
            )


def _nodes(agent: AgentSpec) -> Iterator[NodeSpec]:
    for root in filter(None, (agent.tree, agent.on_cancel)):
        yield from iter_nodes(root)


def make_node() -> HostNode:
    """Create the node with the agents of the folder given by its parameter.

    Raises:
        Refused: ``UNKNOWN_CHOICE``.
        BtAgentsError: The folder does not exist, or its scene or skills are broken.
    """
    return make_managed(HostNode)


def main(args: Sequence[str] | None = None) -> int:
    """Run a host until it is stopped; return the exit code."""
    return run(make_node, args)


if __name__ == "__main__":
    raise SystemExit(main())
