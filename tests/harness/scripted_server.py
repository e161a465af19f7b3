# SPDX-License-Identifier: Apache-2.0
"""Action and service servers that are late, stubborn or dead, as a test requires."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Empty

from bt_agents_interfaces.action import Say
from bt_agents_ros import qos
from bt_agents_ros.types import fill


@dataclass(kw_only=True)
class Script:
    """How a server treats a goal; may change between goals.

    Attributes:
        accept_s: Delay before it answers a goal [s]; None waits for :meth:`Served.accept`.
        rejects: Whether it rejects the goal.
        finish_s: Time from acceptance to the end [s]; None waits for :meth:`Served.finish`.
        aborts: Whether the goal ends as aborted.
        result: Fields of the result.
        feedback: Times from acceptance [s], and the feedback fields at these times.
        on_cancel: ``stops``; ``refuses``; ``ignores``, which accepts and continues; or ``hangs``,
            which never answers.
        cancel_s: Time from the cancel to the end, if it stops [s].
    """

    accept_s: float | None = 0.0
    rejects: bool = False
    finish_s: float | None = 0.0
    aborts: bool = False
    result: Mapping[str, Any] = field(default_factory=dict)
    feedback: tuple[tuple[float, Mapping[str, Any]], ...] = ()
    on_cancel: str = "stops"
    cancel_s: float = 0.0


class Served:
    """One goal that a server has received.

    Attributes:
        request: The goal's request.
        cancels: Number of cancel requests for it.
        handle: Its handle, when it is accepted.
        outcome: ``""`` while it runs; ``rejected``, ``succeeded``, ``aborted``, ``cancelled``.
    """

    def __init__(self, request: Any, script: Script, executor: Any) -> None:
        self.request = request
        self.script = script
        self.cancels = 0
        self.outcome = ""
        self.handle: Any = None
        self.accepted: Future = Future(executor=executor)
        self.ended: Future = Future(executor=executor)

    def accept(self) -> None:
        """Answer the goal now, according to its script."""
        if not self.accepted.done():
            self.accepted.set_result(None)

    def finish(self) -> None:
        """End the goal now, according to its script."""
        self._end("aborted" if self.script.aborts else "succeeded")

    def stop(self) -> None:
        """End the goal now as cancelled."""
        self._end("cancelled")

    def _end(self, outcome: str) -> None:
        if not self.ended.done():
            self.ended.set_result(outcome)


class _ServerNode(Node):
    """Node that also destroys its action server when it leaves the graph."""

    server: Any = None

    def destroy_node(self) -> None:
        """Leave the graph."""
        if self.server is not None:
            self.server.destroy()
        super().destroy_node()


class ScriptedServer:
    """An action server on a node of its own.

    Args:
        ros: The nodes of the test; see ``graph.py``.
        name: Name of the action.
        kind: Type of the action.
        script: How it treats goals.
        node: Name of the node; by default derived from the action.

    Attributes:
        goals: All goals so far, in order.
    """

    def __init__(
        self,
        ros: Any,
        name: str = "say",
        *,
        kind: Any = Say,
        script: Script | None = None,
        node: str = "",
    ) -> None:
        self.script = script or Script()
        self.goals: list[Served] = []
        self._ros = ros
        self._kind = kind
        self._waiting: list[Served] = []
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._group = ReentrantCallbackGroup()
        self.node: Any = ros.add(_ServerNode(node or f"server_of_{name.replace('/', '_')}"))
        self.node.server = ActionServer(
            self.node,
            kind,
            name,
            execute_callback=self._execute,
            goal_callback=self._answer,
            cancel_callback=self._cancel,
            callback_group=self._group,
            goal_service_qos_profile=qos.SERVICE,
            result_service_qos_profile=qos.SERVICE,
            cancel_service_qos_profile=qos.SERVICE,
            feedback_pub_qos_profile=qos.EVENTS,
            result_timeout=5,
        )
        self._heart: Any = None
        self._beats: Any = None

    def beat(self, topic: str = "robot/heartbeat", every_s: float = 0.1) -> None:
        """Publish a heartbeat from now on."""
        self._heart = self.node.create_publisher(Empty, topic, qos.SENSOR)
        self._beats = self._timer(every_s, lambda: self._heart.publish(Empty()))

    def fall_silent(self) -> None:
        """Stop the heartbeat, but stay on the graph."""
        self._beats.cancel()

    def die(self) -> None:
        """Leave the graph without notice."""
        self._ros.remove(self.node)

    async def _answer(self, request: Any) -> GoalResponse:
        served = Served(request, self.script, self._ros.executor)
        self.goals.append(served)
        self._later(served.script.accept_s, served.accept)
        await served.accepted
        if served.script.rejects:
            served.outcome = "rejected"
            return GoalResponse.REJECT
        self._waiting.append(served)
        return GoalResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        served = self._of(handle)
        served.handle = handle
        script = served.script
        for after_s, values in script.feedback:
            self._later(after_s, lambda told=values: self._tell(handle, told))
        self._later(script.finish_s, served.finish)
        served.outcome = await served.ended
        ends = {"succeeded": handle.succeed, "aborted": handle.abort, "cancelled": handle.canceled}
        ends[served.outcome]()
        result = self._kind.Result()
        fill(result, script.result)
        return result

    async def _cancel(self, handle: Any) -> CancelResponse:
        served = self._of(handle)
        served.cancels += 1
        script = served.script
        match script.on_cancel:
            case "refuses":
                return CancelResponse.REJECT
            case "hangs":
                await Future(executor=self._ros.executor)
            case "stops":
                self._later(script.cancel_s, served.stop)
        return CancelResponse.ACCEPT

    def _of(self, handle: Any) -> Served:
        return next(one for one in self.goals if one.request is handle.request)

    def _tell(self, handle: Any, values: Mapping[str, Any]) -> None:
        message = self._kind.Feedback()
        fill(message, values)
        handle.publish_feedback(message)

    def _later(self, seconds: float | None, do: Callable[[], None]) -> None:
        """Call something after a delay: at once for 0, never for None."""
        if seconds is None:
            return
        if seconds <= 0.0:
            do()
            return

        def once() -> None:
            timer.cancel()
            do()

        timer = self._timer(seconds, once)

    def _timer(self, period_s: float, do: Callable[[], None]) -> Any:
        return self.node.create_timer(period_s, do, callback_group=self._group, clock=self._steady)


class ScriptedService:
    """A service on a node of its own, which answers when told to.

    Args:
        ros: The nodes of the test.
        kind: Type of the service.
        name: Name of the service.
        answer: Fills in the response.

    Attributes:
        requests: All requests so far, in order.
        patience: One future per request; completing it sends the response.
    """

    def __init__(self, ros: Any, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
        self.requests: list[Any] = []
        self.patience: list[Future] = []
        self._ros = ros
        self._fill = answer
        self.node: Any = ros.add(rclpy.create_node(f"service_of_{name.replace('/', '_')}"))
        self.node.create_service(
            kind,
            name,
            self._answer,
            qos_profile=qos.SERVICE,
            callback_group=ReentrantCallbackGroup(),
        )

    def answer(self, number: int) -> None:
        """Answer a request by its index, from 0."""
        self.patience[number].set_result(None)

    async def _answer(self, request: Any, response: Any) -> Any:
        self.requests.append(request)
        self.patience.append(Future(executor=self._ros.executor))
        await self.patience[-1]
        self._fill(request, response)
        return response
