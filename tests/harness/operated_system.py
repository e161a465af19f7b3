# SPDX-License-Identifier: Apache-2.0
"""A system without processes on a manual clock, which a random operator uses; a journal of it."""

from __future__ import annotations

import contextlib
import heapq
import json
import math
import shutil
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

from rclpy.serialization import serialize_message

from bt_agents.engine.run import Run, TreeOutcome
from bt_agents.engine.scripted_environment import ManualClock, ScriptedEnvironment, ScriptedReply
from bt_agents.host.agent_registry import AgentRegistry
from bt_agents.host.host_card import HostCardPublisher
from bt_agents.host.reload.folder_watch import FolderWatch
from bt_agents.host.reload.versions import AgentVersions, ReloadAction, ReloadEffect
from bt_agents.host.run_messages import tree_status
from bt_agents_core.errors import Refused
from bt_agents_core.feedback import BUTTON, FeedbackKind
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_core.stop_cause import StopCause
from bt_agents_lab.recorder.daily_recorder import DailyRecorder
from bt_agents_lab.recorder.file import RecordedMessage
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.market_reader import market_of
from bt_agents_ros.messages import to_time
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning.changes import Delivery, ProfileChange
from feedback_node.learning.feedback_controller import (
    FeedbackController,
    FeedbackRequest,
    RuleOutcome,
)
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger
from feedback_node.management.management import (
    Management,
    ManagementAction,
    ManagementCommand,
    ManagementResult,
)
from feedback_node.node.messages import card_from_msg, feedback_to_msg, run_from_msg, table_to_msg
from journal_fixture import topic_of
from marketplace_node.effects import (
    AnnounceEarlierRun,
    AnnounceRun,
    Collect,
    EarlierRun,
    OpenCall,
    PublishAuction,
    RequestRanking,
    SceneEnded,
    SendGoal,
    StatusChanged,
    StoreOverrides,
)
from marketplace_node.hosts.host_effects import CancelAll, CancelGoal, Effect, RunGoal
from marketplace_node.hosts.registry import Registration
from marketplace_node.interaction.award import RunEnd, StopRequest
from marketplace_node.interaction.stored_scenes import StoreScenes, format_scenes
from marketplace_node.market import Market
from marketplace_node.node.messages import (
    auction_to_msg,
    call_to_msg,
    run_to_msg,
    scene_end_to_msg,
    status_to_msg,
)
from marketplace_node.operator_overrides import OperatorAction, OperatorCommand
from marketplace_node.outcomes import RunEventKind, RunOutcome
from marketplace_node.round.decision import Bids, External
from marketplace_node.settings import ON_NEW_SCENE, Settings
from marketplace_node.strategies import STRATEGIES, TIE_BREAKS

TICK_S = 0.2
"""Time between two ticks of a tree, two heartbeats and two live scenes [s]."""

_DAWN_S = 1_770_000_000.0
_NAN = math.nan
_TREES = Path(__file__).parents[2] / "trees"

_SKILLS = """
format: 1
skills:
  say:
    description: Speak a text.
    main: text
    inputs: {{text: {{type: text, description: what to say}}}}
    outputs: {{answer: {{type: text, description: what is answered}}}}
    action:
      name: say
      type: bt_agents_interfaces/action/Say
      goal: {{text: "{prefix}${{text}}"}}
"""
_LIBRARY = """
format: 1
subtrees:
  greet: {{tree: {{sequence: [{{say: {text}}}, {{wait: 0.3 s}}]}}}}
"""
_MARKET = """
format: 1
rules:
  - {{when: scene.age > {age}, agents: [bert, dora]}}
  - {{when: scene.mood < 2, agents: [anna]}}
"""
_AGENT = """format: 1
agent: {name}
title: {name}
description: d
{head}
profile: {{age: {age}, familiarity: {familiarity}, mood: {mood}}}
{learning}
tunables:
  patience: {{default: 1 s, min: 0 s, max: 9 s, description: d}}
  attempts: {{default: 2, min: 1, max: 5, description: d}}
feedback:
  - {{when: mood.change <= -0.8, for: 0.5 s, give: negative, then: cancel}}
  - {{when: mood.change >= 0.8, for: 0.5 s, give: positive, release: mood.change < 0.2}}
tree:
{tree}
on_cancel: {{say: Good-bye}}
"""
_TREES_OF_AGENTS = (
    '  sequence: [{{say: {text}}}, {{wait: "${{patience}}"}}, {{say: again}}]',
    '  random: [{{say: {text}}}, {{sequence: [{{wait: 1.5 s}}, {{log: "{text}"}}]}}]',
    "  sequence:\n    - subtree: greet\n    - retry: ${{attempts}}\n      check: live.mood > 2",
    "  while: live.mood > 1.5\n  sequence: [{{say: {text}}}, {{wait: 2 s}}]",
)
_LEARNING = (
    "learning: {rate: 0.3}",
    "learning: {rate: 0.4, update: median, window: 3}",
    "learning: {rate: 0.3, update: huber, width: {age: 0.5}, anneal: 0.1}",
    "learning: {rate: 0.5, anneal: 0.05, drift: {age: 1}, layers: [person, place], general: 0.3}",
    "learning: {rate: 0.4, update: median, window: 4, layers: [person], weights: {button: 0.5}}",
    "learning: {rate: 0.2, rates: {age: 0.7}, freeze: [mood], layers: [place]}",
)
_HEADS = ("requires: scene.person", "requires: scene.mood > 1.2", "weights: {age: 2}", "tags: [x]")
_IMPORT = "imports: [libraries/manners.yaml]\n"
_OF_ALL = (ManagementAction.EXPORT, ManagementAction.FORGET)
PERSONS = ("", "", "anna", "otto")
PLACES = ("", "lobby", "gate")


