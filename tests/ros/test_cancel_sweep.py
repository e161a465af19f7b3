# SPDX-License-Identifier: Apache-2.0
"""Cancels at every millisecond around acceptance, rejection and completion of a real goal."""

from __future__ import annotations

import time
import uuid
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from unique_identifier_msgs.msg import UUID

from bt_agents.engine.run import Run, RunLimits
from bt_agents_interfaces.action import RunAgent
from bt_agents_ros import qos
from fake_market import Market, agent_text, folder
from scripted_server import Script, ScriptedServer

SPEAKER = agent_text("speaker", "sequence: [{say: one}, {say: two}]")

DELAY_S = 0.015
AROUND_MS = range(40)
AFTER_THE_END = -1

TERMINAL = {
    GoalStatus.STATUS_SUCCEEDED: RunAgent.Result.SUCCEEDED,
    GoalStatus.STATUS_ABORTED: RunAgent.Result.FAILED,
    GoalStatus.STATUS_CANCELED: RunAgent.Result.CANCELLED,
}


class Sweep:
    """A host, the server of its skill, and a market that cancels at a chosen moment.

    Attributes:
        ends: Goal id → its terminal states so far, as reported by the host's action.
    """

    def __init__(self, ros: Any, tmp_path: Path) -> None:
        self.ros = ros
        self.server = ScriptedServer(ros)
        self.market = Market(ros)
        self.host = self.market.host(folder(tmp_path, SPEAKER))
        self.ends: defaultdict[bytes, set[int]] = defaultdict(set)
        ros.node.create_subscription(
            GoalStatusArray, "agents/run/_action/status", self._note, qos.FACTS
        )
        self._cancel = ros.node.create_client(CancelGoal, "agents/run/_action/cancel_goal")
        ros.until(self._cancel.service_is_ready)
        ros.until(self.market.action.server_is_ready)

    def _note(self, statuses: Any) -> None:
        for status in statuses.status_list:
            if status.status in TERMINAL:
                self.ends[bytes(status.goal_info.goal_id.uuid)].add(status.status)

    def spin_until(self, moment: float) -> None:
        """Spin until a moment on the steady clock [s]."""
        while (left := moment - time.monotonic()) > 0:
            self.ros.executor.spin_once(timeout_sec=left)

    def cancel(self, goal_id: Any) -> Any:
        """Send a cancel, without waiting for the answer."""
        request = CancelGoal.Request()
        request.goal_info.goal_id = goal_id
        return self._cancel.call_async(request)

    def run(self, after_ms: int, *, since_goal: bool = True) -> Any:
        """Run the agent once and cancel it; return its result.

        Args:
            after_ms: When to cancel it [ms]; ``AFTER_THE_END`` for when it is over.
            since_goal: Count from the moment when the server of its first leaf has the goal,
                not from the moment when the run was requested.
        """
        ros = self.ros
        known = len(self.server.goals)
        goal_id = UUID(uuid=list(uuid.uuid4().bytes))
        goal = self.market.goal(self.host, agent="speaker", round=known + 1)
        began = time.monotonic()
        accepted = self.market.action.send_goal_async(goal, goal_uuid=goal_id)
        if since_goal:
            ros.until(lambda: len(self.server.goals) > known)
            began = time.monotonic()
        if after_ms == AFTER_THE_END:
            ros.until(lambda: not self.host._runs.busy)
        self.spin_until(began + after_ms / 1e3)
        answer = self.cancel(goal_id)
        handle = ros.result(accepted)
        assert handle.accepted
        if ros.result(answer).return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID:
            # It came before the goal was accepted; a market cancels again after acceptance.
            assert not since_goal
            self.cancel(goal_id)
        result = ros.result(handle.get_result_async())
        ros.until(lambda: self.ends[bytes(goal_id.uuid)])
        ros.turns(3)
        assert self.ends[bytes(goal_id.uuid)] == {result.status}
        assert TERMINAL[result.status] == result.result.outcome
        assert not self.host._runs.busy
        return result.result

    def outcomes(self) -> list[str]:
        """Return the outcome of each goal of a leaf."""
        return [goal.outcome for goal in self.server.goals]


@pytest.fixture
def sweep(ros: Any, tmp_path: Path) -> Sweep:
    return Sweep(ros, tmp_path)


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(Script(accept_s=DELAY_S, finish_s=DELAY_S / 3), id="around acceptance"),
        pytest.param(Script(accept_s=DELAY_S, rejects=True), id="around rejection"),
        pytest.param(Script(finish_s=DELAY_S), id="around completion"),
        pytest.param(
            Script(finish_s=DELAY_S, cancel_s=DELAY_S), id="around completion of a slow stop"
        ),
        pytest.param(
            Script(finish_s=DELAY_S, on_cancel="ignores"), id="around completion, ignoring cancels"
        ),
        pytest.param(
            Script(finish_s=DELAY_S, on_cancel="refuses"), id="around completion, refusing cancels"
        ),
    ],
)
def test_cancel_at_any_millisecond_ends_run_exactly_once(sweep: Sweep, script: Script) -> None:
    sweep.server.script = script
    found = set()
    for after_ms in (*AROUND_MS, AFTER_THE_END):
        result = sweep.run(after_ms)
        found.add(result.outcome)
        assert list(result.orphans) == [], after_ms
        assert "" not in sweep.outcomes(), after_ms
    ended = RunAgent.Result.FAILED if script.rejects else RunAgent.Result.SUCCEEDED
    assert found == {RunAgent.Result.CANCELLED, ended}


def test_cancel_around_run_acceptance_ends_run_once(sweep: Sweep) -> None:
    sweep.server.script = Script(finish_s=30.0)
    for after_ms in range(12):
        result = sweep.run(after_ms, since_goal=False)
        assert result.outcome == RunAgent.Result.CANCELLED
        assert list(result.orphans) == []
        assert set(sweep.outcomes()) <= {"cancelled"}


@pytest.mark.parametrize(
    ("on_cancel", "every_ms"),
    # The host waits for a hanging server each time.
    [("ignores", 3), ("refuses", 3), ("hangs", 14)],
)
def test_goal_surviving_its_cancel_is_a_named_orphan(
    ros: Any, sweep: Sweep, on_cancel: str, every_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = Run.__init__

    def hurried(run: Run, *args: Any, **kwargs: Any) -> None:
        begin(run, *args, **kwargs, limits=RunLimits(settle_s=0.1))

    monkeypatch.setattr(Run, "__init__", hurried)
    endless = Script(accept_s=DELAY_S, finish_s=None, on_cancel=on_cancel)
    for after_ms in range(0, 30, every_ms):
        sweep.server.script = replace(endless)
        result = sweep.run(after_ms)
        assert result.outcome == RunAgent.Result.CANCELLED
        assert list(result.orphans) == ["tree/0.say"]
        assert sweep.server.goals[-1].outcome == ""
        goal = sweep.server.goals[-1]
        ros.until(lambda goal=goal: goal.cancels)
        assert goal.cancels == 1
        goal.finish()
