# SPDX-License-Identifier: Apache-2.0
"""What others can ask of a host about the versions of its agents."""

from __future__ import annotations

from collections.abc import Collection

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from bt_agents.host.reload.reload_service import ReloadService, Request
from bt_agents.host.reload.report import problems_of, report
from bt_agents.host.reload.versions import AgentVersions
from bt_agents.host.run_server import RunServer
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Version
from bt_agents_interfaces.srv import ListVersions, ReloadAgents, RollBack
from bt_agents_ros import qos
from bt_agents_ros.messages import to_time


class ReloadServices:
    """Serves ``~/reload``, ``~/versions`` and ``~/roll_back``.

    Args:
        node: The host's node.
        reloading: Does what is asked for.
        runs: The host's action, whose run is cancelled for who does not want to wait.
    """

    def __init__(self, node: Node, reloading: ReloadService, runs: RunServer) -> None:
        self._node = node
        self._reloading = reloading
        self._versions: AgentVersions = reloading.versions
        self._runs = runs
        # An answer that is awaited holds up the others of its group, and nothing else.
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
        done = Future(executor=self._node.executor)
        self._reloading.look_now(done.set_result)
        request: Request = await done
        problems = problems_of(self._versions.trees)
        response.accepted = not (request.error or problems)
        changed = [request.error] if request.error else list(request.words)
        hurried = self._hurry(asked.now, self._runs.running)
        waits = "" if hurried else self._waits_unsaid(request.agents)
        response.message = "\n".join(report([*changed, *hurried], waits, problems))
        return response

    def _waits_unsaid(self, changed: Collection[str]) -> str:
        """Return what waits for the end of the run, unless what has changed says so already."""
        running = self._runs.running
        return "" if running in changed else self._versions.waits(running)

    async def _roll_back(
        self, asked: RollBack.Request, response: RollBack.Response
    ) -> RollBack.Response:
        try:
            version = self._versions.wanted(asked.agent, asked.version)
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        done = Future(executor=self._node.executor)
        self._reloading.roll_back(asked.agent, version, done.set_result)
        request: Request = await done
        if request.error:
            response.code, response.message = "NOT_DONE", request.error
            return response
        response.accepted = True
        hurried = self._hurry(asked.now and self._runs.running == asked.agent, asked.agent)
        response.message = "\n".join([*request.words, *hurried])
        return response

    def _list(
        self, asked: ListVersions.Request, response: ListVersions.Response
    ) -> ListVersions.Response:
        try:
            versions = self._versions.versions(asked.agent)
            standing = self._versions.standing(asked.agent)
        except Refused as refused:
            response.message = refused.reason
            return response
        response.accepted = True
        response.message = f"version {standing.version} of {asked.agent} is in force"
        if standing.waiting:
            response.message += f", {versions[-1].number} waits for the end of its run"
        response.versions = [
            Version(
                stamp=to_time(one.stamp),
                version=one.number,
                cause=one.cause,
                change=one.change,
                current=one.number == standing.version,
                waiting=standing.waiting and one is versions[-1],
            )
            for one in versions
        ]
        return response

    def _hurry(self, now: bool, agent: str) -> list[str]:
        """Cancel the run that something waits for, if that is wanted; return this in words."""
        waits = self._versions.waits(agent) if now else ""
        if not waits:
            return []
        self._runs.cancel(f"{waits}, and somebody wants it now")
        return [f"{waits}: the run of {agent} is cancelled for it"]
