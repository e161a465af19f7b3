# SPDX-License-Identifier: Apache-2.0
"""Marketplace node: turns messages into events of the market, and its effects into messages."""

from __future__ import annotations

import os
import secrets
import time
import uuid
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bt_agents_core.errors import NodeMustEnd, ReadError, Refused
from bt_agents_core.liveness import HEARTBEAT_S
from bt_agents_core.open_goals import name_goals
from bt_agents_core.scene import SceneSpace
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_core.text import join_first
from bt_agents_core.trees_folder import find_trees
from bt_agents_interfaces.msg import Auction as AuctionMsg
from bt_agents_interfaces.msg import Bids as BidsMsg
from bt_agents_interfaces.msg import CallForBids, MarketHeartbeat, MarketStatus
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.msg import SceneEnd as SceneEndMsg
from bt_agents_interfaces.srv import CancelRun, CollectFeedback, SelectAgent
from bt_agents_language.files.market_reader import MarketRule, market_of
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros import qos
from bt_agents_ros.calls import Calls
from bt_agents_ros.health_publisher import HealthPublisher
from bt_agents_ros.managed_node import ManagedNode, make_managed
from bt_agents_ros.messages import scene_from_msg, scene_to_msg
from bt_agents_ros.node_main import RESTARTED
from bt_agents_ros.outbox import Outbox
from bt_agents_ros.parameters import TREES, StartParameter
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import OneShot, steady_timer
from bt_agents_ros.workarounds.cached_wait_set import PolledGroup
from marketplace_node.effects import (
    Alarm,
    AnnounceEarlierRun,
    AnnounceRun,
    Collect,
    Note,
    OpenCall,
    PreviewEnded,
    PublishAuction,
    RequestRanking,
    SceneEnded,
    SendGoal,
    State,
    StatusChanged,
    StoreOverrides,
)
from marketplace_node.formatting import shown
from marketplace_node.hosts.host_effects import (
    CancelAll,
    CancelGoal,
    CancelOpenGoals,
    Connect,
    Disconnect,
    Effect,
)
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.interaction.phases import StopRequest
from marketplace_node.interaction.stored_scenes import StoreScenes, format_scenes
from marketplace_node.market import Market
from marketplace_node.node.hosts import HostConnections
from marketplace_node.node.messages import (
    BidDecoder,
    auction_to_msg,
    call_to_msg,
    run_to_msg,
    scene_end_to_msg,
    selection_from_msg,
    selection_to_msg,
    status_to_msg,
)
from marketplace_node.node.operator_services import OperatorServices
from marketplace_node.node.parameters import declare_settings, watch_settings
from marketplace_node.node.second_market import (
    MARKET_HEARTBEAT,
    another_market_text,
    refuse_second_market,
)
from marketplace_node.node.state_file import StateFile
from marketplace_node.other_market import OtherMarket
from marketplace_node.round.decision import External
from marketplace_node.settings import RULES, Settings
from marketplace_node.strategies.plugins import add_installed

OVERRIDES_FILE = StartParameter(
    name="orders",
    description="file that keeps pins, vetoes and counts of runs across restarts of the market; "
    "empty for none",
)

SCENES_FILE = StartParameter(
    name="scenes",
    description="file that keeps scenes without an end across restarts of the market; empty for "
    "none",
)

_POLL_S = 0.02  # period of the polls for hosts that are just starting
_TOUCH_S = 1.0
_NOTES_S = 1.0  # at most one note in this time, so a misbehaving peer cannot fill the disk
_SHOWN = 200  # characters of a malformed input
_CALL_WAITS = 0.5  # longest wait for hosts that are just connecting, as a part of the bid deadline


@dataclass(frozen=True, kw_only=True)
class MarketConfiguration:
    """Inputs of a market.

    Attributes:
        space: The scene parameters of the system.
        epoch: Name of this start of the market; None generates one.
        rules: Rules of the strategy ``rules``.
        unread: Why the rules could not be read; None if they were read or do not exist.
        overrides_file: Keeps pins, vetoes and counts across restarts; None keeps none.
        scenes_file: Keeps scenes without an end across restarts; None keeps none.
    """

    space: SceneSpace
    epoch: str | None = None
    rules: tuple[MarketRule, ...] = ()
    unread: ReadError | None = None
    overrides_file: Path | None = None
    scenes_file: Path | None = None


