# SPDX-License-Identifier: Apache-2.0
"""Registers the host with the market, also after restarts of either, and reports ended runs."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from bt_agents.host.agent_registry import AgentRegistry
from bt_agents.host.run_messages import cancellation_from_msg
from bt_agents.host.run_monitors import MarketLease
from bt_agents.host.run_server import RunServer
from bt_agents_core.liveness import STALL_S
from bt_agents_core.run_key import RunKey
from bt_agents_core.stop_cause import StopCause, StoppedBy
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import MarketHeartbeat, MarketStatus, Run
from bt_agents_interfaces.srv import RegisterHost
from bt_agents_ros import qos
from bt_agents_ros.calls import Calls
from bt_agents_ros.limits import MOST_UNREPORTED
from bt_agents_ros.messages import header_at
from bt_agents_ros.parameters import declare_and_watch, describe
from bt_agents_ros.timers import steady_timer

MARKET_LEASE = "market_lease"
"""Parameter of hosts: how long a run continues without a sign of life of its market."""

NO_TOKEN = [0] * 16
"""Token of a host that no market has registered."""

_REMEMBERED = 50
_LIMIT_S = 1.0
_MOST_UNANSWERED = 2
"""Number of unanswered requests in a row after which the client is created again."""

_RETRY_S = 1.0
_POLL_S = 0.02
_ALIVE_S = 0.3
"""Longest silence after which a market still counts as alive and announces run ends [s]."""

_LOG_PERIOD_S = 30.0


class UnreportedRuns:
    """Ended runs of a host that their market has not closed yet.

    A market closes a run by announcing that it has ended, was lost or was refused. Beyond
    :data:`MOST_UNREPORTED` runs, the oldest are dropped.
    """

    def __init__(self) -> None:
        self._runs: dict[RunKey, Run] = {}
        self._closed: deque[RunKey] = deque(maxlen=_REMEMBERED)
        self._stops: deque[Run] = deque(maxlen=MOST_UNREPORTED)

    def store(self, run: Run) -> None:
        """Store an ended run, unless its market has already closed it.

        If its market stopped it, the run says by whom and why, once the market has reported that.
        """
        key = RunKey.of(run)
        if key in self._closed:
            return
        self._runs[key] = run
        for stop in self._stops:
            self._explain(stop)
        if len(self._runs) > MOST_UNREPORTED:
            del self._runs[next(iter(self._runs))]

    def on_run_event(self, run: Run) -> None:
        """Remove a run that its market has closed, or record who stops a run."""
        if run.event in (Run.ENDED, Run.REFUSED):
            self._close(run)
        elif run.event == Run.CANCELLING:
            self._stops.append(run)
            self._explain(run)

    def of_others(self, epoch: str) -> list[Run]:
        """Return the runs of markets other than this one, oldest first."""
        return [run for run in self._runs.values() if run.epoch != epoch]

    def waits(self, epoch: str) -> bool:
        """Return whether a run of this market is not closed yet."""
        return any(run.epoch == epoch for run in self._runs.values())

    def acknowledge(self, runs: list[Run]) -> None:
        """Remove runs that a market has recorded."""
        for run in runs:
            self._close(run)

    def _explain(self, stop: Run) -> None:
        run = self._runs.get(RunKey.of(stop))
        if run is not None and run.stop_cause == Run.BY_MARKET:
            run.stopped_by = int(StoppedBy.of(stop.stopped_by))
            run.stop_reason = cancellation_from_msg(stop).reason

    def _close(self, run: Run) -> None:
        key = RunKey.of(run)
        self._runs.pop(key, None)
        self._closed.append(key)


class MarketRegistration:
    """Registration of a host's agents; the host's action is open only while it is registered.

    A run whose market falls silent is cancelled. Its end, and every other run end that its market
    has not announced, is reported to the next market.

    Args:
        token: Token of the previous start in the same process.
        slowness: Factor for the lease of the market; see :func:`declare_slow_network`.
        ready: Returns whether the host may register; it waits until then.
        matched: Returns whether calls and bids are matched in both directions; if not, the host
            registers after a second anyway.
        changed: Called after the market has accepted or refused the host or some of its agents.

    Attributes:
        epoch: Epoch of the last market that answered; empty before the first.
        accepted: Whether it has registered the host.
        token: Token of the last registration, which proves that a message is from this host.
    """

    def __init__(
        self,
        node: Node,
        registry: AgentRegistry,
        runs: RunServer,
        instance: str,
        token: list[int],
        slowness: float,
        ready: Callable[[], bool],
        matched: Callable[[], bool],
        changed: Callable[[], None],
    ) -> None:
        self.epoch = ""
        self.accepted = False
        self.token = token
        self._node = node
        self._registry = registry
        self._runs = runs
        self._instance = instance
        self._ready = ready
        self._matched = matched
        self._changed = changed
        self._registering = False
        self._deferred: Callable[[], None] | None = None
        self._stale = False
        self._asked_at = 0.0
        self._heard_at = -math.inf
        self._checked_at = time.monotonic()
        self._unreported = UnreportedRuns()
        self._slowness = slowness
        self._lease = MarketLease(self._declare_lease())
        self._calls = Calls(node)
        self._unanswered = 0
        self._client = self._create_client()
        node.create_subscription(MarketStatus, "bt_agents/market", self._on_status, qos.FACT)
        node.create_subscription(
            MarketHeartbeat, "marketplace/heartbeat", self._on_heartbeat, qos.HEARTBEATS
        )
        node.create_subscription(Run, "bt_agents/runs", self._on_run_event, qos.HISTORY)
        runs.on_begin.append(lambda goal: self._lease.begin(goal.epoch, time.monotonic()))
        runs.on_end.append(self._on_run_end)
        steady_timer(node, _RETRY_S, self._retry)
        self._pending_epoch = ""
        self._match_timer = steady_timer(node, _POLL_S, self._register_matched, running=False)

    @property
    def complete(self) -> bool:
        """True when the market has accepted every agent of this host."""
        return bool(self.epoch) and all(m.agent_id for m in self._registry.members.values())

    @property
    def awaits_end(self) -> bool:
        """True while the market is alive and has not announced the end of the last run."""
        alive = time.monotonic() - self._heard_at < _ALIVE_S
        return alive and self._unreported.waits(self.epoch)

    def defer(self, action: Callable[[], None]) -> bool:
        """Defer an action until the market answers; return False if no registration is pending.

        A call for bids may arrive before the answer to the registration has been read.
        """
        if self._registering:
            self._deferred = action
        return self._registering

    def refresh(self) -> None:
        """Register the current agents, if a market is known."""
        if self.epoch:
            self._stale = self._registering
            self._register(self.epoch)

    def _create_client(self) -> Client:
        return self._node.create_client(
            RegisterHost, "marketplace/register", qos_profile=qos.SERVICE
        )

    def _declare_lease(self) -> float:
        def take(seconds: float) -> None:
            self._lease.lease_s = seconds * self._slowness

        meaning = "a tree is stopped when the market that started it is silent for this long [s]"
        limits = describe(meaning, minimum=0.5, maximum=10.0)
        return self._slowness * float(
            declare_and_watch(self._node, MARKET_LEASE, 1.0, limits, take)
        )

    def _on_run_end(self, goal: Any, result: RunAgent.Result) -> None:
        self._lease.end()
        self._unreported.store(
            Run(
                header=header_at(self._node.get_clock().now().to_msg()),
                epoch=goal.epoch,
                round=goal.round,
                event=Run.ENDED,
                outcome=result.outcome,
                stop_cause=result.stop_cause,
                scene=goal.scene,
                agent=goal.agent,
                agent_id=goal.agent_id,
                host=str(self._node.get_fully_qualified_name()),
                host_instance=self._instance,
                message=result.message,
                orphans=result.orphans,
                ticks=result.ticks,
                overruns=result.overruns,
                duration_s=result.duration_s,
            )
        )
        if goal.epoch != self.epoch:
            self.refresh()

    def _on_run_event(self, run: Run) -> None:
        self._unreported.on_run_event(run)
        if run.event == Run.CANCELLING:
            self._runs.explain_stop(RunKey.of(run), cancellation_from_msg(run))

    def _on_heartbeat(self, heartbeat: MarketHeartbeat) -> None:
        now = time.monotonic()
        if heartbeat.epoch == self.epoch:
            self._heard_at = now
        self._lease.on_heartbeat(heartbeat.epoch, now)
        self._runs.on_market_heartbeat(heartbeat)
        # With two markets of one name, the host must not register at each heartbeat.
        if heartbeat.epoch != self.epoch and now - self._asked_at >= _RETRY_S:
            self._register(heartbeat.epoch)

    def check_lease(self) -> None:
        """Cancel a run whose market is silent; called with each heartbeat, to detect stalls."""
        now = time.monotonic()
        self._lease.extend(self._checked_at, now)
        if now - self._checked_at > STALL_S:
            # Another start of this host may have taken its place.
            self.refresh()
        self._checked_at = now
        silence = self._lease.silence(now)
        if silence:
            self._runs.cancel(
                f"its market has been silent for {silence:.1f} s", cause=StopCause.MARKET_LOST
            )

    def _on_status(self, status: MarketStatus) -> None:
        if status.epoch != self.epoch:
            self._register(status.epoch)

    def _retry(self) -> None:
        if self.epoch and any(member.refusal for member in self._registry.members.values()):
            self._register(self.epoch)

    def _register(self, epoch: str) -> None:
        if self._registering:
            return
        self._registering = True
        self._asked_at = time.monotonic()
        self._pending_epoch = epoch
        self._register_matched()

    def _register_matched(self) -> None:
        """Register as soon as no bid can be lost."""
        waits = not self._matched() and time.monotonic() - self._asked_at < _LIMIT_S
        if waits or not self._ready():
            self._match_timer.reset()
            return
        self._match_timer.cancel()
        epoch = self._pending_epoch
        host = str(self._node.get_fully_qualified_name())
        names = list(self._registry.members)
        request = RegisterHost.Request(
            host=host,
            host_instance=self._instance,
            token=self.token,
            # rclpy does not remap actions, so this name is not remapped either.
            run_action=f"{host}/run",
            heartbeat=self._node.resolve_topic_name("~/heartbeat"),
            parameters=list(self._registry.space.names),
            agents=names,
            unreported=self._unreported.of_others(epoch),
            stamp=self._node.get_clock().now().to_msg(),
        )
        self._calls.call(
            self._client,
            request,
            deadline_s=_LIMIT_S,
            on_answer=lambda answer: self._handle_answer(request, answer),
            on_failure=lambda reason: self._handle_failure(epoch, reason),
        )

    def _handle_answer(self, request: RegisterHost.Request, answer: RegisterHost.Response) -> None:
        self._registering = False
        self._unanswered = 0
        self._apply_answer(request, answer)
        if self._stale or (answer.accepted and self._unreported.of_others(answer.epoch)):
            self.refresh()
        deferred, self._deferred = self._deferred, None
        if deferred is not None:
            deferred()

    def _apply_answer(self, request: RegisterHost.Request, answer: RegisterHost.Response) -> None:
        names = list(request.agents)
        before, self.accepted = self.accepted, answer.accepted
        if not answer.accepted:
            if self.epoch != answer.epoch:
                self._node.get_logger().error(f"the market refuses this host: {answer.message}")
            self.epoch = answer.epoch
            self._runs.withdraw(f"the market refuses this host: {answer.message}")
            refused = [answer.message] * len(names)
            self._apply_registration(names, [0] * len(names), refused, changed=before)
            return
        self.epoch = answer.epoch
        self.token = answer.token.tolist()
        self._runs.open(bytes(answer.token))
        if self._runs.busy and self._runs.goal.epoch != answer.epoch:
            self._runs.cancel("its market is gone", cause=StopCause.MARKET_LOST)
        # A market does not take over its own runs.
        self._unreported.acknowledge([r for r in request.unreported if r.epoch != answer.epoch])
        self._apply_registration(names, answer.agent_ids, answer.reasons, changed=not before)

    def _handle_failure(self, epoch: str, reason: str) -> None:
        self._registering = False
        self._node.get_logger().warning(
            f"registration at market {epoch}: {reason}; trying again",
            throttle_duration_sec=_LOG_PERIOD_S,
        )
        self._unanswered += 1
        if self._unanswered >= _MOST_UNANSWERED:
            # After a long pause, the middleware may have dropped one side of the connection.
            self._unanswered = 0
            self._node.destroy_client(self._client)
            self._client = self._create_client()
        self._register(epoch)

    def _apply_registration(
        self, names: Sequence[str], ids: Sequence[int], reasons: Sequence[str], *, changed: bool
    ) -> None:
        before = {n: (m.agent_id, m.refusal) for n, m in self._registry.members.items()}
        if not len(names) == len(ids) == len(reasons):
            self._node.get_logger().error("the market's answer to the registration is malformed")
            return
        self._registry.apply_registration(names, ids, reasons)
        after = {n: (m.agent_id, m.refusal) for n, m in self._registry.members.items()}
        for name, (_, refusal) in after.items():
            # A refusal of the host has been logged already.
            if self.accepted and refusal and refusal != before[name][1]:
                self._node.get_logger().error(f"agent '{name}' is not registered: {refusal}")
        if changed or after != before:
            self._changed()
