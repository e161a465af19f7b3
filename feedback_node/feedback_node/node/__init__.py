# SPDX-License-Identifier: Apache-2.0
"""Feedback node on ROS: messages in, changes of profiles out; the decisions are pure code."""

from __future__ import annotations

import math
import os
import time
import uuid
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.subscription import Subscription
from rclpy.task import Future

from bt_agents_core.errors import Refused
from bt_agents_core.health import PartHealth
from bt_agents_core.log_budget import LogBudget
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.run_key import RunKey
from bt_agents_core.scene import SceneSpace
from bt_agents_core.state_folder import claim_state
from bt_agents_core.trees_folder import find_trees
from bt_agents_interfaces.msg import Feedback, HostCard, MoodTrace, TreeStatus
from bt_agents_interfaces.msg import Profiles as ProfilesMsg
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import CollectFeedback, GiveFeedback, ManageProfiles
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros import qos
from bt_agents_ros.calls import Calls
from bt_agents_ros.health_publisher import HealthPublisher
from bt_agents_ros.managed_node import ManagedNode, make_managed
from bt_agents_ros.messages import answering, scene_from_msg
from bt_agents_ros.parameters import TREES, StartParameter, declare_live_lease
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import OneShot, steady_timer
from feedback_node.health import ledger_health, profiles_health
from feedback_node.learning.feedback_controller import FeedbackController, RuleOutcome
from feedback_node.learning.profiles import ProfileChange, Profiles, Table
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import LedgerError
from feedback_node.management.management import Management, ManagementCommand
from feedback_node.mood_trace import RunValues
from feedback_node.node.cancel_requests import CancelRequests
from feedback_node.node.hosts import ProfileDeliveries
from feedback_node.node.messages import (
    card_from_msg,
    collected_from_msg,
    feedback_to_msg,
    given_from_msg,
    mood_trace_to_msg,
    run_from_msg,
    table_to_msg,
    taught_text,
)
from feedback_node.simulated_feedback import SimulatedFeedback

CARDS_S = 10.0
"""After its start, the node waits this long for the card of a requested agent [s]."""

_REST_S = 0.025
"""Shortest time between two evaluations of live scenes [s]."""

_TIDY_S = 1.0
_LINGER_S = 0.2
"""Wait for the news of a run that has just started when the node stops [s]."""

_MOST_PROBLEMS = 100
"""Most hosts with remembered problems, and most problem lines in :data:`_PROBLEMS_S`."""

_PROBLEMS_S = 5.0

ResultT = TypeVar("ResultT")


_START = (
    TREES,
    StartParameter(
        name="ledger",
        description="SQLite file of all learned profiles; empty: the file in the state folder of "
        "the trees folder, as for 'bt-agents up'; ':memory:', in quotes, keeps nothing",
    ),
    StartParameter(
        name="simulated_feedback",
        description="YAML file with feedback for experiments; empty: none",
    ),
)


@dataclass(frozen=True, kw_only=True)
class FeedbackConfiguration:
    """Inputs of a feedback node.

    Attributes:
        space: The scene parameters of the system.
        ledger: Opens the ledger, which stays open while the node is active.
        simulated: Feedback from the files of an experiment; None for none.
        note: Logged at each activation; empty for nothing.
    """

    space: SceneSpace
    ledger: Callable[[], AbstractContextManager[Ledger]]
    simulated: SimulatedFeedback | None = None
    note: str = ""


