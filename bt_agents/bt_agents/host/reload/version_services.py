# SPDX-License-Identifier: Apache-2.0
"""Services of a host to reload, list and roll back versions of agents."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from bt_agents.host.reload.reload_service import ReloadService, Request
from bt_agents.host.run_server import RunServer
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Version
from bt_agents_interfaces.srv import ListVersions, ReloadAgents, RollBack
from bt_agents_ros import qos
from bt_agents_ros.messages import to_time


class ReloadServices:
    """Services ``~/reload``, ``~/versions`` and ``~/roll_back`` of a host."""

    def __init__(self, node: Node, reloading: ReloadService, runs: RunServer) -> None:
        self._reloading = reloading
        self._versions = reloading.versions
        self._runs = runs
        # A request in progress delays only the others of its group.
        one_at_a_time = MutuallyExclusiveCallbackGroup()
        for kind, name, answer in (
            (ReloadAgents, "~/reload", self._reload),
            (ListVersions, "~/versions", self._list),
            (RollBack, "~/roll_back", self._roll_back),
        ):
            node.create_service(
                kind, name, answer, qos_profile=qos.SERVICE, callback_group=one_at_a_time
            )

    async def _reload(
        self, asked: ReloadAgents.Request, response: ReloadAgents.Response
    ) -> ReloadAgents.Response:
        request: Request = await self._reloading.poll_now()
        problems = self._versions.folder_problems()
        response.accepted = not (request.error or problems)
        changes = [request.error] if request.error else list(request.changes)
        running = self._runs.running
        cancelled = self._cancel_for_waiting(asked.now, running)
        # The description of a changed agent already names what waits for the end of its run.
        is_named = running in request.agents and not request.error
        waiting = "" if cancelled or is_named else self._versions.waiting_text(running)
        response.message = "\n".join(
            reload_lines([*changes, *cancelled], waiting, [one.message for one in problems])
        )
        return response

    async def _roll_back(
        self, asked: RollBack.Request, response: RollBack.Response
    ) -> RollBack.Response:
        try:
            version = self._versions.find(asked.agent, asked.version)
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        request: Request = await self._reloading.roll_back(asked.agent, version)
        if request.error:
            response.code, response.message = "NOT_DONE", request.error
            return response
        response.accepted = True
        now = asked.now and self._runs.running == asked.agent
        cancelled = self._cancel_for_waiting(now, asked.agent)
        response.message = "\n".join([*request.changes, *cancelled])
        return response

    def _list(
        self, asked: ListVersions.Request, response: ListVersions.Response
    ) -> ListVersions.Response:
        try:
            history = self._versions.history(asked.agent)
        except Refused as refused:
            response.message = refused.reason
            return response
        response.accepted = True
        response.message = f"version {history.current.number} of {asked.agent} is in force"
        if history.waiting is not None:
            response.message += f", {history.waiting.number} waits for the end of its run"
        response.versions = [
            Version(
                stamp=to_time(one.stamp),
                version=one.number,
                cause=one.cause,
                change=one.change,
                current=one is history.current,
                waiting=one is history.waiting,
            )
            for one in history.versions
        ]
        return response

    def _cancel_for_waiting(self, now: bool, agent: str) -> list[str]:
        """If ``now``, cancel the run that a version waits for; return the lines that report it."""
        waiting = self._versions.waiting_text(agent) if now else ""
        if not waiting:
            return []
        self._runs.cancel(f"{waiting}, and somebody wants it now")
        return [f"{waiting}: the run of {agent} is cancelled for it"]


def reload_lines(changes: Sequence[str], waiting: str, problems: Sequence[str]) -> list[str]:
    """Return the lines of an answer to a reload; skips problems that a change already quotes."""
    lines = list(changes)
    if waiting:
        lines.append(f"{waiting} for the end of the run; 'bt-agents reload --now' cancels it")
    text = "\n".join(lines)
    lines += [problem for problem in problems if problem not in text]
    return lines or ["nothing has changed"]