@dataclass(kw_only=True)
class _Goal:
    """Goal of a host that is under way."""

    goal: RunGoal
    epoch: str
    scene: Scene
    run: Run | None = None
    cause: StopCause = StopCause.NOT_STOPPED
    clean_up: bool = True
    stopping: bool = False

    @property
    def agent(self) -> str:
        return self.goal.agent

    @property
    def round(self) -> int:
        return self.goal.round


class _Publisher:
    def __init__(self, publish: Callable[[Any], None]) -> None:
        self.publish = publish


class _HostNode:
    """As much of a node as the card of a host needs."""

    def __init__(self, host: _Host) -> None:
        self._host = host

    def get_fully_qualified_name(self) -> str:
        return self._host.name

    def create_publisher(self, kind: Any, name: str, _profile: Any) -> _Publisher:
        topic = f"/{name}".replace("/~", self._host.name)

        def publish(message: Any) -> None:
            self._host.system.publish(topic, message, latched=(self._host.instance, topic))
            if topic == "/bt_agents/cards":
                self._host.system.post(self._host.name, self._host.system.on_card, message)

        return _Publisher(publish)

    def destroy_publisher(self, _publisher: _Publisher) -> None:
        self._host.system.forget_latched((self._host.instance, "/bt_agents/cards"))


