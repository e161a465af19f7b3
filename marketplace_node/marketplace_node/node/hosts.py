# SPDX-License-Identifier: Apache-2.0
"""Connections to the hosts: registration, heartbeats, actions, goals in progress, open goals."""

from __future__ import annotations

import time
import uuid
from dataclasses import dataclass
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import OpenGoal
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import LONGEST_NAME
from bt_agents_core.scene import SceneSpace
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Heartbeat, OpenGoals
from bt_agents_interfaces.srv import RegisterHost
from bt_agents_ros import qos
from bt_agents_ros.goal_cancellation import GoalCanceller, open_goals_from_msg
from bt_agents_ros.messages import seconds
from bt_agents_ros.size_check import RefusalLog
from marketplace_node.effects import Execute, Note, SendGoal
from marketplace_node.formatting import shown
from marketplace_node.hosts.host_effects import CancelOpenGoals, RunGoal
from marketplace_node.hosts.registry import HostEntry, RegistrationAnswer
from marketplace_node.interaction.phases import RunEnd
from marketplace_node.market import Market
from marketplace_node.node.messages import (
    earlier_run_from_msg,
    goal_to_msg,
    heartbeat_of,
    registration_from_msg,
    run_end_from_msg,
)

_SHOWN = 200  # characters of a malformed input


@dataclass(eq=False, kw_only=True)
class _Link:
    """Connection to a host: clients of its action's services, and a heartbeat subscription.

    Attributes:
        heard: Whether a heartbeat with its token has arrived; before that, the host may not have
            read the answer to its registration.
    """

    entry: HostEntry
    goals: Any
    results: Any
    cancels: Any
    heartbeat: Any
    heard: bool = False

    @property
    def is_ready(self) -> bool:
        """Whether the action is matched; before that, a request would be lost."""
        clients = (self.goals, self.results, self.cancels)
        return all(client.service_is_ready() for client in clients)


@dataclass(eq=False, kw_only=True)
class _Sending:
    """Goal that waits for its server or has been sent.

    Attributes:
        accepted: Whether the action has accepted it, possibly only to report why it is refused.
        begun: Whether the host's heartbeat names its run.
        reported: Whether the market knows that the host has accepted it.
        unproven: Whether its result has come, but perhaps from another server of this name. Then
            the heartbeat says how the run continues.
    """

    link: _Link
    request: Any
    sent: bool = False
    accepted: bool = False
    begun: bool = False
    reported: bool = False
    unproven: bool = False


