# SPDX-License-Identifier: Apache-2.0
"""Service that pauses, steps and resumes the run of a host and sets breakpoints."""

from __future__ import annotations

from rclpy.node import Node

from bt_agents.host.run_control import pause_text
from bt_agents.host.run_server import RunServer
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_interfaces.msg import Breakpoint
from bt_agents_interfaces.msg import RunControl as RunControlMsg
from bt_agents_interfaces.srv import ControlRun
from bt_agents_ros import qos
from bt_agents_ros.messages import answering, header_at

_LONGEST_AUTHOR = 100


class ControlService:
    """Serves ``~/control``, and publishes the state of the control on ``~/run_control``."""

    def __init__(self, node: Node, runs: RunServer, instance: str) -> None:
        self._node = node
        self._runs = runs
        self._instance = instance
        self._publisher = node.create_publisher(RunControlMsg, "~/run_control", qos.FACT)
        node.create_service(ControlRun, "~/control", self._control, qos_profile=qos.SERVICE)
        runs.on_control.append(self._publish)
        self._publish()

    def _control(
        self, request: ControlRun.Request, response: ControlRun.Response
    ) -> ControlRun.Response:
        with answering(response):
            response.message = self._act(request)
        return response

    def _act(self, request: ControlRun.Request) -> str:
        """Execute a request; return the new state in words."""
        author = ellipsize(printable_line(request.author), _LONGEST_AUTHOR)
        if request.action == ControlRun.Request.BREAKPOINTS:
            return self._set_breakpoints(request, author)
        run = self._runs.control.check(request.epoch, request.round)
        match request.action:
            case ControlRun.Request.PAUSE:
                self._runs.pause(author)
                self._log(author, f"{run.agent} is paused")
                return f"{run.agent} is paused at {self._runs.tip[0]}"
            case ControlRun.Request.RESUME:
                self._runs.resume(author)
                self._log(author, f"{run.agent} goes on")
                return f"{run.agent} goes on"
            case ControlRun.Request.STEP:
                self._runs.step()
                return self._stepped(run.agent)
        raise Refused(
            RefusalCode.UNKNOWN_ACTION,
            f"{request.action} is not an action, expected a constant of ControlRun",
        )

    def _set_breakpoints(self, request: ControlRun.Request, author: str) -> str:
        self._runs.set_breakpoints(request.agent, request.paths, author)
        paths = self._runs.control.breakpoints.get(request.agent, ())
        before = f"pauses before {', '.join(paths)}" if paths else "has no breakpoints"
        self._log(author, f"{request.agent} {before}")
        return f"{request.agent} {before}"

    def _stepped(self, agent: str) -> str:
        run = self._runs.run
        if run is None or not run.ticking:
            return f"{agent} was ticked once, and its tree has ended"
        at = f"before {run.held[0]}" if run.held else f"at {run.tip}"
        return f"{agent} was ticked once, and is {at}"

    def _log(self, author: str, text: str) -> None:
        self._node.get_logger().info(f"{text}, as {author} asked" if author else text)

    def _publish(self) -> None:
        control = self._runs.control
        run = control.run
        self._publisher.publish(
            RunControlMsg(
                header=header_at(self._node.get_clock().now().to_msg()),
                host=self._node.get_fully_qualified_name(),
                host_instance=self._instance,
                epoch=run.epoch if run else "",
                round=run.round if run else 0,
                agent=run.agent if run else "",
                paused=control.paused,
                paused_at=control.paused_at,
                author=control.author,
                breakpoints=[
                    Breakpoint(agent=agent, path=path)
                    for agent, paths in control.breakpoints.items()
                    for path in paths
                ],
            )
        )
        if control.paused_at and run is not None:
            text = pause_text(control.paused_at, control.author)
            self._node.get_logger().info(f"{run.agent} is {text}")
