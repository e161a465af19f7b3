# SPDX-License-Identifier: Apache-2.0
"""The feedback node: messages in, changes of profiles out; everything it decides is pure."""

from __future__ import annotations

import os
import time
import uuid
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.task import Future
from rclpy.validate_full_topic_name import validate_full_topic_name

from bt_agents.errors import Refused
from bt_agents.language.experiment_reader import read_simulated_feedback
from bt_agents.language.scene_reader import read_scene
from bt_agents.ros import qos
from bt_agents.ros.calls import Calls
from bt_agents.ros.messages import scene_from_msg, scene_to_msg, to_time
from bt_agents.ros.runner import run
from bt_agents.ros.startup import TREES, StartParameter, make_from_parameters
from bt_agents.scene import SceneSpace
from bt_agents.simulated import SimulatedFeedback
from bt_agents.trees_folder import find_trees
from bt_agents_interfaces.msg import Feedback, HostCard
from bt_agents_interfaces.msg import Profiles as ProfilesMsg
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import CancelRun, CollectFeedback, GiveFeedback, SetProfile
from feedback_node.cards import AgentEntry, Card, RuleEntry
from feedback_node.ledger import Ledger
from feedback_node.ledger_file import ledger_path
from feedback_node.profiles import Change, Delivery, Profiles
from feedback_node.runs import Run
from feedback_node.teaching import Given, Lesson, Stop, Teaching

_TICK_S = 0.025
_TIDY_S = 1.0
_CALL_LIMIT_S = 1.0
_OUTCOMES = (RunMsg.SUCCEEDED, RunMsg.FAILED, RunMsg.CANCELLED, RunMsg.LOST)