class _Host:
    """One start of a host."""

    def __init__(self, system: OperatedSystem, name: str, folder: Path) -> None:
        self.system = system
        self.name = name
        self.folder = folder
        self.instance = f"i{system.next_number()}"
        trees = read_trees(folder)
        self.watch = FolderWatch(trees)
        self.versions = AgentVersions(trees)
        self.registry = AgentRegistry(trees.scene.space, trees.agents)
        for member in self.registry.members.values():
            member.tunables |= system.tunings.get(member.spec.name, {})
        self.environment = ScriptedEnvironment(
            {"say": [ScriptedReply(after_s=0.5, result={"answer": "kind"})]}, system.clock
        )
        self.cards = HostCardPublisher(
            _HostNode(self), self.instance, self.registry, self.versions
        )
        self.goal: _Goal | None = None
        self.alive = True
        self.epoch = ""
        self.token = b""
        self.unreported: list[tuple[str, _Goal, RunEnd, float]] = []
        self.cards.trees()
        self.cards.files()

    @property
    def running(self) -> str:
        return self.goal.agent if self.goal else ""

    def register(self, market: _MarketStart) -> None:
        if not self.alive or not market.alive:
            return
        names = tuple(self.registry.members)
        answer, effects = market.market.register(
            Registration(
                host=self.name,
                instance=self.instance,
                run_action=f"{self.name}/run",
                heartbeat=f"{self.name}/heartbeat",
                parameters=self.registry.space.names,
                agents=names,
                token=self.token,
            ),
            self.system.now,
        )
        self.token = answer.token
        self.registry.apply_registration(names, answer.agent_ids, answer.reasons)
        self.epoch = market.market.epoch
        market.execute(effects)
        self.cards.set_registered(answer.accepted)
        earlier = [
            EarlierRun(
                epoch=epoch,
                goal=goal.goal,
                outcome=RunOutcome(end.outcome),
                scene=goal.scene,
                message=end.message,
                stop_cause=end.stop_cause,
                ticks=end.ticks,
                duration_s=1.0,
                age_s=self.system.now - at,
            )
            for epoch, goal, end, at in self.unreported
        ]
        self.unreported.clear()
        if earlier:
            market.execute(market.market.unreported(self.name, earlier, self.system.now))

    def answer_call(self, epoch: str, call: OpenCall) -> None:
        if not self.alive or epoch != self.epoch:
            return
        answer = self.registry.bids_for(call.scene, frozenset(call.excluded))
        bids = Bids(
            epoch=epoch,
            round=call.round,
            host=self.name,
            instance=self.instance,
            agents=tuple(answer.bidders.names),
            agent_ids=tuple(answer.bidders.ids),
            vectors=tuple(answer.bidders.vectors),
            weights=tuple(answer.bidders.weights),
            declined=tuple(answer.declined),
            decline_reasons=tuple(one.reason for one in answer.declined.values()),
            unmet=tuple(one.unmet for one in answer.declined.values()),
            token=self.token,
        )
        market = self.system.market
        self.system.post(
            self.name, lambda: market.do(lambda m, now: m.bids(bids, now)), about=market
        )

    def take_goal(self, market: _MarketStart, effect: SendGoal) -> None:
        goal, member = effect.goal, self.registry.members.get(effect.goal.agent)
        fits = self.alive and self.goal is None and goal.instance == self.instance
        if not fits or member is None or member.agent_id != goal.agent_id:
            if self.alive:
                self.system.post(
                    self.name,
                    lambda: market.do(lambda m, now: m.goal_refused(goal, "busy", now)),
                    about=market,
                )
            return
        self.goal = _Goal(goal=goal, epoch=market.market.epoch, scene=effect.scene)
        self.system.post(
            self.name, lambda: market.do(lambda m, now: m.goal_accepted(goal, now)), about=market
        )
        scene = effect.scene
        self.goal.run = Run(
            member.spec,
            space=self.registry.space,
            scene=scene,
            profile=member.profile_for(scene),
            live=lambda: self.system.live(scene),
            tunables=member.tunables,
            environment=self.environment,
            steady=self.system.clock,
            random=Random(self.system.random.randrange(2**53)),
        )
        self._tick(self.goal)

    def cancel(self, goal: RunGoal | None, cause: StopCause, *, clean_up: bool = True) -> None:
        """Stop the run of a goal; None stops whatever runs."""
        own = self.goal
        if not self.alive or own is None or own.run is None or goal not in (None, own.goal):
            return
        if own.cause is StopCause.NOT_STOPPED:
            own.cause, own.clean_up, own.stopping = cause, clean_up, True
        elif own.clean_up and not clean_up:
            own.clean_up, own.stopping = False, True
        self._tick(own)

    def beat(self) -> None:
        """Tick, send a heartbeat, notice a market that is gone."""
        if not self.alive:
            return
        goal, market = self.goal, self.system.market
        if goal is not None:
            self._tick(goal)
        if goal is not None and goal.epoch != market.market.epoch:
            self.cancel(None, StopCause.MARKET_LOST, clean_up=False)
        if self.epoch != market.market.epoch and market.alive:
            self.register(market)
        named = (self.goal.epoch, self.goal.round) if self.goal else ("", 0)
        self.system.post(
            self.name,
            lambda: market.do(lambda m, now: m.heartbeat(self.name, self.instance, *named, now)),
            about=market,
        )

    def stop(self, *, kill: bool) -> None:
        """End this start, after its run unless it is killed."""
        goal = self.goal
        if not kill and goal is not None and goal.run is not None:
            self.cancel(None, StopCause.BY_HOST, clean_up=False)
            for _ in range(200):
                if self.goal is None:
                    break
                self.system.clock.advance(0.1)
                self._tick(goal)
        self.alive = False
        self.system.forget_latched((self.instance, ""))

    def set_profile(self, delivery: Delivery) -> None:
        if not self.alive:
            return
        try:
            if delivery.remove:
                self.registry.remove_layer(delivery.agent, delivery.layer)
            else:
                self.registry.set_profile(
                    delivery.agent, delivery.values, delivery.revision, delivery.layer
                )
                if not delivery.layer:
                    self.cards.card()
        except Refused:
            pass

    def reload(self) -> None:
        trees = self.watch.poll(settle=False)
        if trees is None or not self.alive:
            return
        effects = [
            self.versions.settle(name, self.running) for name in self.versions.update(trees)
        ]
        self._apply([effect for effect in effects if effect is not None])

    def tune(self, name: str, **values: Any) -> None:
        member = self.registry.members.get(name)
        if member is None:
            return
        if "rate" in values:
            member.learning_rate = values.pop("rate")
        member.tunables |= values
        self.system.tunings.setdefault(name, {}).update(values)
        self.cards.card()

    def _apply(self, effects: list[ReloadEffect]) -> None:
        for effect in effects:
            name, agent = effect.name, effect.agent
            if effect.action is ReloadAction.REMOVE:
                self.registry.remove(name)
            elif effect.action is ReloadAction.ADD and agent is not None:
                self.registry.add(agent)
            elif agent is not None:
                member = self.registry.members[name]
                if effect.action is ReloadAction.REPLACE_TREE:
                    member.tunables = dict(member.tunables)
                before, member.spec = member.spec, agent
                if before.profile != agent.profile and not member.revision:
                    member.profile = agent.profile
                member.learning_rate = agent.learning_rate
        if {effect.action for effect in effects} & {ReloadAction.ADD, ReloadAction.REMOVE}:
            self.register(self.system.market)
        self.cards.files()
        self.cards.card()

    def _tick(self, goal: _Goal) -> None:
        run = goal.run
        if run is None or run.result is not None or not self.alive:
            return
        changes = []
        if goal.stopping:
            goal.stopping = False
            changes = run.cancel("it is stopped", clean_up=goal.clean_up)
        self._report(goal, [*changes, *run.tick()])
        result = run.result
        if result is None:
            return
        self.goal = None
        stopped = result.outcome is TreeOutcome.CANCELLED
        end = RunEnd(
            outcome=int(RunOutcome[result.outcome.name]),
            message=result.message,
            stop_cause=goal.cause if stopped else StopCause.NOT_STOPPED,
            orphans=tuple(result.orphans),
            ticks=result.ticks,
        )
        market = self.system.market
        if goal.epoch == market.market.epoch and market.alive:
            self.system.post(
                self.name,
                lambda: market.do(lambda m, now: m.run_ended(goal.goal, end, now)),
                about=market,
            )
        else:
            self.unreported.append((goal.epoch, goal, end, self.system.now))
            self.epoch = ""
        effect = self.versions.run_ended(goal.agent)
        if effect is not None:
            self._apply([effect])

    def _report(self, goal: _Goal, changes: Any) -> None:
        assert goal.run is not None
        where = SimpleNamespace(epoch=goal.epoch, round=goal.round, agent=goal.agent)
        if changes:
            status = tree_status(
                to_time(self.system.wall), where, self.instance, goal.run, changes
            )
            self.system.publish(f"{self.name}/status", status)
            self.system.post(self.name, self.system.on_leaf, goal, goal.run.tip)


