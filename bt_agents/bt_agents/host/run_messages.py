# SPDX-License-Identifier: Apache-2.0
"""Messages of a run: the changes of a tick, and its result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from py_trees.common import Status

from bt_agents.engine.run import Run, RunResult, StatusChange, TreeOutcome
from bt_agents_core.errors import Refused
from bt_agents_core.stop_cause import Cancellation, StopCause, StoppedBy, stopper
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import ChangedValue, TreeStatus
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_interfaces.msg import StatusChange as StatusChangeMsg
from bt_agents_ros.messages import header_at

_LONGEST_REASON = 500
_STATUS = {status: getattr(StatusChangeMsg, status.name) for status in Status}


def tree_status(
    stamp: Any, goal: Any, instance: str, run: Run, changes: Sequence[StatusChange]
) -> TreeStatus:
    """Return the message of a tick: the state of the run after it and its changes, in order."""
    return TreeStatus(
        header=header_at(stamp),
        epoch=goal.epoch,
        round=goal.round,
        agent=goal.agent,
        host_instance=instance,
        tick=run.ticks,
        tip=run.tip,
        changes=[
            StatusChangeMsg(
                path=change.path,
                name=change.name,
                status=_STATUS[change.status],
                message=change.message,
                values=[ChangedValue(name=name, value=value) for name, value in change.values],
            )
            for change in changes
        ],
    )


def run_result_to_msg(result: RunResult) -> RunAgent.Result:
    """Return the result of the action."""
    outcome = getattr(RunAgent.Result, result.outcome.name)
    return RunAgent.Result(**asdict(result) | {"outcome": outcome})


def cancellation_from_msg(message: RunMsg) -> Cancellation:
    """Return who stops a run and why, from the message that it is being stopped."""
    by = stopper(StopCause.BY_MARKET, StoppedBy.of(message.stopped_by))
    reason = ellipsize(printable_line(message.stop_reason), _LONGEST_REASON)
    return Cancellation(by=by, reason=reason)


def not_begun(error: Exception) -> RunResult:
    """Return the result of a run whose tree could not be built."""
    reason = error.reason if isinstance(error, Refused) else f"{type(error).__name__}: {error}"
    return RunResult(outcome=TreeOutcome.FAILED, message=f"it could not begin: {reason}")