class HostConnections:
    """Service ``~/register``, action clients and open goals; reports to the market what hosts do.

    A goal waits for its server until the market gives it up; the market owns every deadline. The
    connection uses the services of the action directly: an action client would also subscribe to
    the feedback and the states of all goals, which costs more time than everything else.
    """

    def __init__(self, node: Node, market: Market, space: SceneSpace, execute: Execute) -> None:
        self._node = node
        self._market = market
        self._space = space
        self._execute = execute
        self._links: dict[str, _Link] = {}
        self._goals: dict[RunGoal, _Sending] = {}
        self._refusals = RefusalLog(time.monotonic)
        node.create_service(RegisterHost, "~/register", self._register, qos_profile=qos.SERVICE)
        self._canceller = GoalCanceller(node)
        node.create_subscription(
            OpenGoals, "bt_agents/open_goals", self._take_open_goals, qos.FACTS
        )

    @property
    def is_polling(self) -> bool:
        """Whether a goal waits for the discovery of its server."""
        return not all(sending.sent for sending in self._goals.values())

    def reaches(self, host: str) -> bool:
        """Return True when the host is connected."""
        return host in self._links

    def connect(self, entry: HostEntry) -> None:
        """Connect to a host, instead of an earlier start of it.

        Raises:
            Refused: ``UNREACHABLE``; its names cannot be used.
        """
        self.disconnect(entry.host)
        made: list[Any] = []
        try:
            for kind, name in (
                (RunAgent.Impl.SendGoalService, "send_goal"),
                (RunAgent.Impl.GetResultService, "get_result"),
                (CancelGoal, "cancel_goal"),
            ):
                made.append(
                    self._node.create_client(
                        kind, f"{entry.run_action}/_action/{name}", qos_profile=qos.SERVICE
                    )
                )
            take = partial(self._take_heartbeat, entry.host)
            heartbeat = self._node.create_subscription(
                Heartbeat, entry.heartbeat, take, qos.EVENTS, raw=True
            )
        except Exception as error:
            # The names come from outside; rclpy has no common base class for errors of bad names.
            for client in made:
                self._node.destroy_client(client)
            raise Refused(
                RefusalCode.UNREACHABLE,
                f"{entry.host} cannot be reached at {entry.run_action} and {entry.heartbeat}, "
                f"expected an action and a topic that nothing else is called: {error}",
            ) from None
        goals, results, cancels = made
        self._links[entry.host] = _Link(
            entry=entry, goals=goals, results=results, cancels=cancels, heartbeat=heartbeat
        )

    def disconnect(self, host: str) -> None:
        """Forget a host and all goals sent to it; the market follows them by its heartbeat."""
        link = self._links.pop(host, None)
        if link is not None:
            self._goals = {g: s for g, s in self._goals.items() if s.link is not link}
            for client in (link.goals, link.results, link.cancels):
                self._node.destroy_client(client)
            self._node.destroy_subscription(link.heartbeat)

    def close(self) -> None:
        """Disconnect all hosts."""
        for host in list(self._links):
            self.disconnect(host)

    def send(self, effect: SendGoal) -> None:
        """Send a goal as soon as its server is available."""
        goal = effect.goal
        link = self._links.get(goal.host)
        if link is None:
            self._refuse(goal, f"{goal.host} is not connected")
            return
        request = RunAgent.Impl.SendGoalService.Request()
        request.goal_id.uuid = list(uuid.uuid4().bytes)
        request.goal = goal_to_msg(effect, self._market.epoch, link.entry.token)
        self._goals = {
            other: sending
            for other, sending in self._goals.items()
            if not (sending.link is link and sending.unproven)
        }
        self._goals[goal] = _Sending(link=link, request=request)
        self.send_waiting()

    def send_waiting(self) -> None:
        """Send the waiting goals whose server has been discovered."""
        for goal, sending in list(self._goals.items()):
            # A goal sent before its server is matched would be lost.
            if not sending.sent and sending.link.is_ready:
                sending.sent = True
                sending.link.goals.call_async(sending.request).add_done_callback(
                    lambda done, goal=goal, sending=sending: self._answered(goal, sending, done)
                )

    def cancel(self, goal: RunGoal) -> None:
        """Cancel a goal, or drop it unsent.

        An unanswered goal is cancelled as well: a stalled host then finds the cancel together
        with the goal and does not begin. The market cancels again on acceptance.
        """
        sending = self._goals.get(goal)
        if sending is None:
            link = self._links.get(goal.host)
            if link is not None and link.entry.instance == goal.instance:
                # Another server of this name answered for it, or the connection was renewed.
                self.cancel_all(goal.host)
        elif sending.sent:
            request = CancelGoal.Request()
            request.goal_info.goal_id = sending.request.goal_id
            sending.link.cancels.call_async(request)
        else:
            del self._goals[goal]
            self._refuse(goal, f"{sending.link.entry.run_action} is not there")

    def cancel_all(self, host: str) -> None:
        """Cancel all goals of the action of a host, including goals of other clients."""
        link = self._links.get(host)
        if link is not None:
            # A request without an id and a stamp cancels all goals of an action.
            link.cancels.call_async(CancelGoal.Request())

    def cancel_open_goals(self, effect: CancelOpenGoals) -> None:
        """Cancel goals that a host has left open, and report the outcome to the market."""

        def report(unconfirmed: tuple[OpenGoal, ...]) -> None:
            now = time.monotonic()
            self._execute(
                self._market.goals_cancelled(effect.host, effect.instance, unconfirmed, now)
            )

        self._canceller.cancel(effect.goals, within_s=effect.within_s, on_end=report)

    def _take_open_goals(self, message: OpenGoals) -> None:
        try:
            goals = open_goals_from_msg(message)
        except Refused as refused:
            host = message.host[:LONGEST_NAME]
            self._execute([Note(message=shown(f"open goals of {host}: {refused}"))])
            return
        self._execute(
            self._market.open_goals(message.host, message.host_instance, goals, time.monotonic())
        )

    def _register(
        self, request: RegisterHost.Request, response: RegisterHost.Response
    ) -> RegisterHost.Response:
        registration = registration_from_msg(request)
        answer, effects = self._market.register(registration, time.monotonic())
        self._execute(effects)
        if answer.accepted and not self.reaches(request.host):
            answer = RegistrationAnswer(
                accepted=False,
                message=f"UNREACHABLE: {request.run_action} or {request.heartbeat} cannot be "
                "used, as something else has the name; the log of the marketplace says more",
            )
        response.epoch = self._market.epoch
        response.accepted = answer.accepted
        response.agent_ids = list(answer.agent_ids)
        response.reasons = list(answer.reasons)
        response.message = answer.message
        if answer.accepted:
            response.token = list(answer.token)
            self._take_unreported(request)
        else:
            self._node.get_logger().warning(
                f"host '{request.host}' refused: {response.message}", throttle_duration_sec=30.0
            )
        return response

    def _take_unreported(self, request: RegisterHost.Request) -> None:
        """Take the valid runs of an earlier market."""
        runs = []
        for message in request.unreported:
            try:
                runs.append(earlier_run_from_msg(message, self._space, seconds(request.stamp)))
            except Refused as refused:
                self._node.get_logger().warning(
                    f"a run that {request.host} had not reported is left out: "
                    f"{str(refused)[:_SHOWN]}"
                )
        self._execute(self._market.unreported(request.host, runs, time.monotonic()))

    def _take_heartbeat(self, host: str, data: bytes) -> None:
        link = self._links[host]
        try:
            message = heartbeat_of(link.entry, data)
        except Refused as refused:
            # One that does not name this start is from a host that has not registered yet.
            if link.heard and link.entry.instance.encode() in data:
                self._log_refused(link.entry.heartbeat, refused)
            return
        link.heard = True
        for goal, sending in list(self._goals.items()):
            if sending.sent and self._names(message, host, goal):
                sending.begun = True
                self._report_taken(goal, sending)
        self._execute(
            self._market.heartbeat(
                host, message.host_instance, message.epoch, message.round, time.monotonic()
            )
        )

    def _log_refused(self, name: str, refused: Refused) -> None:
        line = self._refusals.line(self, name, refused)
        if line is not None:
            self._node.get_logger().warning(line)

    def _names(self, heartbeat: Heartbeat, host: str, goal: RunGoal) -> bool:
        run = (host, heartbeat.host_instance, heartbeat.epoch, heartbeat.round)
        of_agent = heartbeat.agent in ("", goal.agent)
        return of_agent and run == (goal.host, goal.instance, self._market.epoch, goal.round)

    def _report_taken(self, goal: RunGoal, sending: _Sending) -> None:
        """Report a goal as taken once it is accepted and its run has begun."""
        if sending.accepted and sending.begun and not sending.reported:
            sending.reported = True
            self._execute(self._market.goal_accepted(goal, time.monotonic()))

    def _answered(self, goal: RunGoal, sending: _Sending, future: Any) -> None:
        if self._goals.get(goal) is not sending:
            return
        unread = future.exception()
        if unread is not None or not future.result().accepted:
            del self._goals[goal]
            self._refuse(goal, f"{goal.host} refused it" if unread is None else str(unread))
            return
        request = RunAgent.Impl.GetResultService.Request(goal_id=sending.request.goal_id)
        sending.link.results.call_async(request).add_done_callback(
            lambda done: self._ended(goal, sending, done)
        )
        sending.accepted = True
        self._report_taken(goal, sending)

    def _ended(self, goal: RunGoal, sending: _Sending, future: Any) -> None:
        if self._goals.get(goal) is not sending:
            return
        unread = future.exception()
        if unread is not None:
            end = RunEnd(outcome=RunAgent.Result.FAILED, message=str(unread))
            self._report_end(goal, sending, end)
            return
        answer = future.result()
        if answer.status == GoalStatus.STATUS_UNKNOWN:
            self._leave_to_heartbeat(goal, sending)
            return
        result = answer.result
        if result.outcome == RunAgent.Result.REFUSED and not sending.reported:
            del self._goals[goal]
            reason = ellipsize(printable_line(f"{result.code}: {result.message}"), _SHOWN)
            self._refuse(goal, f"{goal.host} refused it ({reason})")
            return
        try:
            sending.link.entry.check_token(bytes(result.token))
        except Refused as refused:
            self._log_refused(sending.link.entry.run_action, refused)
            self._leave_to_heartbeat(goal, sending)
            return
        self._report_end(goal, sending, run_end_from_msg(result))

    def _leave_to_heartbeat(self, goal: RunGoal, sending: _Sending) -> None:
        """Free a goal whose result proves nothing, at the latest when the host gets the next one.

        Until the market knows that the run has begun, the heartbeat has to name the goal.
        """
        if sending.reported:
            del self._goals[goal]
        else:
            sending.unproven = True

    def _report_end(self, goal: RunGoal, sending: _Sending, end: RunEnd) -> None:
        sending.begun = True
        self._report_taken(goal, sending)
        self._goals.pop(goal, None)
        self._execute(self._market.run_ended(goal, end, time.monotonic()))

    def _refuse(self, goal: RunGoal, reason: str) -> None:
        self._execute(self._market.goal_refused(goal, reason, time.monotonic()))