class _MarketStart:
    """One start of the market."""

    def __init__(self, system: OperatedSystem, orders: str = "", scenes: str = "") -> None:
        self.system = system
        self.alive = True
        epoch = f"e{system.next_number()}"
        rules = market_of(system.folder, system.space)
        self.market = Market(system.space, epoch, system.settings, rules, secret=b"")
        self.orders = orders
        self.scenes = scenes
        self.execute(self.market.tick(system.now))
        if orders:
            self.execute(self.market.restore_overrides(orders, system.now)[1])
        if scenes:
            self.execute(self.market.restore_scenes(scenes, 1.0, system.now)[1])

    def do(self, event: Callable[[Market, float], list[Effect]]) -> None:
        if self.alive:
            self.execute(event(self.market, self.system.now))

    def execute(self, effects: list[Effect]) -> None:
        waiting = deque(effects)
        while waiting:
            effect = waiting.popleft()
            waiting += self._execute(effect)

    def _execute(self, effect: Effect) -> list[Effect]:
        system, epoch, stamp = self.system, self.market.epoch, to_time(self.system.wall)
        match effect:
            case OpenCall():
                system.publish("/bt_agents/calls", call_to_msg(effect, epoch, system.space, stamp))
                for host in system.hosts.values():
                    system.post("market", host.answer_call, epoch, effect)
                return self.market.called(effect.round, system.now)
            case RequestRanking():
                ranking = list(effect.agents)
                system.random.shuffle(ranking)
                external = External(ranking=tuple(ranking[: system.random.randint(1, 3)]))
                if system.random.random() < 0.2:
                    external = External(failure="it is away")
                system.post(
                    "selector",
                    lambda: self.do(lambda m, now: m.ranked(effect.round, external, now)),
                )
            case PublishAuction():
                system.publish("/bt_agents/auctions", auction_to_msg(effect, stamp))
            case SendGoal():
                system.post("market", system.hosts[effect.goal.host].take_goal, self, effect)
            case CancelGoal():
                host = system.hosts[effect.goal.host]
                system.post(
                    "market", lambda: host.cancel(effect.goal, StopCause.BY_MARKET), about=host
                )
            case CancelAll():
                host = system.hosts[effect.host]
                system.post("market", lambda: host.cancel(None, StopCause.BY_MARKET), about=host)
            case AnnounceEarlierRun():
                self._announce(run_to_msg(effect.run, effect.run.epoch, stamp))
            case AnnounceRun():
                self._announce(run_to_msg(effect, epoch, stamp))
            case Collect():
                system.post("market", system.collect, self, effect)
            case StatusChanged():
                system.publish(
                    "/bt_agents/market",
                    status_to_msg(effect, epoch, stamp),
                    latched=(epoch, "/bt_agents/market"),
                )
            case SceneEnded():
                system.publish("/bt_agents/scene_ends", scene_end_to_msg(effect, epoch, stamp))
            case StoreOverrides():
                self.orders = effect.text
            case StoreScenes():
                self.scenes = format_scenes(effect)
        return []

    def _announce(self, message: Any) -> None:
        self.system.publish("/bt_agents/runs", message)
        self.system.run_events.append(message)
        self.system.post("market", self.system.on_run, message)