class MarketplaceNode(ManagedNode[MarketConfiguration]):
    """Calls for bids on every scene, awards the run to the best bid and supervises it.

    Attributes:
        selector: Client of ``bt_agents/select``, which ranks for the strategy ``external``.
    """

    node_name = "marketplace"
    start_parameters = (TREES, OVERRIDES_FILE, SCENES_FILE)
    stop_limit_s = 1.8
    """Longest wait for the end of the last run and the answer of the feedback node [s]."""

    def configure(self, values: Mapping[str, str]) -> MarketConfiguration:
        for problem in add_installed():
            self.get_logger().warning(problem)
        overrides, scenes = (
            Path(values[one.name]) if values[one.name] else None
            for one in (OVERRIDES_FILE, SCENES_FILE)
        )
        return read_configuration(find_trees(values["trees"]), overrides, scenes)

    def activate(self, configuration: MarketConfiguration, closing: ExitStack) -> None:
        space = configuration.space
        self._space = space
        self._due_calls: dict[int, tuple[OpenCall, float]] = {}
        self._due: deque[Effect] = deque()
        self._decided = self.get_clock().now()
        self._executing = False
        self._state_entered: tuple[tuple[State, int], Any] | None = None
        self._market = Market(
            space,
            configuration.epoch or uuid.uuid4().hex[:12],
            declare_settings(self),
            configuration.rules,
            secret=secrets.token_bytes(),
        )
        self._check_rules(configuration.unread)
        self._hosts = HostConnections(self, self._market, space, self._execute)
        # Destroys the clients of the hosts, which rclpy would leave behind.
        closing.callback(self._hosts.close)
        watch_settings(self, lambda: self._market.settings, self._apply_settings)
        self._calls = self.create_publisher(CallForBids, "bt_agents/calls", qos.EVENTS)
        self._auctions = self.create_publisher(AuctionMsg, "bt_agents/auctions", qos.HISTORY)
        self._runs = self.create_publisher(RunMsg, "bt_agents/runs", qos.HISTORY)
        self._ends = self.create_publisher(SceneEndMsg, "bt_agents/scene_ends", qos.FACTS)
        self._status = self.create_publisher(MarketStatus, "bt_agents/market", qos.FACT)
        self._heartbeats = self.create_publisher(MarketHeartbeat, "~/heartbeat", qos.EVENTS)
        self._heartbeats_sent = 0
        self._health = HealthPublisher(self, lambda: self._market.health(time.monotonic()))
        self._feedback = Outbox(
            self, self.create_client(CollectFeedback, "feedback/collect", qos_profile=qos.SERVICE)
        )
        closing.callback(self._feedback.close)
        self._questions = Calls(self)
        # Created before it is needed, so that the server is discovered by then.
        self.selector = self.create_client(
            SelectAgent, "bt_agents/select", qos_profile=qos.SERVICE
        )
        self._operators = OperatorServices(self, self._market, space, self._execute)
        overrides, scenes = configuration.overrides_file, configuration.scenes_file
        self._overrides_file = (
            StateFile(self, overrides, "pins, vetoes and counts", durable=True)
            if overrides is not None
            else None
        )
        self._scenes_file = (
            StateFile(self, scenes, "scenes without an end", durable=False)
            if scenes is not None
            else None
        )
        for file in (self._overrides_file, self._scenes_file):
            if file is not None:
                closing.callback(file.close)
        self._ticked = time.monotonic()
        self._deadline = OneShot(self, self._tick)
        self._confirmation = OneShot(self, self._tick)
        self._poll = steady_timer(self, _POLL_S, self._tick, running=False)
        steady_timer(self, HEARTBEAT_S, self._publish_heartbeat)
        self._other_market = OtherMarket(self._market.epoch)
        self.create_subscription(
            MarketHeartbeat,
            MARKET_HEARTBEAT,
            self._take_market_heartbeat,
            qos.SENSOR,
            callback_group=PolledGroup(),
        )
        self.create_service(CancelRun, "~/cancel", self._cancel, qos_profile=qos.SERVICE)
        self._bid_decoder = BidDecoder(self._market.epoch, self._hosts.reaches)
        self._bids = self.create_subscription(
            BidsMsg, "bt_agents/bids", self._take_bids, qos.EVENTS, raw=True
        )
        self.create_subscription(SceneMsg, "bt_agents/scene", self._take_scene, qos.EVENTS)
        self._execute(self._market.tick(self._ticked))
        self._restore_overrides()
        self._restore_scenes()
        self.get_logger().info(f"market '{self._market.epoch}' waits for scenes")

    def _check_rules(self, unread: ReadError | None) -> None:
        """Log why the rules could not be read, if no strategy needs them.

        Raises:
            ReadError: The strategy or the shadow needs them.
        """
        if unread is None:
            return
        settings = self._market.settings
        if RULES in (settings.strategy, settings.shadow_strategy):
            raise unread
        self.get_logger().warning(
            f"{unread}\nno rule counts until you fix it and restart the market"
        )

    def begin_stop(self) -> None:
        """Stop the running tree, so that it does not continue without a market."""
        now = "is shutting down" if self.process_ends else "has been deactivated"
        self._execute(self._market.shut_down(f"the marketplace {now}", time.monotonic()))

    def has_stopped(self) -> bool:
        """Return True when no tree runs and the feedback node, if present, has answered."""
        # Stores that the last ends were announced, so the next start does not repeat them.
        self._execute(self._market.tick(time.monotonic()))
        answered = not self._feedback.waiting or self._feedback.late
        return self._market.state is State.IDLE and answered

    def _restore_overrides(self) -> None:
        text = self._overrides_file.read() if self._overrides_file is not None else ""
        if not text:
            return
        try:
            in_force, effects = self._market.restore_overrides(text, time.monotonic())
        except Refused as refused:
            self.get_logger().error(refused.reason)
            return
        if in_force:
            self.get_logger().warning(f"still in force: {in_force}")
        self._execute(effects)

    def _restore_scenes(self) -> None:
        if self._scenes_file is None:
            return
        steady_timer(self, _TOUCH_S, self._scenes_file.touch)
        text, away_s = self._scenes_file.read(), self._scenes_file.age_s()
        if not text:
            return
        try:
            count, effects = self._market.restore_scenes(text, away_s, time.monotonic())
        except Refused as refused:
            self.get_logger().error(refused.reason)
            return
        if count:
            self.get_logger().warning(f"{count} scenes of the earlier market have no end yet")
        self._execute(effects)

    def _apply_settings(self, settings: Settings) -> None:
        self._execute(self._market.configure(settings, time.monotonic()))

    def _take_scene(self, message: SceneMsg) -> None:
        try:
            scene = scene_from_msg(message, self._space)
        except Refused as refused:
            scene_id = message.scene_id[:_SHOWN]
            self._execute(self._market.malformed(scene_id, refused, time.monotonic()))
            return
        self._execute(self._market.scene(scene, time.monotonic()))

    def _take_bids(self, message: bytes) -> None:
        try:
            bids = self._bid_decoder.read(message)
        except Refused as refused:
            self._execute([Note(message=str(refused)[:_SHOWN])])
            return
        self._execute(self._market.bids(bids, time.monotonic()))

    def _cancel(
        self, request: CancelRun.Request, response: CancelRun.Response
    ) -> CancelRun.Response:
        scene, remark = None, ""
        if request.again:
            try:
                scene = scene_from_msg(request.scene, self._space)
            except Refused as refused:
                # The stop itself is carried out, even if the rest of the request is invalid.
                remark = f"; the scene as awarded is asked for again ({refused.reason})"
        by = StoppedBy.of(request.by)
        if by != request.by:
            remark += f"; 'by' is {request.by}, expected 0 to {max(StoppedBy)}, so nobody is named"
        reason = shown(request.reason) or "somebody asked for it"
        response.accepted, message, effects = self._market.cancel(
            request.epoch,
            request.round,
            StopRequest(reason=reason, by=by, again=request.again, scene=scene),
            time.monotonic(),
        )
        response.message = message + (remark if response.accepted else "")
        self._execute(effects)
        return response

    def _tick(self) -> None:
        now = time.monotonic()
        # Heartbeats of the time when this process was stalled are still unread.
        self._execute(self._market.extend_leases(self._ticked, now))
        self._ticked = now
        self._publish_calls(now)
        self._hosts.send_waiting()
        self._execute(self._market.tick(now))

    def _publish_heartbeat(self) -> None:
        self._heartbeats_sent += 1
        goal = self._market.goal
        self._heartbeats.publish(
            MarketHeartbeat(
                epoch=self._market.epoch,
                round=goal.round if goal else 0,
                agent=goal.agent if goal else "",
                sequence=self._heartbeats_sent % 2**32,
            )
        )
        self._tick()
        self._health.update()

    def _take_market_heartbeat(self, heartbeat: MarketHeartbeat) -> None:
        if self._other_market.gives_way(
            heartbeat.epoch, heartbeat.sequence, self._heartbeats_sent
        ):
            raise NodeMustEnd(another_market_text(self, heartbeat.epoch), os.EX_CONFIG)

    def _execute(self, effects: list[Effect]) -> None:
        self._due.extend(effects)
        if self._executing:
            return
        self._executing = True
        self._decided = self.get_clock().now()
        try:
            while self._due:
                self._execute_one(self._due.popleft())
        finally:
            self._executing = False
        self._deadline.set(self._market.due)
        if not (self._due_calls or self._hosts.is_polling):
            self._poll.cancel()
        elif self._poll.is_canceled():
            self._poll.reset()

    def _execute_one(self, effect: Effect) -> None:
        log = self.get_logger()
        match effect:
            case Connect():
                self._connect(effect.entry)
            case Disconnect():
                self._hosts.disconnect(effect.host)
                self._bid_decoder.forget(effect.host)
            case OpenCall():
                now = time.monotonic()
                latest = now + _CALL_WAITS * effect.deadline_s
                self._due_calls[effect.round] = (effect, latest)
                self._publish_calls(now)
            case RequestRanking():
                self._request_ranking(effect)
            case PreviewEnded():
                self._due_calls.pop(effect.number, None)
                self._operators.end(effect)
            case PublishAuction():
                self._due_calls.pop(effect.decision.terms.round, None)
                # The winner may act visibly before this long message is assembled.
                self._auctions.publish(auction_to_msg(effect, self._decided.to_msg()))
                log.info(f"round {effect.decision.terms.round}: {effect.reason}")
            case SendGoal():
                self._hosts.send(effect)
            case CancelGoal():
                self._hosts.cancel(effect.goal)
            case CancelAll():
                log.warning(f"{effect.host} runs a tree that nobody waits for: it is cancelled")
                self._hosts.cancel_all(effect.host)
            case CancelOpenGoals():
                log.warning(f"{effect.host} has left open: {name_goals(effect.goals)}")
                self._hosts.cancel_open_goals(effect)
            case AnnounceRun():
                self._runs.publish(run_to_msg(effect, self._market.epoch, self._now()))
                event = f"{effect.goal.agent} {effect.event.name.lower()}: {effect.message}"
                log.info(f"round {effect.goal.round}: {event}")
            case AnnounceEarlierRun():
                self._runs.publish(run_to_msg(effect.run, effect.run.epoch, self._now()))
            case Collect():
                self._collect(effect)
            case StatusChanged():
                self._publish_status(effect)
            case SceneEnded():
                self._ends.publish(scene_end_to_msg(effect, self._market.epoch, self._now()))
                log.info(f"scene '{effect.scene_id}' {effect.code}: {effect.message}")
            case StoreOverrides():
                if self._overrides_file is not None:
                    self._overrides_file.store(effect.text, at_once=effect.at_once)
            case StoreScenes():
                if self._scenes_file is not None:
                    self._scenes_file.store(format_scenes(effect), at_once=effect.at_once)
                if effect.ends or effect.run_ends:
                    # The next tick stores that they were announced; a kill before it repeats them.
                    self._confirmation.set(time.monotonic())
            case Note():
                log.warning(effect.message, throttle_duration_sec=_NOTES_S)
            case Alarm():
                log.warning(effect.message)

    def _connect(self, entry: HostEntry) -> None:
        try:
            self._hosts.connect(entry)
            self.get_logger().info(f"{entry.host} is registered: {join_first(entry.agents)}")
        except Refused as refused:
            self.get_logger().error(refused.reason)
            self._execute(self._market.disconnect(entry.host, time.monotonic()))

    def _publish_calls(self, now: float) -> None:
        for effect, latest in list(self._due_calls.values()):
            if self._matched(effect.hosts) or now >= latest:
                self._due_calls.pop(effect.round, None)
                call = call_to_msg(effect, self._market.epoch, self._space, self._now())
                self._calls.publish(call)
                self._execute(self._market.called(effect.round, now))

    def _matched(self, hosts: int) -> bool:
        """Return whether this many hosts are matched both ways, so that no message is lost."""
        publishers = int(self._bids.get_publisher_count())
        subscribers = int(self._calls.get_subscription_count())
        return min(publishers, subscribers) >= hosts

    def _request_ranking(self, effect: RequestRanking) -> None:
        """Send the request once; the market owns the deadline."""

        def report(external: External) -> None:
            self._execute(self._market.ranked(effect.round, external, time.monotonic()))

        if not self.selector.service_is_ready():
            report(External(failure=f"no selector serves '{self.selector.srv_name}'"))
            return
        self._questions.call(
            self.selector,
            selection_to_msg(effect, self._market.epoch),
            deadline_s=effect.limit_s,
            on_answer=lambda answer: report(selection_from_msg(answer, effect.agents)),
            on_failure=lambda reason: report(External(failure=reason)),
        )

    def _collect(self, effect: Collect) -> None:
        number = effect.goal.round

        def answered(answer: Any) -> None:
            message = answer.message if answer is not None else "the request for feedback was lost"
            self._execute(self._market.collected(number, message, time.monotonic()))

        self._feedback.put(
            CollectFeedback.Request(
                epoch=self._market.epoch,
                round=number,
                agent=effect.goal.agent,
                outcome=int(effect.outcome),
                scene=scene_to_msg(effect.scene),
            ),
            answered,
        )
        if self._feedback.late:
            self._execute(self._market.feedback_deferred(number, time.monotonic()))

    def _publish_status(self, status: StatusChanged) -> None:
        key = (status.state, status.round)
        if self._state_entered is None or self._state_entered[0] != key:
            self._state_entered = (key, self._now())
        stamp = self._state_entered[1]
        supervised = RESTARTED in os.environ
        self._status.publish(
            status_to_msg(status, self._market.epoch, stamp, supervised=supervised)
        )

    def _now(self) -> Any:
        return self.get_clock().now().to_msg()


def read_configuration(
    trees: Path, overrides_file: Path | None = None, scenes_file: Path | None = None
) -> MarketConfiguration:
    """Return the configuration of the market of a trees folder.

    Raises:
        ReadError: ``scene.yaml`` is wrong.
    """
    space = read_scene(trees / "scene.yaml").space
    rules: tuple[MarketRule, ...] = ()
    unread = None
    try:
        rules = market_of(trees, space)
    except ReadError as error:
        unread = error
    return MarketConfiguration(
        space=space,
        rules=rules,
        unread=unread,
        overrides_file=overrides_file,
        scenes_file=scenes_file,
    )


def make_node() -> MarketplaceNode:
    """Create the node from the parameters of its process.

    Raises:
        BtAgentsError: Another market is alive, or the trees folder cannot be used.
    """
    return make_managed(MarketplaceNode, refuse_second_market)


def main(args: Sequence[str] | None = None) -> int:
    """Run the marketplace until it is stopped; return the exit code."""
    return run(make_node, args)
