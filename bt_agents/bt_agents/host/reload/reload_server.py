# SPDX-License-Identifier: Apache-2.0
"""Service of a host that reads changed files at once."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from bt_agents.host.reload.reload_service import ReloadService, Request
from bt_agents.host.run_server import RunServer
from bt_agents_interfaces.srv import ReloadAgents
from bt_agents_ros import qos


class ReloadServer:
    """Service ``~/reload`` of a host."""

    def __init__(self, node: Node, reloading: ReloadService, runs: RunServer) -> None:
        self._reloading = reloading
        self._versions = reloading.versions
        self._runs = runs
        node.create_service(
            ReloadAgents,
            "~/reload",
            self._reload,
            qos_profile=qos.SERVICE,
            # A request in progress delays only the others of its group.
            callback_group=MutuallyExclusiveCallbackGroup(),
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