class OperatedSystem:
    """Market, two hosts, feedback and a journal; events come in the order of a manual clock.

    What one part sends to another takes some milliseconds, and keeps its order.

    Args:
        path: For the folders.
        seed: Of all that is left to chance.

    Attributes:
        done: How often the operator did what.
    """

    def __init__(self, path: Path, seed: int) -> None:
        self.random = Random(seed)
        self.clock = ManualClock()
        self.folder = path / "trees"
        self.journal_folder = path / "journal"
        self.settings = Settings(strategy="manhattan")
        self.tunings: dict[str, dict[str, Any]] = {}
        self.done: Counter[str] = Counter()
        self.run_events: deque[Any] = deque(maxlen=50)
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._channels: dict[tuple[str, str], float] = {}
        self._latched: dict[tuple[str, str], RecordedMessage] = {}
        self._topics: dict[tuple[type, str], Any] = {}
        self._numbers = 0
        self._ns = 0
        self._mood = 3.0
        self._live_until = 0.0
        self._documents: list[str] = []
        self._given: list[str] = []
        self._write_folders(path)
        self.space: SceneSpace = read_trees(self.folder).scene.space
        self._recorder: DailyRecorder | None = None
        self.start_journal()
        self.ledger = Ledger(":memory:", wall=lambda: self.wall)
        self.start_feedback()
        self.market = _MarketStart(self, "")
        self.hosts = {
            "/agents": _Host(self, "/agents", self.folder),
            "/extra": _Host(self, "/extra", path / "extra"),
        }

    @property
    def now(self) -> float:
        return self.clock()

    @property
    def profiles(self) -> dict[str, tuple[float, ...]]:
        """Profile of each agent for everybody, as it is in force."""
        return {name: profile for name, layer, _, profile in self._profiles.table() if not layer}

    @property
    def wall(self) -> float:
        return _DAWN_S + self.clock()

    def next_number(self) -> int:
        self._numbers += 1
        return self._numbers

    def post(
        self, sender: str, receive: Callable[..., None], *what: Any, about: Any = None
    ) -> None:
        """Have something received in a few milliseconds, after what was sent before it."""
        channel = (sender, type(about).__name__ if about else getattr(receive, "__qualname__", ""))
        due = max(self.now + self.random.uniform(0.0005, 0.02), self._channels.get(channel, 0.0))
        self._channels[channel] = due
        self._at(due, lambda: receive(*what))

    def publish(self, topic: str, message: Any, latched: tuple[str, str] | None = None) -> None:
        self._ns = max(self._ns + 1, int(self.wall * 1e9))
        key = (type(message), topic)
        if key not in self._topics:
            self._topics[key] = topic_of(type(message), topic)
        recorded = RecordedMessage(
            topic=self._topics[key],
            data=serialize_message(message),
            sent_ns=self._ns,
            received_ns=self._ns,
        )
        if latched is not None:
            self._latched[latched] = recorded
        self._record(recorded)

    def forget_latched(self, key: tuple[str, str]) -> None:
        """Forget what a publisher has latched; without a topic what its process has."""
        for one in [k for k in self._latched if k == key or (k[0] == key[0] and not key[1])]:
            del self._latched[one]

    def run_for(self, seconds: float) -> None:
        """Let the operator use the system for so long, then let it come to rest [s]."""
        self._at(self.now, self._pulse)
        self._at(self.now + 1.0, self._operate)
        end = self.now + seconds
        while self.now < end:
            at, _, event = heapq.heappop(self._events)
            self.clock.advance(max(0.0, at - self.now))
            event()
        for host in self.hosts.values():
            host.stop(kill=False)
        assert self._recorder is not None
        self._recorder.close()

    # Parts

    def start_journal(self) -> None:
        """Start the journal, anew if there is one: a new file, which latched messages begin."""
        if self._recorder is not None:
            self._recorder.close()
        self._recorder = DailyRecorder(
            self.journal_folder,
            days=0,
            today=lambda: date(2026, 2, 2),
            report=lambda text, _error: print(text),
        )
        for message in sorted(self._latched.values(), key=lambda one: one.sent_ns):
            self._record(message)

    def start_feedback(self) -> None:
        self._profiles = Profiles(self.space, self.ledger)
        self._controller = FeedbackController(
            self._profiles, clock=self.clock, new_id=lambda: f"given/{self.next_number()}"
        )
        self._management = Management(
            self._profiles,
            self.ledger,
            wall=lambda: self.wall,
            new_id=lambda: f"document-{self.next_number()}",
        )
        self._table: Any = ()

    def restart_feedback(self) -> None:
        self.start_feedback()
        for host in self.hosts.values():
            if host.alive:
                host.cards.card()
        for message in self.run_events:
            self._controller_run(message, replayed=True)

    def restart_market(self, *, kill: bool) -> None:
        market = self.market
        if not kill:
            market.do(lambda m, now: m.shut_down("the marketplace is shutting down", now))
        self.forget_latched((market.market.epoch, ""))
        market.alive = False
        self.market = _MarketStart(self, market.orders, market.scenes)

    def restart_host(self, name: str, *, kill: bool) -> None:
        host = self.hosts[name]
        host.stop(kill=kill)
        # With broken skills none would start.
        self._write_skills(host.folder)
        self.hosts[name] = _Host(self, name, host.folder)

    # Messages

    def on_card(self, message: Any) -> None:
        deliveries, _ = self._controller.register_card(card_from_msg(message, self.space))
        self._deliver(deliveries)
        self._publish_table()

    def on_run(self, message: Any) -> None:
        self._controller_run(message)

    def on_leaf(self, goal: _Goal, tip: str) -> None:
        self._controller.on_leaf((goal.epoch, goal.round, goal.agent), tip)

    def collect(self, market: _MarketStart, effect: Collect) -> None:
        goal = effect.goal
        run = AnnouncedRun(
            epoch=market.market.epoch, round=goal.round, agent=goal.agent, scene=effect.scene
        )
        with contextlib.suppress(Refused):
            self._controller.collect(run)
        self.post("feedback", lambda: market.do(lambda m, now: m.collected(goal.round, "", now)))

    def live(self, scene: Scene) -> Scene:
        """Return a scene as it is now."""
        values = tuple(
            SceneValue(name="mood", value=self._mood, origin=Origin.MEASURED, source="mood")
            if value.name == "mood"
            else value
            for value in scene.values
        )
        return replace(scene, values=values, stamp=self.wall)

    def _controller_run(self, message: Any, *, replayed: bool = False) -> None:
        event = run_from_msg(message, self.space)
        if message.event == RunEventKind.STARTED:
            self._controller.on_run_started(event, replayed=replayed)
        elif message.event == RunEventKind.CANCELLING:
            self._controller.on_run_cancelling(event)
        elif message.event == RunEventKind.ENDED:
            self._controller.on_run_ended(event)

    def _pulse(self) -> None:
        for host in list(self.hosts.values()):
            host.beat()
        self._mood = min(5.0, max(1.0, self._mood + self.random.uniform(-0.5, 0.5)))
        goal = next((host.goal for host in self.hosts.values() if host.goal), None)
        outcomes: Iterable[RuleOutcome] = self._controller.tick()
        if goal is not None and self.now >= self._live_until:
            outcomes = (*outcomes, *self._controller.receive(self.live(goal.scene)))
        self._outcomes(outcomes)
        self.market.do(lambda m, now: m.tick(now))
        self._at(self.now + TICK_S, self._pulse)

    def _outcomes(self, outcomes: Iterable[RuleOutcome]) -> None:
        for outcome in outcomes:
            if outcome.change is not None:
                self._changed((outcome.change,))
            if outcome.stop is not None:
                self.done["mood rule stops"] += 1
                stop = outcome.stop
                request = StopRequest(reason=stop.reason, again=True, scene=stop.live)
                market = self.market

                def cancel(
                    market: _MarketStart = market, stop: Any = stop, request: Any = request
                ) -> None:
                    market.do(
                        lambda m, now: m.cancel(stop.run.epoch, stop.run.round, request, now)[2]
                    )

                self.post("feedback", cancel)

    def _changed(self, changes: Iterable[ProfileChange]) -> None:
        for change in changes:
            if change.fresh:
                for one in change.all:
                    self.publish("/bt_agents/feedback", feedback_to_msg(one, self.space))
            self._deliver(self._profiles.deliveries(change.all))
        self._publish_table()

    def _deliver(self, deliveries: Iterable[Delivery]) -> None:
        for delivery in deliveries:
            host = self.hosts[delivery.host]
            self.post("feedback", lambda h=host, d=delivery: h.set_profile(d), about=host)

    def _publish_table(self) -> None:
        table = self._profiles.table()
        if table != self._table:
            self._table = table
            self.publish(
                "/bt_agents/profiles",
                table_to_msg(table, (), (), self.space),
                latched=("feedback", "/bt_agents/profiles"),
            )

    def _record(self, message: RecordedMessage) -> None:
        if self._recorder is not None:
            facts = ("files", "cards", "profiles", "market")
            name = message.topic.name
            fact = name if name.rpartition("/")[2] in facts else ""
            if name == "/bt_agents/cards":
                fact = f"{name} {message.sent_ns}"
            self._recorder.record(message, fact=fact)

    def _at(self, due: float, event: Callable[[], None]) -> None:
        heapq.heappush(self._events, (due, self.next_number(), event))

    # The operator

    def _operate(self) -> None:
        actions: dict[Callable[[], None], int] = {
            self._scene: 12,
            self._feedback: 8,
            self._manage: 6,
            self._command: 5,
            self._preview: 1,
            self._cancel: 2,
            self._configure: 3,
            self._tune: 3,
            self._preset: 1,
            self._edit: 6,
            self._restart: 2,
        }
        action = self.random.choices(list(actions), list(actions.values()))[0]
        self.done[action.__name__.strip("_")] += 1
        action()
        self._at(self.now + self.random.uniform(0.05, 2.0), self._operate)

    def _random_scene(self) -> Scene:
        random = self.random
        values = []
        for name in self.space.names:
            origin = random.choice([Origin.GIVEN, Origin.MEASURED, Origin.DEFAULT])
            value = random.choice([random.uniform(1, 5), float(random.randint(1, 5))])
            values.append(
                SceneValue.missing(name)
                if random.random() < 0.1
                else SceneValue(name=name, value=value, origin=origin)
            )
        number = self.next_number()
        return Scene(
            scene_id=f"s{number}",
            label=random.choice(["", f"visitor {number}"]),
            person=random.random() < 0.9,
            person_id=random.choice(PERSONS),
            place=random.choice(PLACES),
            values=tuple(values),
            urgent=random.random() < 0.1,
            stamp=self.wall,
        )

    def _scene(self) -> None:
        scene = self._random_scene()
        self.market.do(lambda m, now: m.scene(scene, now))

    def _agent(self) -> str:
        return self.random.choice(["anna", "bert", "carl", "dora", "emil"])

    def _feedback(self) -> None:
        random = self.random
        kind = random.choice(list(FeedbackKind))
        named = kind in (FeedbackKind.DIRECT, FeedbackKind.SET)
        values = tuple(
            random.uniform(1, 5) if random.random() < 0.8 else _NAN for _ in self.space.names
        )
        feedback_id = f"button/{self.next_number()}"
        if self._given and random.random() < 0.1:
            feedback_id = random.choice(self._given)
        try:
            change = self._controller.give(
                FeedbackRequest(
                    feedback_id=feedback_id,
                    agent=random.choice([self._agent(), ""]),
                    kind=int(kind),
                    values=values if named else (),
                    source=random.choice([BUTTON, "test"]),
                    scene=self._random_scene() if random.random() < 0.4 else None,
                )
            )
        except Refused:
            return
        self._given.append(feedback_id)
        self._changed((change,))

    def _manage(self) -> None:
        random = self.random
        action = random.choice(
            [
                *[ManagementAction.UNDO] * 4,
                *[ManagementAction.RESET] * 2,
                ManagementAction.EXPORT,
                *[ManagementAction.IMPORT] * 2,
                ManagementAction.EXPIRE,
                *[ManagementAction.FORGET] * 2,
            ]
        )
        layers = sorted({layer for _, layer, _, _ in self._profiles.table()})
        layer = random.choice(["", *layers])
        document = ""
        if action is ManagementAction.IMPORT:
            document = random.choice(self._documents) if self._documents else ""
        try:
            done: ManagementResult = self._management.execute(
                ManagementCommand(
                    action=action,
                    agent="" if action in _OF_ALL else self._agent(),
                    layer="" if action is ManagementAction.EXPIRE else layer,
                    author="operator",
                    older_s=200.0,
                    document=document,
                )
            )
        except Refused as refused:
            self.done[f"{action.name} {refused.code}"] += 1
            return
        self.done[action.name] += 1
        if action is ManagementAction.EXPORT:
            data = json.loads(done.document)
            self._documents.append(json.dumps(data))
        self._changed(done.changes)
        self._deliver(done.deliveries)

    def _command(self) -> None:
        action = self.random.choice(
            [*OperatorAction, OperatorAction.UNPIN, OperatorAction.ALLOW, OperatorAction.AWARD]
        )
        scene = None
        if action is OperatorAction.AWARD and self.random.random() < 0.5:
            scene = self._random_scene()
        command = OperatorCommand(
            action=action, agent=self._agent(), author="operator", scene=scene
        )
        try:
            _, effects = self.market.market.operate(command, self.now)
        except Refused:
            return
        self.done[action.name] += 1
        self.market.execute(effects)

    def _preview(self) -> None:
        scene = self._random_scene()
        try:
            _, effects = self.market.market.preview(scene, "", self.now)
        except Refused:
            return
        self.market.execute(effects)

    def _cancel(self) -> None:
        stop = StopRequest(reason="the operator wants it", again=self.random.random() < 0.4)
        self.market.do(lambda m, now: m.cancel("", 0, stop, now)[2])

    def _configure(self) -> None:
        random = self.random
        strategies = sorted(STRATEGIES)
        strategy = random.choice(strategies)
        shadows = ["", *(one for one in strategies if one not in (strategy, "external"))]
        self.settings = Settings(
            strategy=strategy,
            shadow_strategy=random.choice(shadows),
            options={"softmax.temperature": random.choice([0.3, 1.0])},
            tie_break=random.choice(TIE_BREAKS),
            on_new_scene=random.choice([*ON_NEW_SCENE, "preempt", "preempt"]),
            preempt_cooldown_s=random.choice([0.0, 5.0]),
        )
        self.market.do(lambda m, now: m.configure(self.settings, now))

    def _tune(self) -> None:
        host = self.random.choice(list(self.hosts.values()))
        host.tune(
            self._agent(),
            **self.random.choice(
                [
                    {"patience": self.random.uniform(0.0, 3.0)},
                    {"attempts": self.random.randint(1, 5)},
                    {"rate": self.random.uniform(0.05, 0.9)},
                ]
            ),
        )

    def _preset(self) -> None:
        for host in self.hosts.values():
            for name in host.registry.members:
                host.tune(name, patience=0.5, attempts=1)

    def _edit(self) -> None:
        random = self.random
        host = random.choice(list(self.hosts.values()))
        what = random.choice(
            [
                "text",
                "text",
                "profile",
                "file",
                "broken",
                "gone",
                "library",
                "skills",
                "broken skills",
                "market",
            ]
        )
        name = random.choice(self._names(host.folder))
        file = host.folder / "agents" / f"{name}.yaml"
        match what:
            case "text" | "file":
                self._write_agent(host.folder, name)
            case "profile" if file.exists():
                lines = file.read_text().splitlines()
                new = f"profile: {{age: {random.uniform(1, 5):.2f}, familiarity: 3, mood: 3}}"
                file.write_text(
                    "\n".join(new if x.startswith("profile:") else x for x in lines) + "\n"
                )
            case "broken":
                file.write_text("format: 1\nagent: {name}\nbroken: [\n")
            case "gone":
                file.unlink(missing_ok=True)
            case "library":
                self._write_library(host.folder)
            case "skills":
                self._write_skills(host.folder)
            case "broken skills":
                (host.folder / "skills" / "voice.yaml").write_text("format: [")
            case "market" if (host.folder / "market.yaml").exists():
                self._write_market(host.folder)
        self.done[f"edit {what}"] += 1
        host.reload()

    def _restart(self) -> None:
        random, kill = self.random, self.random.random() < 0.5
        parts = random.sample(["host", "market", "feedback", "scene layer", "journal"], 5)
        part = min(parts, key=lambda one: self.done[f"restart of {one}"])
        self.done[f"restart of {part}"] += 1
        match part:
            case "host":
                self.restart_host(random.choice(list(self.hosts)), kill=kill)
            case "market":
                self.restart_market(kill=kill)
            case "feedback":
                self.restart_feedback()
            case "scene layer":
                self._live_until = self.now + 2.0
            case "journal":
                self.start_journal()

    # Files

    def _write_folders(self, path: Path) -> None:
        for folder in (self.folder, path / "extra"):
            for part in ("skills", "agents", "libraries"):
                (folder / part).mkdir(parents=True)
            shutil.copy(_TREES / "scene.yaml", folder)
            self._write_skills(folder)
            self._write_library(folder)
            for name in self._names(folder):
                self._write_agent(folder, name)
        self._write_market(self.folder)

    def _names(self, folder: Path) -> list[str]:
        return ["anna", "bert", "carl"] if folder == self.folder else ["dora", "emil"]

    def _write_agent(self, folder: Path, name: str) -> None:
        random = self.random
        tree = random.choice(_TREES_OF_AGENTS).format(text=f"text {self.next_number()}")
        head = random.choice(_HEADS)
        text = _AGENT.format(
            name=name,
            head=head + "\n" + (_IMPORT if "manners" in tree else ""),
            learning=random.choice(_LEARNING),
            tree=tree,
            age=random.randint(1, 5),
            familiarity=random.randint(1, 5),
            mood=3,
        )
        (folder / "agents" / f"{name}.yaml").write_text(text)

    def _write_library(self, folder: Path) -> None:
        text = _LIBRARY.format(text=f"Good day {self.next_number()}")
        (folder / "libraries" / "manners.yaml").write_text(text)

    def _write_skills(self, folder: Path) -> None:
        text = _SKILLS.format(prefix=self.random.choice(["", "well, "]))
        (folder / "skills" / "voice.yaml").write_text(text)

    def _write_market(self, folder: Path) -> None:
        (folder / "market.yaml").write_text(_MARKET.format(age=self.random.randint(2, 4)))
