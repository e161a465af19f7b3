# SPDX-License-Identifier: Apache-2.0
"""Has agents changed while the host is at work: files are read beside it, changes act between."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future as Job
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node

from bt_agents.host.reload.folder_watch import FileWrite, FolderWatch, WatchStopped
from bt_agents.host.reload.reload_actions import ReloadEffect
from bt_agents.host.reload.version_history import Version
from bt_agents.host.reload.versions import AgentVersions
from bt_agents.host.run_server import RunServer
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.file_watch import PERIOD_S
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_language.files.folder_reader import Trees
from bt_agents_ros.messages import seconds
from bt_agents_ros.parameters import declare_and_watch, describe
from bt_agents_ros.timers import steady_timer

_TURN_S = 0.05
_SLICE_S = 0.02
"""How long agents are changed before other callbacks have their turn [s]."""

_GIVE_WAY_S = 0.0005
"""Sleep of the reading thread before each file, in which the tree is ticked [s]."""

ANSWER_LIMIT_S = 20.0
"""How long a request waits until files are read and their agents changed [s]."""


@dataclass(eq=False, kw_only=True)
class Request:
    """Somebody waits until files are read, and all that is new in them has been dealt with.

    Attributes:
        done: Called once, when it is over.
        words: What has changed, one entry an agent.
        agents: The agents that these are about.
        error: Why it did not work; empty when it did.
    """

    done: Callable[[Request], None]
    deadline: float
    words: list[str] = field(default_factory=list)
    agents: set[str] = field(default_factory=set)
    error: str = ""


@dataclass(frozen=True, kw_only=True)
class _Reading:
    job: Job[Any]
    take: Callable[[Any], None]
    request: Request | None


class ReloadService:
    """Watches the trees folder of a host, and says what is to be done with which agent.

    One thread looks at the files, for which it may take its time. Its results are taken here in
    the order in which they were asked for, and no callback of the host is held up by them.

    Args:
        node: The host's node.
        versions: The versions of its agents.
        runs: Its action.
        apply: Does what an effect says.
        applied: Called after one or more effects, and when the folder as a whole has news.
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
        self._watch = FolderWatch(versions.trees, lambda: time.sleep(_GIVE_WAY_S))
        self._thread = WorkerThread("reload")
        self._readings: deque[_Reading] = deque()
        self._unsettled: deque[str] = deque()
        self._effects: list[ReloadEffect] = []
        self._news = False
        self._requests: list[Request] = []
        self._next_look = time.monotonic() + PERIOD_S
        self._trouble = ""
        what = "take changed files of agents over by itself"
        self._on = bool(declare_and_watch(node, "reload", True, describe(what), self._switch))
        runs.on_end(lambda goal, _result: self.run_ended(goal.agent))
        self._timer = steady_timer(node, PERIOD_S, self._turn)

    def close(self) -> None:
        """Stop reading; nothing is waited for."""
        self._watch.stop()
        self._thread.shutdown(wait=False, cancel_futures=True)

    def run_ended(self, agent: str) -> None:
        """Change the agent whose run has ended, when something waits for that."""
        effect = self.versions.ended(agent)
        if effect is not None:
            self._do(effect)
            self._tell()

    def look_now(self, done: Callable[[Request], None]) -> None:
        """Look at the files as they are, and call back when all that is new is dealt with."""
        request = self._request(done)
        self._read(lambda: self._watch.look(settle=False), self._take_look, request)

    def roll_back(self, name: str, version: Version, done: Callable[[Request], None]) -> None:
        """Write an earlier version into its file and bring it into force; call back then."""
        request = self._request(done)
        file = self.versions.file(name).file
        texts = {one.file.text for one in self.versions.versions(name) if one.file.text}

        def take(written: FileWrite) -> None:
            now = self._now()
            running = self._runs.running
            self._do(self.versions.roll_back(name, version, written.file, running, now))
            if written.words:
                request.words.append(written.words)
            self.take(written.trees)

        self._read(lambda: self._watch.write(file, version.file, texts), take, request)

    def take(self, trees: Trees) -> None:
        """Take the folder as it was read; agents that do not fit into one slice follow later."""
        before = self.versions.trees
        log = self._node.get_logger()
        known = {broken.error.lines for broken in before.broken}
        for broken in trees.broken:
            if broken.error.lines not in known:
                log.error(f"broken, what was good before stays:\n{broken.error.report}")
        for problem in trees.problems:
            if problem not in before.problems:
                log.error(problem)
        for problem in trees.plugin_problems:
            if problem not in before.plugin_problems:
                log.warning(f"a node of a package is left out: {problem}")
        self._unsettled.extend(self.versions.take(trees))
        self._news = True
        self._settle()

    def _settle(self) -> None:
        end = time.monotonic() + _SLICE_S
        while self._unsettled:
            name = self._unsettled.popleft()
            effect = self.versions.settle(name, self._runs.running, self._now())
            if effect is not None:
                self._do(effect)
            if time.monotonic() >= end:
                break
        self._tell()

    def _do(self, effect: ReloadEffect) -> None:
        log = self._node.get_logger()
        try:
            self._apply(effect)
        except Exception as error:
            log.error(f"{effect.words}: this failed:\n{traceback.format_exc()}")
            effect = self.versions.failed(effect, f"{type(error).__name__}: {error}")
            for request in self._requests:
                request.error = "; ".join(filter(None, (request.error, effect.words)))
        if effect.bad:
            log.warning(effect.words)
        else:
            log.info(effect.words)
        self._effects.append(effect)
        for request in self._requests:
            request.words.append(effect.words)
            request.agents.add(effect.name)

    def _tell(self) -> None:
        """Tell of what has been done, once nothing is left; whoever has asked is answered."""
        if self._unsettled:
            return
        effects, self._effects = self._effects, []
        news, self._news = self._news, False
        if effects or news:
            self._applied(effects)

    def _set_timer(self) -> None:
        """Turn soon while something is under way, else when the files are looked at again."""
        now = time.monotonic()
        busy = self._readings or self._unsettled or self._requests
        wait_s = _TURN_S if busy else max(_TURN_S, self._next_look - now)
        self._timer.timer_period_ns = round(wait_s * 1e9)
        self._timer.reset()

    def _turn(self) -> None:
        now = time.monotonic()
        if self._unsettled:
            self._settle()
        while self._readings and not self._unsettled and self._readings[0].job.done():
            self._finish(self._readings.popleft())
        if now >= self._next_look and not (self._readings or self._unsettled):
            self._next_look = now + PERIOD_S
            if self._on:
                self._read(self._watch.look, self._take_look, None)
        for request in list(self._requests):
            if not self._unsettled and not self._is_awaited(request):
                self._end(request)
            elif now >= request.deadline:
                request.error = f"not done within {ANSWER_LIMIT_S:g} s, but it goes on"
                self._end(request)
        self._set_timer()

    def _finish(self, reading: _Reading) -> None:
        try:
            reading.take(reading.job.result())
            self._trouble = ""
        except WatchStopped:
            return
        except Exception as error:
            self._report(error, reading.request)

    def _report(self, error: Exception, request: Request | None) -> None:
        trouble = (
            str(error) if isinstance(error, BtAgentsError) else f"{type(error).__name__}: {error}"
        )
        if request is not None:
            request.error = trouble
        # The next look meets the same trouble half a second later.
        if trouble != self._trouble:
            self._trouble = trouble
            words = "".join(traceback.format_exception(error))
            self._node.get_logger().error(f"the agents could not be read again:\n{words}")

    def _read(
        self, work: Callable[[], Any], take: Callable[[Any], None], request: Request | None
    ) -> None:
        self._readings.append(_Reading(job=self._thread.submit(work), take=take, request=request))
        self._set_timer()

    def _take_look(self, trees: Trees | None) -> None:
        if trees is not None:
            self.take(trees)

    def _request(self, done: Callable[[Request], None]) -> Request:
        request = Request(done=done, deadline=time.monotonic() + ANSWER_LIMIT_S)
        self._requests.append(request)
        return request

    def _is_awaited(self, request: Request) -> bool:
        return any(reading.request is request for reading in self._readings)

    def _end(self, request: Request) -> None:
        self._requests.remove(request)
        request.done(request)

    def _now(self) -> float:
        return seconds(self._node.get_clock().now().to_msg())

    def _switch(self, on: bool) -> None:
        self._on = on