class FeedbackNode(Node):
    """Learns from moods, people and lists, and tells the hosts what their agents are now."""

    def __init__(
        self,
        space: SceneSpace,
        ledger: Ledger,
        simulated: SimulatedFeedback | None = None,
        **node_kwargs: Any,
    ) -> None:
        """Create the node.

        Args:
            space: The scene parameters.
            ledger: Open ledger; its owner closes it after the node is destroyed.
            simulated: Feedback of an experiment; None gives none.
            node_kwargs: Passed on to ``Node``.
        """
        super().__init__("feedback", **node_kwargs)
        self._space = space
        self._ledger = ledger
        self._untidy = True
        self._profiles = Profiles(space, ledger)
        self._teaching = Teaching(
            self._profiles,
            clock=time.monotonic,
            new_id=lambda: f"given/{uuid.uuid4()}",
            simulated=simulated,
        )
        self._born_ns = time.time_ns()
        self._calls = Calls(self)
        self._hosts: dict[str, Client] = {}
        self._problems: dict[str, tuple[str, ...]] = {}
        self._table: tuple[tuple[str, int, tuple[float, ...]], ...] = ()
        self._cancel = self.create_client(CancelRun, "marketplace/cancel", qos_profile=qos.SERVICE)
        self._feedback = self.create_publisher(Feedback, "feedback", qos.HISTORY)
        self._current = self.create_publisher(ProfilesMsg, "profiles", qos.FACT)
        self._timer = self.create_timer(
            _TICK_S, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME), autostart=False
        )
        self.create_timer(_TIDY_S, self._on_idle, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_subscription(HostCard, "cards", self._on_card, qos.FACTS)
        self.create_subscription(RunMsg, "runs", self._on_run, qos.HISTORY)
        self.create_subscription(SceneMsg, "scene/live", self._on_live, qos.SENSOR)
        # Services await other nodes' answers, which the default group would keep from coming.
        group = ReentrantCallbackGroup()
        self.create_service(
            CollectFeedback,
            "~/collect",
            self._on_collect,
            qos_profile=qos.SERVICE,
            callback_group=group,
        )
        self.create_service(
            GiveFeedback, "~/give", self._on_give, qos_profile=qos.SERVICE, callback_group=group
        )

    def _on_card(self, message: HostCard) -> None:
        try:
            _check_name(message.host)
            deliveries, problems = self._teaching.introduce(_card(message))
        except Refused as refusal:
            deliveries, problems = (), (str(refusal),)
        if problems != self._problems.get(message.host, ()):
            for problem in problems:
                self.get_logger().error(problem)
            self._problems[message.host] = problems
        for delivery in deliveries:
            self._send(delivery)
        self._publish_table()
        self._set_timer()

    def _on_run(self, message: RunMsg, info: dict[str, int]) -> None:
        try:
            event = _run(message, self._space)
        except Refused as refusal:
            self.get_logger().warning(f"event of a run refused: {refusal}")
            return
        if message.event == RunMsg.STARTED:
            self._teaching.started(event, replayed=info["source_timestamp"] < self._born_ns)
        elif message.event == RunMsg.CANCELLING:
            self._teaching.cancelling(event)
        elif message.event == RunMsg.ENDED:
            self._teaching.ended(event)
        self._set_timer()

    def _on_live(self, message: SceneMsg) -> None:
        try:
            live = scene_from_msg(message, self._space)
        except Refused as refusal:
            self.get_logger().warning(f"live scene refused: {refusal}", throttle_duration_sec=5.0)
            return
        self._follow(self._teaching.see(live))

    def _on_tick(self) -> None:
        self._follow(self._teaching.tick())

    def _on_idle(self) -> None:
        if self._untidy and not self._teaching.watching:
            self._ledger.tidy()
            self._untidy = False

    def _follow(self, lessons: Iterable[Lesson]) -> None:
        for lesson in lessons:
            if lesson.problem:
                self.get_logger().error(lesson.problem)
            if lesson.change is not None:
                self._announce(lesson.change)
                if self._profiles.knows(lesson.change.revision.agent):
                    self._send(self._profiles.delivery(lesson.change.revision.agent))
            if lesson.stop is not None:
                self._stop(lesson.stop)
        self._set_timer()

    async def _on_collect(
        self, request: CollectFeedback.Request, response: CollectFeedback.Response
    ) -> CollectFeedback.Response:
        try:
            if request.outcome not in _OUTCOMES:
                raise Refused(
                    "UNKNOWN_OUTCOME", f"feedback: outcome {request.outcome}, expected 1 to 4"
                )
            change = self._teaching.collect(_run(request, self._space))
        except Refused as refusal:
            response.code, response.message = refusal.code, refusal.reason
            return response
        response.accepted = True
        if change is None:
            response.message = f"no feedback for {request.agent}"
            return response
        response.applied = True
        response.feedback = self._announce(change)
        response.message = await self._told(change)
        return response

    async def _on_give(
        self, request: GiveFeedback.Request, response: GiveFeedback.Response
    ) -> GiveFeedback.Response:
        try:
            change = self._teaching.give(_given(request))
        except Refused as refusal:
            response.code, response.message = refusal.code, refusal.reason
            return response
        response.accepted = True
        response.feedback = self._announce(change)
        response.message = await self._told(change)
        return response

    def _announce(self, change: Change) -> Feedback:
        """Publish a change unless it was published when it was new; return its message."""
        message = _feedback(change, self._space)
        if change.fresh:
            self._untidy = True
            self._feedback.publish(message)
            self._publish_table()
            self.get_logger().info(
                f"{message.agent} revision {message.revision}: {change.words}; "
                f"from {message.source or 'somebody'}: {message.reason or 'no reason given'}"
            )
        return message

    async def _told(self, change: Change) -> str:
        """Wait until the host bids with the profile or has not answered in time; say which."""
        agent = change.revision.agent
        words = f"{agent}: {change.words}"
        if not self._profiles.knows(agent):
            return words
        answer = Future()
        self._send(self._profiles.delivery(agent), answer)
        problem = await answer
        if problem:
            words += f"; it is kept and goes to the host when its card shows up again: {problem}"
        return words

    def _send(self, delivery: Delivery, answer: Future | None = None) -> None:
        """Tell a host the profile of an agent; ``answer`` gets "" or what went wrong."""

        def done(problem: str) -> None:
            if problem:
                self.get_logger().warning(
                    f"{delivery.agent} revision {delivery.revision} not delivered: {problem}"
                )
            if answer is not None:
                answer.set_result(problem)

        def answered(response: SetProfile.Response) -> None:
            done("" if response.accepted else f"{response.code}: {response.message}")

        self._calls.call(
            self._client(delivery.host),
            SetProfile.Request(
                agent=delivery.agent, values=delivery.values, revision=delivery.revision
            ),
            deadline_s=_CALL_LIMIT_S,
            on_answer=answered,
            on_failure=done,
        )

    def _stop(self, stop: Stop) -> None:
        def failed(problem: str) -> None:
            self.get_logger().error(
                f"{stop.run.agent} in round {stop.run.round} was to be stopped "
                f"({stop.reason}): {problem}"
            )

        def answered(response: CancelRun.Response) -> None:
            if not response.accepted:
                failed(response.message)

        self._calls.call(
            self._cancel,
            CancelRun.Request(
                epoch=stop.run.epoch,
                round=stop.run.round,
                reason=stop.reason,
                again=True,
                scene=scene_to_msg(stop.live),
            ),
            deadline_s=_CALL_LIMIT_S,
            on_answer=answered,
            on_failure=failed,
        )

    def _client(self, host: str) -> Client:
        if host not in self._hosts:
            self._hosts[host] = self.create_client(
                SetProfile, _set_profile(host), qos_profile=qos.SERVICE
            )
        return self._hosts[host]

    def _publish_table(self) -> None:
        table = self._profiles.table()
        if table == self._table:
            return
        self._table = table
        self._current.publish(
            ProfilesMsg(
                parameters=self._space.names,
                agents=[name for name, _, _ in table],
                revisions=[revision for _, revision, _ in table],
                vectors=[value for _, _, vector in table for value in vector],
            )
        )

    def _set_timer(self) -> None:
        if self._teaching.watching == self._timer.is_canceled():
            if self._teaching.watching:
                self._timer.reset()
            else:
                self._timer.cancel()


def _set_profile(host: str) -> str:
    return f"{host}/set_profile"


def _check_name(host: str) -> None:
    try:
        validate_full_topic_name(_set_profile(host), is_service=True)
    except NameValidationException as error:
        raise Refused(
            "BAD_NAME", f"card of '{host}': {error}; expected a full name like /agents"
        ) from None


def _card(message: HostCard) -> Card:
    return Card(
        host=message.host,
        parameters=tuple(message.parameters),
        agents=tuple(
            AgentEntry(
                name=agent.name,
                profile=tuple(agent.profile),
                revision=agent.revision,
                learning_rate=agent.learning_rate,
                rules=tuple(
                    RuleEntry(when=r.when, hold_s=r.hold_s, give=r.give, cancel=r.cancel)
                    for r in agent.rules
                ),
            )
            for agent in message.agents
        ),
    )


def _run(message: RunMsg | CollectFeedback.Request, space: SceneSpace) -> Run:
    return Run(
        epoch=message.epoch,
        round=message.round,
        agent=message.agent,
        scene=scene_from_msg(message.scene, space),
    )


def _given(request: GiveFeedback.Request) -> Given:
    return Given(
        feedback_id=request.feedback_id,
        agent=request.agent,
        kind=request.kind,
        values=tuple(request.values),
        source=request.source,
        reason=request.reason,
    )


def _feedback(change: Change, space: SceneSpace) -> Feedback:
    cause = change.revision.cause
    return Feedback(
        stamp=to_time(change.revision.stamp),
        feedback_id=cause.feedback_id or "",
        agent=change.revision.agent,
        kind=cause.kind,
        source=cause.source,
        reason=cause.reason,
        epoch=cause.epoch,
        round=cause.round,
        parameters=space.names,
        before=change.before,
        after=change.after,
        target=change.target,
        learning_rate=cause.rate,
        revision=change.revision.revision,
        cancels=cause.cancels,
    )


_START = (
    TREES,
    StartParameter(
        name="ledger",
        description="SQLite file of all learned profiles; empty: bt-agents/ledger.sqlite in the "
        "user's state folder; :memory: keeps nothing",
    ),
    StartParameter(
        name="simulated_feedback",
        description="YAML file with feedback for experiments; empty: none",
    ),
)


def main(args: Sequence[str] | None = None) -> int:
    """Run the feedback node until it is told to stop; return the exit code."""
    with ExitStack() as owned:

        def make(values: Mapping[str, str]) -> FeedbackNode:
            space = read_scene(find_trees(values["trees"]) / "scene.yaml").space
            path = values["simulated_feedback"]
            rows = read_simulated_feedback(Path(path), space) if path else None
            book = owned.enter_context(Ledger(ledger_path(values["ledger"], os.environ)))
            node = FeedbackNode(space, book, rows)
            node.get_logger().info(f"the ledger is {book.path}")
            return node

        return run(lambda: make_from_parameters("feedback", _START, make), args)


if __name__ == "__main__":
    raise SystemExit(main())
