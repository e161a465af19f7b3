# SPDX-License-Identifier: Apache-2.0
"""Reload service of a host: a thread reads changed files; effects run between callbacks."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future as Job
from dataclasses import dataclass, field

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from bt_agents.host.reload.folder_watch import FolderWatch, WatchStopped
from bt_agents.host.reload.versions import AgentVersions, ReloadEffect
from bt_agents.host.run_server import RunServer
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.file_watch import PERIOD_S
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_interfaces.srv import ReloadAgents
from bt_agents_language.files.folder_reader import Trees
from bt_agents_ros import qos
from bt_agents_ros.parameters import declare_and_watch, describe
from bt_agents_ros.timers import steady_timer

_BUSY_PERIOD_S = 0.05
"""Period of the timer while work is pending [s]."""

_SLICE_S = 0.02
"""Time for changes of agents before other callbacks run [s]."""

_YIELD_S = 0.0005
"""Sleep of the reading thread before each file, which gives ticks time to run [s]."""

ANSWER_LIMIT_S = 20.0
"""Longest wait of a request until files are read and their agents changed [s]."""


@dataclass(eq=False, kw_only=True)
class _Request:
    """Request to read files, answered after all effects have been executed.

    Attributes:
        done: Future that ends with it.
        deadline: Latest steady time of the answer [s].
        changes: Descriptions of the changes.
        agents: Names of the agents that have changed.
        error: Reason for a failure; empty for none.
    """

    done: Future
    deadline: float
    changes: list[str] = field(default_factory=list)
    agents: set[str] = field(default_factory=set)
    error: str = ""


@dataclass(frozen=True, kw_only=True)
class _Reading:
    job: Job[Trees | None]
    request: _Request | None


class ReloadService:
    """Watches the trees folder of a host and executes the effects of changed files.

    Its service ``~/reload`` reads changed files at once. One thread polls and reads the files,
    however long that takes. The executor's thread handles the results in order of the requests, in
    slices that block no other callback: it applies each effect, and calls ``applied`` after one or
    more effects and when the folder as a whole has changed.

    Attributes:
        problems: Why the folder could not be read again; empty when it could.
    """

    def __init__(
        self,
        node: Node,
        versions: AgentVersions,
        runs: RunServer,
        *,
        apply: Callable[[ReloadEffect], None],
        applied: Callable[[list[ReloadEffect]], None],
    ) -> None:
        self.versions = versions
        self._node = node
        self._runs = runs
        self._apply = apply
        self._applied = applied
        self._watch = FolderWatch(versions.trees, lambda: time.sleep(_YIELD_S))
        self._thread = WorkerThread("reload")
        self._readings: deque[_Reading] = deque()
        self._unsettled: deque[str] = deque()
        self._effects: list[ReloadEffect] = []
        self._updated = False
        self._requests: list[_Request] = []
        self._next_poll = time.monotonic() + PERIOD_S
        self.problems: tuple[str, ...] = ()
        what = "true: the host takes over changed agent files by itself"
        self._enabled = bool(
            declare_and_watch(node, "reload", True, describe(what), self._set_enabled)
        )
        runs.on_end.append(lambda goal, _result: self._run_ended(goal.agent))
        node.create_service(
            ReloadAgents,
            "~/reload",
            self._reload,
            qos_profile=qos.SERVICE,
            # A request in progress delays only the others of its group.
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        self._timer = steady_timer(node, PERIOD_S, self._on_timer)

    def close(self) -> None:
        """Stop reading, without waiting for the thread."""
        self._watch.stop()
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _reload(
        self, asked: ReloadAgents.Request, response: ReloadAgents.Response
    ) -> ReloadAgents.Response:
        request = self._request()
        self._read(request, settle=False)
        await request.done
        problems = self.versions.folder_problems()
        response.accepted = not (request.error or problems)
        changes = [request.error] if request.error else list(request.changes)
        running = self._runs.running
        cancelled = self._cancel_for_waiting(asked.now, running)
        # The description of a changed agent already names what waits for the end of its run.
        is_named = running in request.agents and not request.error
        waiting = "" if cancelled or is_named else self.versions.waiting_text(running)
        response.message = "\n".join(
            reload_lines([*changes, *cancelled], waiting, [one.message for one in problems])
        )
        return response

    def _cancel_for_waiting(self, now: bool, agent: str) -> list[str]:
        """If ``now``, cancel the run that a version waits for; return the lines that report it."""
        waiting = self.versions.waiting_text(agent) if now else ""
        if not waiting:
            return []
        self._runs.cancel(f"{waiting}, and somebody wants it now")
        return [f"{waiting}: the run of {agent} is cancelled for it"]

    def _run_ended(self, agent: str) -> None:
        """Execute the effect that waited for the end of an agent's run."""
        effect = self.versions.run_ended(agent)
        if effect is not None:
            self._execute(effect)
            self._report_effects()

    def update(self, trees: Trees | None) -> None:
        """Handle a reading, None for no change; work beyond the time slice follows later."""
        if trees is None:
            return
        before = self.versions.trees
        log = self._node.get_logger()
        known = {broken.error.lines for broken in before.broken}
        for broken in trees.broken:
            if broken.error.lines not in known:
                log.error(f"broken, the last good version stays:\n{broken.error.report}")
        for problem in trees.problems:
            if problem not in before.problems:
                log.error(problem)
        for problem in trees.plugin_problems:
            if problem not in before.plugin_problems:
                log.warning(f"a node of a package is left out: {problem}")
        self._unsettled.extend(self.versions.update(trees))
        self._updated = True
        self._settle()

    def _settle(self) -> None:
        end = time.monotonic() + _SLICE_S
        while self._unsettled:
            name = self._unsettled.popleft()
            effect = self.versions.settle(name, self._runs.running)
            if effect is not None:
                self._execute(effect)
            if time.monotonic() >= end:
                break
        self._report_effects()

    def _execute(self, effect: ReloadEffect) -> None:
        log = self._node.get_logger()
        try:
            self._apply(effect)
        except Exception as error:
            log.error(f"{effect.text}: this failed:\n{traceback.format_exc()}")
            effect = self.versions.failed(effect, f"{type(error).__name__}: {error}")
            for request in self._requests:
                request.error = "; ".join(filter(None, (request.error, effect.text)))
        if effect.is_error:
            log.warning(effect.text)
        else:
            log.info(effect.text)
        self._effects.append(effect)
        for request in self._requests:
            request.changes.append(effect.text)
            request.agents.add(effect.name)

    def _report_effects(self) -> None:
        """Report the executed effects once no agent is left to settle."""
        if self._unsettled:
            return
        effects, self._effects = self._effects, []
        updated, self._updated = self._updated, False
        if effects or updated:
            self._applied(effects)

    def _set_timer(self) -> None:
        """Wake up soon while work is pending, else for the next poll."""
        now = time.monotonic()
        busy = self._readings or self._unsettled or self._requests
        wait_s = _BUSY_PERIOD_S if busy else max(_BUSY_PERIOD_S, self._next_poll - now)
        self._timer.timer_period_ns = round(wait_s * 1e9)
        self._timer.reset()

    def _on_timer(self) -> None:
        now = time.monotonic()
        if self._unsettled:
            self._settle()
        while self._readings and not self._unsettled and self._readings[0].job.done():
            self._finish(self._readings.popleft())
        if now >= self._next_poll and not (self._readings or self._unsettled):
            self._next_poll = now + PERIOD_S
            if self._enabled:
                self._read(None, settle=True)
        for request in list(self._requests):
            if not self._unsettled and all(one.request is not request for one in self._readings):
                self._end(request)
            elif now >= request.deadline:
                request.error = f"not done within {ANSWER_LIMIT_S:g} s, but it goes on"
                self._end(request)
        self._set_timer()

    def _finish(self, reading: _Reading) -> None:
        try:
            self.update(reading.job.result())
            self._report(())
        except WatchStopped:
            return
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            message = str(error) if isinstance(error, BtAgentsError) else reason
            if reading.request is not None:
                reading.request.error = message
            # The next poll meets the same error half a second later.
            if self._report((f"changed files are not applied: {message}",)):
                log = self._node.get_logger()
                log.error(f"the agents could not be read again:\n{traceback.format_exc()}")

    def _report(self, problems: tuple[str, ...]) -> bool:
        """Publish why the folder could not be read; return False if it was known."""
        if problems == self.problems:
            return False
        self.problems = problems
        self._applied([])
        return True

    def _read(self, request: _Request | None, *, settle: bool) -> None:
        job = self._thread.submit(self._watch.poll, settle=settle)
        self._readings.append(_Reading(job=job, request=request))
        self._set_timer()

    def _request(self) -> _Request:
        done = Future(executor=self._node.executor)
        request = _Request(done=done, deadline=time.monotonic() + ANSWER_LIMIT_S)
        self._requests.append(request)
        return request

    def _end(self, request: _Request) -> None:
        self._requests.remove(request)
        request.done.set_result(None)

    def _set_enabled(self, enabled: bool) -> None:
        self._enabled = enabled


def reload_lines(changes: Sequence[str], waiting: str, problems: Sequence[str]) -> list[str]:
    """Return the lines of an answer to a reload; skips problems that a change already quotes."""
    lines = list(changes)
    if waiting:
        lines.append(f"{waiting} for the end of the run; 'bt-agents reload --now' cancels it")
    text = "\n".join(lines)
    lines += [problem for problem in problems if problem not in text]
    return lines or ["nothing has changed"]
