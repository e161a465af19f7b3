# SPDX-License-Identifier: Apache-2.0
"""The action that ticks one agent's tree at a time, with a cancel that is seen at once."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from typing import Any

from py_trees.common import Status
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from bt_agents.engine.run import Outcome, Run, RunResult, StatusChange
from bt_agents.errors import Refused
from bt_agents.ros import qos
from bt_agents.ros.messages import scene_from_msg
from bt_agents.ros.world import RosWorld
from bt_agents.roster import Roster
from bt_agents.scene import Scene
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import StatusChange as StatusChangeMsg
from bt_agents_interfaces.msg import TreeStatus

RESULT_KEPT_S = 5
"""How long rclpy keeps a finished goal [s]; its default of 900 s slows acceptance 25-fold."""

_STATUS = {
    Status.INVALID: StatusChangeMsg.INVALID,
    Status.RUNNING: StatusChangeMsg.RUNNING,
    Status.SUCCESS: StatusChangeMsg.SUCCESS,
    Status.FAILURE: StatusChangeMsg.FAILURE,
}

_OUTCOME = {
    Outcome.SUCCEEDED: RunAgent.Result.SUCCEEDED,
    Outcome.FAILED: RunAgent.Result.FAILED,
    Outcome.CANCELLED: RunAgent.Result.CANCELLED,
}


class RunServer:
    """Serves ``~/run``: accepts one goal at a time and ticks its tree until it has ended.

    Args:
        node: The host's node.
        roster: Its agents.
        instance: This start of the host; goals meant for another one are refused.
        live: Returns the latest live scene of a scene id, None when there is none.
    """

    def __init__(
        self,
        node: Node,
        roster: Roster,
        instance: str,
        live: Callable[[str], Scene | None],
    ) -> None:
        self.goal: Any = None
        self._node = node
        self._roster = roster
        self._instance = instance
        self._live = live
        self._run: Run | None = None
        self._ended: Any = None
        self._handle: Any = None
        self._cancel_reason = ""
        self._stopping = False
        self._wake = node.create_guard_condition(self._tick)
        self.world = RosWorld(
            node,
            self._wake.trigger,
            space=roster.space,
            agent=lambda: self.goal.agent if self.goal is not None else "",
        )
        self._status = node.create_publisher(TreeStatus, "~/status", qos.EVENTS)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(0.05, self._tick, clock=self._steady, autostart=False)
        self._server: ActionServer | None = None

    def open(self) -> None:
        """Take goals; two servers of one name would each take every goal."""
        if self._server is None:
            self._server = ActionServer(
                self._node,
                RunAgent,
                "~/run",
                execute_callback=self._execute,
                goal_callback=self._answer_goal,
                cancel_callback=self._answer_cancel,
                goal_service_qos_profile=qos.SERVICE,
                result_service_qos_profile=qos.SERVICE,
                cancel_service_qos_profile=qos.SERVICE,
                feedback_pub_qos_profile=qos.EVENTS,
                result_timeout=RESULT_KEPT_S,
            )

    def close(self) -> None:
        """Take the action off the graph."""
        if self._server is not None:
            self._server.destroy()
            self._server = None

    @property
    def busy(self) -> bool:
        """True from the acceptance of a goal until its result is on its way."""
        return self.goal is not None

    def set_rate(self, hertz: float) -> None:
        """Tick this often from the next tick on."""
        self._timer.timer_period_ns = int(1e9 / hertz)

    def end_orphan(self, epoch: str) -> None:
        """Stop a tree that another epoch of the market has started, as that one cannot do it."""
        if self.goal is not None and self.goal.epoch != epoch:
            self._cancel_reason = self._cancel_reason or "its market is gone"
            self._wake.trigger()

    def stop(self, reason: str) -> None:
        """Stop the running tree from within the host, without its clean-up."""
        self._stopping = True
        if self.busy:
            self._cancel_reason = self._cancel_reason or reason
            self._wake.trigger()

    def _answer_goal(self, goal: Any) -> GoalResponse:
        try:
            self._check(goal)
        except Refused as refused:
            self._node.get_logger().warning(
                f"goal for '{goal.agent[:80]}' (round {goal.round}) refused: {refused}"
            )
            return GoalResponse.REJECT
        self.goal = goal
        return GoalResponse.ACCEPT

    def _check(self, goal: Any) -> None:
        if self._stopping:
            raise Refused("STOPPING", "this host is being stopped")
        if self.busy:
            raise Refused("BUSY", f"{self.goal.agent} is running; one tree at a time")
        if goal.host_instance != self._instance:
            raise Refused(
                "WRONG_INSTANCE",
                f"meant for instance '{goal.host_instance}', this is '{self._instance}'",
            )
        member = self._roster.member(goal.agent)
        if not member.agent_id or member.agent_id != goal.agent_id:
            raise Refused(
                "UNREGISTERED", f"{goal.agent} has the id {member.agent_id}, not {goal.agent_id}"
            )
        scene_from_msg(goal.scene, self._roster.space)

    def _answer_cancel(self, _handle: Any) -> CancelResponse:
        self._cancel_reason = self._cancel_reason or "the market stopped it"
        self._wake.trigger()
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> RunAgent.Result:
        goal = handle.request
        self._handle = handle
        self._ended = Future(executor=self._node.executor)
        try:
            scene = scene_from_msg(goal.scene, self._roster.space)
            member = self._roster.member(goal.agent)
            self._run = Run(
                member.spec,
                space=self._roster.space,
                scene=scene,
                profile=member.profile,
                live=lambda: self._live(scene.scene_id) or scene,
                tunables=member.tunables,
                world=self.world,
                steady=time.monotonic,
            )
            self._node.get_logger().info(f"round {goal.round}: {goal.agent} runs")
            self._timer.reset()
            self._tick()
            result: RunResult = await self._ended
            self._node.get_logger().info(
                f"round {goal.round}: {goal.agent} {result.outcome.value}: {result.message}"
            )
            _close(handle, result)
            return RunAgent.Result(
                outcome=_OUTCOME[result.outcome],
                message=result.message,
                tip=result.tip,
                orphans=list(result.orphans),
                ticks=result.ticks,
                duration_s=result.duration_s,
            )
        finally:
            self.goal = self._run = self._handle = None
            self._cancel_reason = ""

    def _tick(self) -> None:
        run = self._run
        if run is None or run.result is not None:
            return
        try:
            self._advance(run)
        except Exception as error:
            # What a node raises is its FAILURE; this is a fault of the engine, and ends the run.
            self._node.get_logger().error(traceback.format_exc())
            self._timer.cancel()
            self._ended.set_result(run.give_up(f"{type(error).__name__}: {error}"))

    def _advance(self, run: Run) -> None:
        changes = []
        if self._cancel_reason:
            changes += run.cancel(self._cancel_reason, clean_up=not self._stopping)
        changes += run.tick()
        if changes:
            self._publish(run, changes)
        if run.result is not None:
            self._timer.cancel()
            self._ended.set_result(run.result)

    def _publish(self, run: Run, changes: list[StatusChange]) -> None:
        status = TreeStatus(
            stamp=self._node.get_clock().now().to_msg(),
            epoch=self.goal.epoch,
            round=self.goal.round,
            agent=self.goal.agent,
            host_instance=self._instance,
            tick=run.ticks,
            tip=run.tip,
            changes=[
                StatusChangeMsg(
                    path=change.path,
                    name=change.name,
                    status=_STATUS[change.status],
                    message=change.message,
                )
                for change in changes
            ],
        )
        self._status.publish(status)
        if self._handle.is_active:
            self._handle.publish_feedback(RunAgent.Feedback(status=status))


def _close(handle: Any, result: RunResult) -> None:
    if result.outcome is Outcome.SUCCEEDED:
        handle.succeed()
    elif result.outcome is Outcome.CANCELLED and handle.is_cancel_requested:
        handle.canceled()
    else:
        handle.abort()
