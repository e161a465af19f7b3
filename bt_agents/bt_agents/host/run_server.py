# SPDX-License-Identifier: Apache-2.0
"""Action server that ticks one agent's tree at a time and acts on a cancel at once."""

from __future__ import annotations

import hmac
import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.action import CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from bt_agents.engine.run import Overrun, Run, RunResult, StatusChange, TreeOutcome
from bt_agents.engine.ticker import TickScheduler
from bt_agents.host.agent_registry import AgentRegistry
from bt_agents.host.environment.open_goal_list import OpenGoalList
from bt_agents.host.environment.open_goals_file import OpenGoalsFile
from bt_agents.host.environment.ros_environment import RosEnvironment
from bt_agents.host.run_control import RunControl
from bt_agents.host.run_messages import not_begun, run_result_to_msg, tree_status
from bt_agents.host.run_monitors import AwardMonitor
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.run_key import RunKey
from bt_agents_core.scene import Scene
from bt_agents_core.stop_cause import Cancellation, StopCause, stopper
from bt_agents_core.text import printable_line
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import MarketHeartbeat, TreeStatus
from bt_agents_language.model.specs import iter_nodes
from bt_agents_ros import qos
from bt_agents_ros.messages import partial_scene_from_msg, scene_from_msg, scene_to_msg
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.workarounds.quiet_action_server import QuietActionServer

RESULT_TIMEOUT_S = 2
"""Time for which rclpy stores a result [s]; its default of 900 s slows acceptance 25-fold."""

MOST_REFUSALS = 20
"""Most refused goals within :data:`RESULT_TIMEOUT_S` that get a result; others are rejected."""

_STOP_SETTLE_S = 0.7
"""Longest wait for goals to end when a host is stopped [s], out of one second for everything."""

_OVERRUNS_REPORTED_S = 5.0
_FAREWELL_S = 0.2
"""Time to send the last result before the action leaves the graph [s]."""


@dataclass(eq=False, kw_only=True)
class _Stop:
    """Order to stop the running tree.

    Attributes:
        reason: Reason in words.
        cause: Cause for the market.
        clean_up: False skips the agent's ``on_cancel``.
        host_reason: True if the reason says more than that the market stopped it.
        cancellation: Who and why, for the agent's ``on_cancel``; None until the market reports it.
        begun: True once it has cancelled the run.
    """

    reason: str
    cause: StopCause
    clean_up: bool
    host_reason: bool
    cancellation: Cancellation | None
    begun: bool = False