class FeedbackNode(ManagedNode[FeedbackConfiguration]):
    """Learns from moods, people and prepared lists, and delivers profiles to the hosts."""

    node_name = "feedback"
    start_parameters = _START
    stop_limit_s = 2.6
    """Longest wait for the market to ask for feedback on the last run [s]."""

    def configure(self, values: Mapping[str, str]) -> FeedbackConfiguration:
        trees = find_trees(values["trees"])
        space = read_scene(trees / "scene.yaml").space
        file = values["simulated_feedback"]
        simulated = None
        if file:
            simulated = SimulatedFeedback(read_experiment(Path(file), space).feedback)
        kept = None if values["ledger"] else claim_state(trees)
        path = kept.ledger if kept else os.path.expanduser(values["ledger"])
        return FeedbackConfiguration(
            space=space,
            ledger=lambda: Ledger(path),
            simulated=simulated,
            note=kept.note if kept else "",
        )

    def activate(self, configuration: FeedbackConfiguration, closing: ExitStack) -> None:
        """Open the ledger and create the learning parts.

        Raises:
            LedgerError: The ledger cannot be used.
        """
        ledger = closing.enter_context(configuration.ledger())
        space = configuration.space
        self._space = space
        self._ledger = ledger
        self._untidy = True
        self._stopping = False
        self._stop_earliest = 0.0
        self._answering = 0
        self._profiles = Profiles(space, ledger, lambda host: self._hosts.is_there(host))
        self._controller = FeedbackController(
            self._profiles,
            clock=time.monotonic,
            new_id=lambda: f"given/{uuid.uuid4()}",
            simulated=configuration.simulated,
            lease_s=declare_live_lease(self, lambda s: self._controller.set_lease(s)),
        )
        self._born_ns = time.time_ns()
        self._cards_until = time.monotonic() + CARDS_S
        self._card_awaited: list[Future] = []
        self._calls = Calls(self)
        self._hosts = ProfileDeliveries(self, self._calls, self._profiles, self._publish_table)
        self._trees: dict[str, Subscription[TreeStatus]] = {}
        self._run_values = RunValues()
        self._problems: dict[str, tuple[str, ...]] = {}
        self._budget = LogBudget(_MOST_PROBLEMS, _PROBLEMS_S, time.monotonic)
        self._pending_cards: dict[str, HostCard] = {}
        self._published: tuple[Table, Sequence[tuple[str, str]], Sequence[str]] = ((), (), ())
        self._live: SceneMsg | None = None
        self._polled_at = -math.inf
        self._stops = CancelRequests(self, self._calls, self._controller.is_running)
        self._create_history_publishers()
        self._current = self.create_publisher(ProfilesMsg, "bt_agents/profiles", qos.FACT)
        self._health = HealthPublisher(self, self._judge)
        self._timer = OneShot(self, self._poll)
        steady_timer(self, _TIDY_S, self._on_idle)
        self.create_subscription(HostCard, "bt_agents/cards", self._on_card, qos.FACTS)
        self.create_subscription(RunMsg, "bt_agents/runs", self._on_run, qos.HISTORY)
        self.create_subscription(SceneMsg, "bt_agents/scene/live", self._on_live, qos.SENSOR)
        self._management = Management(
            self._profiles, ledger, wall=time.time, new_id=lambda: str(uuid.uuid4())
        )
        # The callbacks await answers of other nodes, which the default group would block.
        group = ReentrantCallbackGroup()
        for kind, name, answer in (
            (CollectFeedback, "~/collect", self._on_collect),
            (GiveFeedback, "~/give", self._on_give),
        ):
            self.create_service(kind, name, answer, qos_profile=qos.SERVICE, callback_group=group)
        self.create_service(ManageProfiles, "~/manage", self._on_manage, qos_profile=qos.SERVICE)
        self.get_logger().info(f"the ledger is {ledger.path}")
        if configuration.note:
            self.get_logger().warning(configuration.note)

    def _judge(self) -> tuple[PartHealth, ...]:
        return (
            ledger_health(str(self._ledger.path), self._ledger.failure),
            profiles_health(len(self._profiles.hosts), self._profiles.differing),
        )

    def begin_stop(self) -> None:
        """Stop waiting for hosts; the market may still ask for feedback on the last run."""
        self._stopping = True
        self._stop_earliest = time.monotonic() + _LINGER_S

    def has_stopped(self) -> bool:
        """Return True when no request is in progress and the market will not send one."""
        lingers = time.monotonic() < self._stop_earliest
        return not (lingers or self._answering or self._controller.collecting)

    # Events around runs

    def _on_card(self, message: HostCard) -> None:
        self._pending_cards.pop(message.host, None)
        try:
            card = card_from_msg(message, self._space)
            deliveries, problems = self._controller.register_card(card)
        except Refused as refusal:
            if isinstance(refusal, LedgerError):
                self._health.update()
                if len(self._pending_cards) < _MOST_PROBLEMS:
                    # Its agents cannot learn before the ledger has recorded them.
                    self._pending_cards[message.host] = message
            self._log_problems(message.host, (str(refusal),))
            return
        self._log_problems(message.host, problems)
        for delivery in deliveries:
            self._hosts.deliver(delivery)
        self._subscribe_to_trees(self._profiles.hosts)
        self._publish_table()
        self._health.update()
        self._set_timer()
        self._resume_waiting()

    def _log_problems(self, host: str, problems: tuple[str, ...]) -> None:
        """Log the problems of a host's card, unless its last card had the same ones."""
        if problems != self._problems.pop(host, ()):
            for problem in problems:
                if line := self._budget.line(problem):
                    self.get_logger().error(line)
        self._problems[host] = problems
        if len(self._problems) > _MOST_PROBLEMS:
            del self._problems[next(iter(self._problems))]

    def _on_run(self, message: RunMsg, info: dict[str, int]) -> None:
        try:
            event = run_from_msg(message, self._space)
        except Refused as refusal:
            if line := self._budget.line(f"event of a run refused: {refusal}"):
                self.get_logger().warning(line)
            return
        replayed = info["source_timestamp"] < self._born_ns
        if message.event == RunMsg.STARTED:
            self._controller.on_run_started(event, replayed=replayed)
        elif message.event == RunMsg.CANCELLING:
            self._controller.on_run_cancelling(event)
        elif message.event == RunMsg.ENDED:
            collects = message.outcome != RunMsg.LOST and not replayed
            leaves = self._controller.on_run_ended(event, collects=collects)
            if leaves:
                values = self._run_values.of(event.key)
                self._traces.publish(
                    mood_trace_to_msg(event, leaves, values, message.header.stamp)
                )
        self._publish_undecided()
        self._set_timer()

    def _subscribe_to_trees(self, hosts: Collection[str]) -> None:
        for host in self._trees.keys() - set(hosts):
            self.destroy_subscription(self._trees.pop(host))
        for host in sorted(set(hosts) - self._trees.keys()):
            self._trees[host] = self.create_subscription(
                TreeStatus, f"{host}/status", self._on_status, qos.EVENTS
            )

    def _on_status(self, message: TreeStatus) -> None:
        run = RunKey.of(message)
        self._controller.on_leaf(run, message.tip)
        for change in message.changes:
            for one in change.values:
                self._run_values.change(run, change.path, one.name, one.value)

    def _on_live(self, message: SceneMsg) -> None:
        if not self._controller.wants(message.scene_id):
            return
        self._live = message
        if time.monotonic() >= self._polled_at + _REST_S:
            self._poll()
        else:
            self._set_timer()

    def _poll(self) -> None:
        """Evaluate the rules on the newest live scene, or on the passed time."""
        message, self._live, self._polled_at = self._live, None, time.monotonic()
        try:
            live = None if message is None else scene_from_msg(message, self._space)
        except Refused as refusal:
            self.get_logger().warning(f"live scene refused: {refusal}", throttle_duration_sec=5.0)
            live = None
        self._execute(self._controller.tick() if live is None else self._controller.receive(live))

    def _on_idle(self) -> None:
        for card in list(self._pending_cards.values()):
            self._on_card(card)
        self._hosts.retry()
        self._execute(self._controller.retry())
        self._resume_waiting()
        self._stops.retry()
        if self._untidy and not self._controller.watching:
            self._untidy = not self._ledger.checkpoint()
        self._health.update()

    def _execute(self, outcomes: Iterable[RuleOutcome]) -> None:
        for outcome in outcomes:
            if outcome.problem:
                self.get_logger().error(outcome.problem)
            if outcome.change is not None:
                self._publish_change(outcome.change)
                for delivery in self._profiles.deliveries(outcome.change.all):
                    self._hosts.deliver(delivery)
            if outcome.stop is not None:
                self._stops.request(outcome.stop)
        self._publish_undecided()
        self._set_timer()

    def _set_timer(self) -> None:
        rested = math.inf if self._live is None else self._polled_at + _REST_S
        self._timer.set(min(self._controller.due, rested))

    # Requests

    async def _on_collect(
        self, request: CollectFeedback.Request, response: CollectFeedback.Response
    ) -> CollectFeedback.Response:
        with self._request():
            with answering(response):
                ended = collected_from_msg(request, self._space)
                change = await self._once_known(lambda: self._controller.collect(ended))
            if response.accepted and change is not None:
                response.applied = True
                await self._answer(change, response)
            elif response.accepted:
                response.message = taught_text(request.agent, self._controller.taught(ended))
        return response

    async def _on_give(
        self, request: GiveFeedback.Request, response: GiveFeedback.Response
    ) -> GiveFeedback.Response:
        with self._request():
            with answering(response):
                given = given_from_msg(request, self._space)
                if given.feedback_id:
                    change = await self._once_known(lambda: self._controller.give(given))
                else:
                    change = self._controller.give(given)
            if response.accepted:
                await self._answer(change, response)
        return response

    @contextmanager
    def _request(self) -> Iterator[None]:
        """Count a request while it is in progress."""
        self._answering += 1
        try:
            yield
        finally:
            self._answering -= 1

    async def _once_known(self, teach: Callable[[], ResultT]) -> ResultT:
        """Apply feedback; wait for the agent's card if it has not arrived after a restart yet."""
        while True:
            try:
                return teach()
            except Refused as refusal:
                over = time.monotonic() >= self._cards_until
                if refusal.code != RefusalCode.UNKNOWN_AGENT or over:
                    raise
            card = Future()
            self._card_awaited.append(card)
            await card

    def _resume_waiting(self) -> None:
        awaited, self._card_awaited = self._card_awaited, []
        for card in awaited:
            card.set_result(None)

    async def _answer(self, change: ProfileChange, response: Any) -> None:
        """Deliver and publish a change; complete the answer after the hosts' answers."""
        answers: list[Future] = []
        for delivery in self._profiles.deliveries(change.all):
            # No wait at a stop: a stopping host gets the profile after its next start.
            answer = None if self._stopping else Future()
            self._hosts.deliver(delivery, answer)
            answers += [answer] if answer is not None else []
        response.feedback = self._publish_change(change)
        response.message = f"{change.revision.agent}: {change.text}"
        problems = [problem for answer in answers if (problem := await answer)]
        if problems:
            response.message += (
                f"; it is kept and goes to the host when its card shows up again: {problems[0]}"
            )

    def _publish_change(self, change: ProfileChange) -> Feedback:
        """Publish a change if it is new; return its message."""
        messages = [feedback_to_msg(one, self._profiles.space) for one in change.all]
        if change.fresh:
            self._untidy = True
            for message in messages:
                self._feedback.publish(message)
            self.executor.create_task(self._publish_table)
            first = messages[0]
            self.get_logger().info(
                f"{first.agent} revision {first.revision}: {change.text}; "
                f"from {first.source or 'somebody'}: {first.reason or 'no reason given'}"
            )
        return messages[0]

    def _on_manage(
        self, request: ManageProfiles.Request, response: ManageProfiles.Response
    ) -> ManageProfiles.Response:
        command = ManagementCommand(
            action=request.action,
            agent=request.agent,
            layer=request.layer,
            author=request.author,
            reason=request.reason,
            expected=tuple(request.expected),
            older_s=request.older_s,
            document=request.document,
        )
        with answering(response):
            done = self._management.execute(command)
        if not response.accepted:
            # A quote of a document may contain characters that are invalid in messages.
            response.message = response.message.encode(errors="replace").decode()
            return response
        self._untidy = True
        if done.forgets:
            # Later subscribers must not get the latched history.
            for publisher in (self._feedback, self._traces):
                self.destroy_publisher(publisher)
            self._create_history_publishers()
        for change in done.changes:
            self._publish_change(change)
        for delivery in (*self._profiles.deliveries(done.changes), *done.deliveries):
            self._hosts.deliver(delivery)
        self._publish_table()
        response.message, response.document = done.message, done.document
        return response

    def _create_history_publishers(self) -> None:
        self._feedback = self.create_publisher(Feedback, "bt_agents/feedback", qos.HISTORY)
        self._traces = self.create_publisher(MoodTrace, "bt_agents/mood_traces", qos.HISTORY)

    def _publish_table(self) -> None:
        undecided, differing = self._controller.undecided, self._profiles.differing
        published = (self._profiles.table(), undecided, differing)
        if published != self._published:
            self._published = published
            self._current.publish(table_to_msg(*published, self._profiles.space))

    def _publish_undecided(self) -> None:
        if self._controller.undecided != self._published[1]:
            self._publish_table()


def make_node() -> FeedbackNode:
    """Create the node from the parameters of its process; it closes its ledger when it ends.

    Raises:
        BtAgentsError: The trees folder, the experiment or the ledger cannot be used.
    """
    return make_managed(FeedbackNode)


def main(args: Sequence[str] | None = None) -> int:
    """Run the feedback node until it is stopped; return the exit code."""
    return run(make_node, args)
