# SPDX-License-Identifier: Apache-2.0
"""A marketplace node, fake hosts that a test controls, and the market's messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from active_nodes import active_market
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import (
    Auction,
    Bids,
    CallForBids,
    Heartbeat,
    MarketStatus,
    Run,
    Scene,
    SceneEnd,
)
from bt_agents_interfaces.srv import CancelRun, RegisterHost
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg, to_time
from market_harness import EXPRESS, GUIDE, SPACE, scene

NEAR, FAR = (4.0, 1.5, 3.0), (3.0, 5.0, 3.5)


HOST_TIME = to_time(3600.0)
"""Now by the clock of a fake host, which is not the clock of the market."""


def is_recorded(scene_id: str, ends: Sequence[SceneEnd], auctions: Sequence[Auction]) -> bool:
    """Return whether the end of a scene and the auction of its last round, if any, are there."""
    rounds = {end.round for end in ends if end.scene_id == scene_id}
    return bool(rounds) and rounds <= {0, *(auction.round for auction in auctions)}


class FakeHost(Node):
    """A host under the control of a test."""

    def __init__(self, name: str = "agents", **bids: tuple[float, ...]) -> None:
        super().__init__(name)
        self.host = self.get_fully_qualified_name()
        self.bids_of = bids or {GUIDE: NEAR, EXPRESS: FAR}
        self.agent_ids: list[int] = []
        self.token: Any = [0] * 16
        self.silent = False
        self.message = "as told"
        self.refuses: set[str] = set()
        self.explains: set[str] = set()
        self.distort: Callable[[Bids], None] = lambda _: None
        self.calls: list[CallForBids] = []
        self.goal: Any = None
        self.log: list[str] = []
        self.ended: Any = None
        self.stopped_early = False
        self.answers = self.create_publisher(Bids, "bt_agents/bids", qos.EVENTS)
        self.heartbeats = self.create_publisher(Heartbeat, "~/heartbeat", qos.EVENTS)
        self.create_subscription(CallForBids, "bt_agents/calls", self.answer, qos.EVENTS)
        self.create_timer(0.1, self.beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.server = ActionServer(
            self,
            RunAgent,
            "~/run",
            execute_callback=self.execute,
            goal_callback=self.judge,
            cancel_callback=self.stop,
            goal_service_qos_profile=qos.SERVICE,
            result_service_qos_profile=qos.SERVICE,
            cancel_service_qos_profile=qos.SERVICE,
            result_timeout=5,
        )

    def request(self, **changes: Any) -> RegisterHost.Request:
        values = {
            "host": self.host,
            "host_instance": "first",
            "run_action": f"{self.host}/run",
            "heartbeat": f"{self.host}/heartbeat",
            "parameters": list(SPACE.names),
            "agents": list(self.bids_of),
            "token": self.token,
            "stamp": HOST_TIME,
        }
        return RegisterHost.Request(**(values | changes))

    def take(self, answer: RegisterHost.Response) -> None:
        """Take the answer to its registration."""
        self.agent_ids, self.token = list(answer.agent_ids), answer.token

    def beat(self) -> None:
        goal = self.goal
        self.heartbeats.publish(
            Heartbeat(
                host=self.host,
                host_instance="first",
                token=self.token,
                epoch=goal.epoch if goal else "",
                round=goal.round if goal else 0,
            )
        )

    def answer(self, call: CallForBids) -> None:
        self.calls.append(call)
        if self.silent:
            return
        names = [name for name in self.bids_of if name not in call.excluded]
        ids = dict(zip(self.bids_of, self.agent_ids, strict=True))
        message = Bids(
            epoch=call.epoch,
            round=call.round,
            host=self.host,
            host_instance="first",
            token=self.token,
            agents=names,
            agent_ids=[ids[name] for name in names],
            vectors=[value for name in names for value in self.bids_of[name]],
        )
        self.distort(message)
        self.answers.publish(message)

    def judge(self, goal: Any) -> GoalResponse:
        if goal.agent in self.refuses or self.goal is not None:
            return GoalResponse.REJECT
        if goal.agent not in self.explains:
            self.goal, self.stopped_early = goal, False
        return GoalResponse.ACCEPT

    def stop(self, _handle: Any) -> CancelResponse:
        if self.ended is not None and not self.ended.done():
            self.ended.set_result(RunAgent.Result.CANCELLED)
        else:
            self.stopped_early = True
        return CancelResponse.ACCEPT

    async def execute(self, handle: Any) -> RunAgent.Result:
        if handle.request.agent in self.explains:
            handle.abort()
            return RunAgent.Result(
                outcome=RunAgent.Result.REFUSED, code="BUSY", message="another tree runs"
            )
        if self.stopped_early:
            self.log.append(f"never began {self.goal.agent}")
            self.goal = None
            handle.canceled()
            return RunAgent.Result(
                outcome=RunAgent.Result.CANCELLED, message="never began", token=self.token
            )
        self.log.append(f"start {self.goal.agent}")
        self.beat()
        self.ended = Future(executor=self.executor)
        outcome = await self.ended
        self.log.append(f"end {self.goal.agent}")
        self.goal = None
        if outcome == RunAgent.Result.CANCELLED:
            handle.canceled()
        else:
            handle.succeed()
        return RunAgent.Result(outcome=outcome, message=self.message, ticks=3, token=self.token)

    def finish(self, outcome: int = RunAgent.Result.SUCCEEDED) -> None:
        self.ended.set_result(outcome)

    def destroy_node(self) -> None:
        self.server.destroy()
        super().destroy_node()


class MarketNodeHarness:
    """A market with the paper's rule, its messages, and its services."""

    def __init__(
        self,
        ros: Any,
        overrides_file: Path | None = None,
        scenes_file: Path | None = None,
        **parameters: Any,
    ) -> None:
        self.ros = ros
        parameters = {"collect_deadline": 0.1, "strategy": "manhattan"} | parameters
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.market = ros.add(
            active_market(
                SPACE,
                "epoch",
                overrides_file=overrides_file,
                scenes_file=scenes_file,
                parameter_overrides=overrides,
            )
        )
        self.auctions = ros.collect(Auction, "bt_agents/auctions", qos.HISTORY)
        self.runs = ros.collect(Run, "bt_agents/runs", qos.HISTORY)
        self.ends = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.FACTS)
        self.statuses = ros.collect(MarketStatus, "bt_agents/market", qos.FACT)
        self.scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
        self.registering = ros.node.create_client(RegisterHost, "marketplace/register")
        self.cancelling = ros.node.create_client(CancelRun, "marketplace/cancel")
        ros.until(lambda: self.scenes.get_subscription_count() and self.statuses)

    def host(self, name: str = "agents", **bids: tuple[float, ...]) -> FakeHost:
        host = self.ros.add(FakeHost(name, **bids))
        answer = self.ros.call(self.registering, host.request())
        assert answer.accepted, answer.message
        host.take(answer)
        return host

    def busy_host(self) -> FakeHost:
        """Return a host whose agent runs for the scene ``s1``."""
        host = self.host()
        self.scene()
        self.until_event(Run.STARTED)
        return host

    def scene(self, scene_id: str = "s1", *values: float, urgent: bool = False) -> None:
        self.scenes.publish(scene_to_msg(scene(scene_id, *values, urgent=urgent)))

    def cancel(self, **fields: Any) -> CancelRun.Response:
        return self.ros.call(self.cancelling, CancelRun.Request(**fields))

    def until_event(self, event: int, count: int = 1) -> Run:
        def found() -> list[Run]:
            return [run for run in self.runs if run.event == event]

        self.ros.until(lambda: len(found()) >= count)
        return found()[count - 1]

    def until_over(self, scene_id: str = "s1") -> MarketStatus:
        """Wait until a scene is over and the records of its last round are received."""
        self.ros.until(
            lambda: (
                self.statuses[-1].finished_scene_id == scene_id
                and is_recorded(scene_id, self.ends, self.auctions)
            )
        )
        return self.statuses[-1]