class RunServer:
    """Action ``~/run``: takes one goal at a time and ticks its tree until it has ended.

    A refused goal ends at once as ``REFUSED``, with a code and the reason. Without a market, any
    client may send a goal, which only needs the name of an agent.

    Args:
        instance: This start of the host; goals meant for another one are refused.
        live: Takes the scene of a run; returns a function for its live scene.
        open_goals_file: Keeps the open goals of its trees across a kill; None keeps nothing.
        market: False if no market awards its runs.
        slowness: Factor of the limits of servers; see :class:`RosEnvironment`.

    Attributes:
        goal: The current goal; None without one.
        run: Its run; None before its tree is built.
        control: Its pause and the breakpoints of all agents.
        tick_began: When the last tick began, on the steady clock [s].
        on_begin: Called with each accepted goal.
        on_start: Called with each run whose tree is built and not ticked yet.
        on_end: Called with each ended goal and its result, before the result is sent; the host is
            no longer busy then.
        on_control: Called after each change of the pause or the breakpoints.
        on_tick: Called after each tick.
    """

    def __init__(
        self,
        node: Node,
        registry: AgentRegistry,
        instance: str,
        live: Callable[[Scene], Callable[[], Scene]],
        open_goals_file: OpenGoalsFile | None = None,
        *,
        market: bool = True,
        slowness: float = 1.0,
    ) -> None:
        self.goal: Any = None
        self.run: Run | None = None
        self.control = RunControl(lambda: self._notify(self.on_control))
        self.tick_began = 0.0
        self._market = market
        self._runs_begun = 0
        self._node = node
        self._registry = registry
        self._host = str(node.get_fully_qualified_name())
        self._instance = instance
        self._begin_live = live
        self._result_future: Any = None
        self._unpublished: tuple[Run, Sequence[StatusChange], Time] | None = None
        self._ticked = node.get_clock().now()
        self._handle: Any = None
        self._scene: Any = None
        self._refusal: Refused | None = None
        self._refused_at: deque[float] = deque(maxlen=MOST_REFUSALS)
        self._stop: _Stop | None = None
        self._cancellation: Cancellation | None = None
        self._shutting_down = False
        self._withdrawing = False
        self._free_since = 0.0
        self._award_monitor = AwardMonitor(time.monotonic())
        self._tick_queued = False
        self._stepping = False
        self._period_s = 0.05
        self._scheduler = TickScheduler(self._period_s, time.monotonic())
        self.on_begin: list[Callable[[Any], None]] = []
        self.on_start: list[Callable[[Run], None]] = []
        self.on_end: list[Callable[[Any, RunAgent.Result], None]] = []
        self.on_control: list[Callable[[], None]] = []
        self.on_tick: list[Callable[[], None]] = []
        self.environment = RosEnvironment(
            node,
            self._on_arrival,
            run_goal=lambda: self.goal,
            open_goals=OpenGoalList(node, instance, lambda: self.goal, open_goals_file),
            space=registry.space,
            slowness=slowness,
        )
        self._status = node.create_publisher(TreeStatus, "~/status", qos.EVENTS)
        # Set again for each tick, because a late timer does not catch up.
        self._timer = steady_timer(node, self._period_s, self._tick, running=False)
        self._server: QuietActionServer | None = None
        self._token = b""

    def open(self, token: bytes = b"") -> None:
        """Open the action; two servers with the same name would both take every goal.

        It refuses goals without the token of its registration; without a market there is none.
        """
        self._token = token if any(token) else b""
        self._withdrawing = False
        if self._server is None:
            self._server = QuietActionServer(
                self._node,
                RunAgent,
                "~/run",
                execute_callback=self._execute,
                goal_callback=self._answer_goal,
                handle_accepted_callback=self._begin,
                cancel_callback=self._answer_cancel,
                goal_service_qos_profile=qos.SERVICE,
                result_service_qos_profile=qos.SERVICE,
                cancel_service_qos_profile=qos.SERVICE,
                feedback_pub_qos_profile=qos.EVENTS,
                result_timeout=RESULT_TIMEOUT_S,
            )

    def withdraw(self, reason: str) -> None:
        """Stop the running tree without its clean-up, then take the action off the graph."""
        self._withdrawing = True
        self.cancel(reason, clean_up=False)
        if not self.busy and time.monotonic() - self._free_since >= _FAREWELL_S:
            self.close()

    def close(self) -> None:
        """Take the action off the graph now."""
        if self._server is not None:
            self._server.destroy()
            self._server = None

    @property
    def busy(self) -> bool:
        """True from the acceptance of a goal until its result is sent."""
        return self.goal is not None

    @property
    def running(self) -> str:
        """Name of the agent of the current goal; empty without one."""
        return str(self.goal.agent) if self.goal is not None else ""

    @property
    def tip(self) -> tuple[str, str]:
        """Path and name of the node that decides the status of the tree; empty without a run."""
        run = self.run
        return (run.tip, run.tip_name) if run is not None and run.ticks else ("", "")

    def set_rate(self, hertz: float) -> None:
        """Set the tick rate from now on [1/s]."""
        self._period_s = 1.0 / hertz
        if self.run is not None:
            self.run.period_s = self._period_s
            self._scheduler.change(self._period_s, time.monotonic())
            self._set_timer()

    def pause(self, author: str) -> None:
        """Stop ticking the tree; see :meth:`RunControl.pause`."""
        self.control.pause(author)
        self.environment.clock.stop()

    def resume(self, author: str) -> None:
        """Tick the tree again; see :meth:`RunControl.resume`."""
        self.control.resume(author)
        self.environment.clock.go_on()
        self._tick_soon()

    def step(self) -> None:
        """Tick the paused tree once, as if one period had passed.

        Raises:
            Refused: ``NOT_PAUSED`` or ``HELD_UP``.
        """
        self.control.check_paused()
        if self._hold_off_s(time.monotonic()):
            raise Refused(
                RefusalCode.HELD_UP,
                "this host was held up, and the market may have gone on; ask again",
            )
        self.environment.clock.advance(self._period_s)
        self._stepping = True
        self._tick()

    def set_breakpoints(self, agent: str, paths: Sequence[str], author: str) -> None:
        """Set all breakpoints of an agent; see :meth:`RunControl.set_breakpoints`."""
        spec = self._registry.member(agent).spec
        nodes = {node.path for node in iter_nodes(spec.tree)}
        if self.run is not None and self.running == agent:
            # The run keeps the tree that it began with.
            nodes |= {node.path for node in iter_nodes(self.run.spec.tree)}
        self.control.set_breakpoints(agent, paths, nodes, author)
        if self.run is not None and self.running == agent:
            self.run.set_breakpoints(paths)

    def cancel(
        self, reason: str, *, cause: StopCause = StopCause.BY_HOST, clean_up: bool = True
    ) -> None:
        """Stop the running tree; the first reason and cause count.

        Without clean-up the agent's ``on_cancel`` is skipped, even if an earlier order began it.
        """
        if not self.busy:
            return
        if self._stop is None:
            by_market = cause is StopCause.BY_MARKET
            own = Cancellation(by=stopper(cause), reason=reason)
            self._stop = _Stop(
                reason=reason,
                cause=cause,
                clean_up=clean_up,
                host_reason=not by_market,
                cancellation=self._cancellation if by_market else own,
            )
        elif self._stop.clean_up and not clean_up:
            self._stop.clean_up = False
        else:
            return
        self._tick_soon()

    def explain_stop(self, run: RunKey, cancellation: Cancellation) -> None:
        """Handle the market's news of who stopped a run; it may arrive before the order itself."""
        if not self.busy or run != RunKey.of(self.goal):
            return
        self._cancellation = cancellation
        stop = self._stop
        if stop is not None and stop.cancellation is None:
            stop.cancellation = cancellation
            self._tick_soon()

    def stop(self, reason: str, *, process_ends: bool) -> None:
        """Stop the running tree and reject further goals.

        A process that ends has no time for the tree's clean-up.
        """
        self._shutting_down = True
        self.cancel(reason, clean_up=not process_ends)
        if process_ends and self.run is not None:
            self.run.shorten_settling(_STOP_SETTLE_S)
            self._tick_soon()

    def check_stall(self) -> None:
        """Detect a stall, and close after the farewell; called with each heartbeat."""
        now = time.monotonic()
        self._award_monitor.stall.poll(now)
        if self._withdrawing and not self.busy and now - self._free_since >= _FAREWELL_S:
            self.close()

    def on_market_heartbeat(self, heartbeat: MarketHeartbeat) -> None:
        """Handle a heartbeat of a market, which names its current run."""
        run = RunKey.of(self.goal) if self.busy else None
        if self._award_monitor.on_heartbeat(RunKey.of(heartbeat), run, time.monotonic()):
            self.cancel("the market has given its run away", clean_up=False)

    def _answer_goal(self, goal: Any) -> GoalResponse:
        """Accept a goal, even one to refuse: only an accepted goal has a result."""
        self._refusal = None
        try:
            self._scene = self._check(goal)
        except Refused as refused:
            self._refusal = refused
            self._node.get_logger().warning(
                f"goal for '{goal.agent[:80]}' (round {goal.round}) refused: {refused}"
            )
            return GoalResponse.ACCEPT if self._may_explain() else GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _may_explain(self) -> bool:
        """Return whether one more refused goal may have a result, which rclpy stores."""
        now, times = time.monotonic(), self._refused_at
        if len(times) == MOST_REFUSALS and now - times[0] < RESULT_TIMEOUT_S:
            return False
        times.append(now)
        return True

    def _begin(self, handle: Any) -> None:
        """Begin a goal whose acceptance is being sent; a cancel sent with it is handled first."""
        refusal, self._refusal = self._refusal, None
        if refusal is not None:
            handle.execute(lambda goal: _refuse(goal, refusal))
            return
        if not self._market:
            self._complete(handle.request)
        self._handle = handle
        self.goal = handle.request
        handle.execute()
        self._notify(self.on_begin, self.goal)

    def _check(self, goal: Any) -> Scene:
        if self._shutting_down:
            raise Refused(RefusalCode.SHUTTING_DOWN, "this host is being stopped")
        if self._withdrawing:
            raise Refused(
                RefusalCode.UNREGISTERED, "the market has refused this host, so it takes no goals"
            )
        if self.busy:
            raise Refused(RefusalCode.BUSY, f"{self.goal.agent} is running; one tree at a time")
        return self._check_award(goal) if self._market else self._check_direct(goal)

    def _check_award(self, goal: Any) -> Scene:
        if goal.host_instance not in ("", self._instance):
            raise Refused(
                RefusalCode.WRONG_INSTANCE,
                f"meant for instance '{goal.host_instance}', this is '{self._instance}'",
            )
        if not hmac.compare_digest(bytes(goal.token), self._token):
            raise Refused(
                RefusalCode.NOT_THE_MARKET,
                "it lacks the token of the market that registered this host, and only that "
                "market sends it goals; to announce a scene there, type 'bt-agents trigger', and "
                "to name the agent for it, 'bt-agents award'",
            )
        if self._award_monitor.is_over(RunKey.of(goal)):
            raise Refused(
                RefusalCode.OVER, f"the market has gone on from round {goal.round} already"
            )
        member = self._registry.member(goal.agent)
        if not member.agent_id or member.agent_id != goal.agent_id:
            raise Refused(
                RefusalCode.WRONG_ID,
                f"{goal.agent} has the id {member.agent_id}, not {goal.agent_id}",
            )
        return scene_from_msg(goal.scene, self._registry.space)

    def _check_direct(self, goal: Any) -> Scene:
        """Check a goal without a market; missing fields of its scene mean an unknown person."""
        if not goal.agent:
            known = ", ".join(self._registry.members) or "none"
            raise Refused(RefusalCode.EMPTY, f"the goal names no agent; there are: {known}")
        obstacle = self._registry.member(goal.agent).obstacle or self.environment.clock.obstacle()
        if obstacle:
            raise Refused(RefusalCode.UNAVAILABLE, f"{goal.agent} cannot run: {obstacle}")
        return partial_scene_from_msg(goal.scene, self._registry.space)

    def _complete(self, goal: Any) -> None:
        """Fill in what a market would have set: the identity of the run and its whole scene."""
        self._runs_begun += 1
        goal.epoch, goal.round = self._instance, self._runs_begun
        goal.host_instance, goal.scene = self._instance, scene_to_msg(self._scene)

    def _answer_cancel(self, handle: Any) -> CancelResponse:
        if self._handle is None or handle != self._handle:
            return CancelResponse.REJECT
        if self._stop is None:
            if self._market:
                self.cancel("the market stopped it", cause=StopCause.BY_MARKET)
            else:
                self.cancel("the program that started it stopped it")
            self._tick()
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> RunAgent.Result:
        goal = handle.request
        self._result_future = Future(executor=self._node.executor)
        try:
            self._start(goal)
            result: RunResult = await self._result_future
        except Exception as error:
            result = not_begun(error)
        finally:
            stop, self._stop, self._cancellation = self._stop, None, None
            self.goal = self.run = self._handle = None
            self._free_since = time.monotonic()
            self._stepping = False
            self.control.end()
            self.environment.clock.go_on()
        self._node.get_logger().info(
            f"round {goal.round}: {goal.agent} {result.outcome.value}: {result.message}"
        )
        answer = run_result_to_msg(result)
        answer.token = goal.token
        if stop is not None and result.outcome is TreeOutcome.CANCELLED:
            answer.stop_cause, answer.host_reason = int(stop.cause), stop.host_reason
        self._notify(self.on_end, goal, answer)
        _close(handle, result)
        if self._unpublished is not None:
            # Two tasks deep, so that the callback that sends the result runs first.
            begin = self._node.executor.create_task
            begin(begin, self._publish_stopped, goal, *self._unpublished)
            self._unpublished = None
        return answer

    def _start(self, goal: Any) -> None:
        member = self._registry.member(goal.agent)
        self.run = Run(
            member.spec,
            space=self._registry.space,
            scene=self._scene,
            profile=member.profile_for(self._scene),
            live=self._begin_live(self._scene),
            tunables=member.tunables,
            environment=self.environment,
            steady=time.monotonic,
            host=self._host,
        )
        self.run.period_s = self._period_s
        self.run.set_breakpoints(self.control.breakpoints.get(goal.agent, ()))
        self._scheduler = TickScheduler(self._period_s, time.monotonic())
        self.control.begin(RunKey.of(goal))
        self._notify(self.on_start, self.run)
        self._tick()
        self._node.get_logger().info(f"round {goal.round}: {goal.agent} runs")

    def _notify(self, listeners: Sequence[Callable[..., None]], *what: Any) -> None:
        """Call listeners; their errors must not keep the result from the market."""
        for listener in listeners:
            try:
                listener(*what)
            except Exception:
                self._node.get_logger().error(traceback.format_exc())

    def _on_arrival(self) -> None:
        if self.run is not None:
            self._scheduler.request(time.monotonic())
            self._set_timer()

    def _tick_soon(self) -> None:
        self._scheduler.now(time.monotonic())
        self._set_timer()

    @property
    def _is_paused(self) -> bool:
        return self.control.paused and self._stop is None and not self._stepping

    def _set_timer(self) -> None:
        if self._is_paused:
            return
        now = time.monotonic()
        wait_s = self._scheduler.due - now
        if self._stop is None:
            wait_s = max(wait_s, self._hold_off_s(now))
        if wait_s <= 0.0 and not self._tick_queued:
            self._tick_queued = True
            self._timer.cancel()
            self._node.executor.create_task(self._tick_if_queued)
        if self._tick_queued:
            return
        # A period of zero would disable the timer.
        self._timer.timer_period_ns = max(1, int(wait_s * 1e9))
        self._timer.reset()

    def _tick_if_queued(self) -> None:
        """Tick, unless a cancel has done so since the request."""
        if self._tick_queued:
            self._tick()

    def _tick(self) -> None:
        self._tick_queued = False
        self._timer.cancel()
        run = self.run
        if run is None or run.result is not None or self._is_paused:
            return
        self.tick_began = began = time.monotonic()
        if self._hold_off_s(began) and self._stop is None:
            # The market may have given the run to another agent; its heartbeat will show that.
            self._set_timer()
            return
        self._scheduler.started()
        try:
            self._advance(run)
        except Exception as error:
            # Exceptions of nodes become a FAILURE; this one is an engine fault and ends the run.
            self._end(self._give_up(run, f"{type(error).__name__}: {error}"))
            return
        self._after_tick(run)
        if run.result is not None:
            self._end(run.result)
            return
        self._scheduler.finished(began, time.monotonic(), run.deadline)
        self._set_timer()

    def _after_tick(self, run: Run) -> None:
        self._stepping = False
        if not run.ticking:
            self.control.end_ticking()
            self.environment.clock.go_on()
        elif self.control.on_tick(run.held):
            self.environment.clock.stop()
        self._notify(self.on_tick)

    def _end(self, result: RunResult) -> None:
        self._timer.cancel()
        self._result_future.set_result(result)

    def _give_up(self, run: Run, reason: str) -> RunResult:
        self._node.get_logger().error(traceback.format_exc())
        try:
            return run.give_up(reason)
        except Exception:
            self._node.get_logger().error(traceback.format_exc())
            return RunResult(outcome=TreeOutcome.FAILED, message=reason)

    def _advance(self, run: Run) -> None:
        self._ticked = self._node.get_clock().now()
        stopped = self._cancel_now(run, self._stop) if self._stop is not None else []
        is_over = run.result is not None
        ticked = run.tick()
        if is_over:
            # The canceller waits for the result, not for the changes of a thousand nodes.
            self._unpublished = (run, stopped, self._ticked)
        elif stopped or ticked:
            self._publish(run, [*stopped, *ticked])
        if run.overrun is not None:
            self._report_overrun(run, run.overrun)

    def _cancel_now(self, run: Run, stop: _Stop) -> Sequence[StatusChange]:
        reason, clean_up = stop.reason, stop.clean_up
        if self._hold_off_s(time.monotonic()):
            # Another agent may control the robot by now.
            stall_s = self._award_monitor.stall.last_stall_s
            reason += f", after this host had been held up for {stall_s:.1f} s"
            clean_up = False
            # A tree that was already stopped does not get the longer reason.
            stop.host_reason = stop.host_reason or not stop.begun
        stop.begun = True
        return run.cancel(reason, clean_up=clean_up, cancellation=stop.cancellation)

    def _hold_off_s(self, now: float) -> float:
        """Return how long not to tick, because the run may have been given away [s]."""
        if not self._market:
            return 0.0
        return self._award_monitor.hold_off_s(RunKey.of(self.goal), now)

    def _report_overrun(self, run: Run, overrun: Overrun) -> None:
        self._node.get_logger().warning(
            f"{run.spec.name}: tick {run.ticks} took {overrun.took_s * 1e3:.0f} ms, there are "
            f"{self._period_s * 1e3:.0f} ms between two; {overrun.slowest} alone took "
            f"{overrun.slowest_s * 1e3:.0f} ms ({run.overruns} such ticks in this run so far)",
            throttle_duration_sec=_OVERRUNS_REPORTED_S,
        )

    def _publish(self, run: Run, changes: Sequence[StatusChange]) -> None:
        status = tree_status(self._ticked.to_msg(), self.goal, self._instance, run, changes)
        self._status.publish(status)
        if self._handle.is_active:
            self._handle.publish_feedback(RunAgent.Feedback(status=status))

    def _publish_stopped(
        self, goal: Any, run: Run, changes: Sequence[StatusChange], ticked: Time
    ) -> None:
        """Publish the changes of a cancel after its result is sent."""
        if changes:
            stamp = ticked.to_msg()
            self._status.publish(tree_status(stamp, goal, self._instance, run, changes))


def _refuse(handle: Any, refusal: Refused) -> RunAgent.Result:
    handle.abort()
    message = printable_line(refusal.reason)
    return RunAgent.Result(outcome=RunAgent.Result.REFUSED, code=refusal.code, message=message)


def _close(handle: Any, result: RunResult) -> None:
    if result.outcome is TreeOutcome.SUCCEEDED:
        handle.succeed()
    elif result.outcome is TreeOutcome.CANCELLED and handle.is_cancel_requested:
        handle.canceled()
    else:
        handle.abort()
