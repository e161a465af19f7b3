# SPDX-License-Identifier: Apache-2.0
"""Simulated robot behind real ROS interfaces: speech, questions, screen, driving and light."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.subscription import Subscription
from rclpy.task import Future
from std_msgs.msg import Empty, String

from bt_agents_core.errors import Refused
from bt_agents_core.liveness import HEARTBEAT_S
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import LONGEST_NAME
from bt_agents_core.run_key import RunKey
from bt_agents_core.text import printable
from bt_agents_interfaces.action import Ask as AskAction
from bt_agents_interfaces.action import Drive as DriveAction
from bt_agents_interfaces.action import Say as SayAction
from bt_agents_interfaces.action import Show as ShowAction
from bt_agents_interfaces.msg import (
    Heartbeat,
    MarketStatus,
    OpenGoals,
    OpenQuestion,
    OpenQuestions,
    RobotAct,
    RobotState,
)
from bt_agents_interfaces.srv import SetLight
from bt_agents_robot.acts import Act, Ask, Drive, Say, Show
from bt_agents_robot.run_fence import RunFence
from bt_agents_robot.speech import Voice, check_text
from bt_agents_robot.watches import HostWatch, ScreenWatch
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.goal_cancellation import open_goals_from_msg
from bt_agents_ros.parameters import declare, declare_and_watch, declare_slow_network, describe
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.workarounds.cached_wait_set import PolledGroup

COLOURS = ("off", "white", "green", "yellow", "blue", "red")

MOST_ACTS = 20
"""Maximum number of ongoing and waiting acts; then goals are rejected."""

MOST_WAITING = 5
"""Maximum number of texts waiting for the mouth; then goals are rejected."""

RESULT_TIMEOUT_S = 5
"""Time to store results [s]; the rclpy default of 900 s slows every further goal."""

NO_PAGE = "no page Person is open"
"""Why a goal that needs the screen ends."""

_SLOWEST_TICK_S, _FASTEST_TICK_S = 0.02, 0.005
_FEEDBACK_STEP = 0.1


@dataclass(eq=False)
class _Performed:
    """Act of a goal; ``begun`` is the stamp of its beginning, ``number`` its sequence number."""

    act: Act
    goal: Any
    done: Future
    reported: float = 0.0
    begun: Any = None
    number: int = 0


class RobotNode(BaseNode):
    """Simulated robot; a given voice overrides the parameter ``voice``.

    Goals of a host end when the host falls silent, and goals of a run when the next run acts. Late
    goals of runs that the market has left behind are rejected. With the parameter
    ``needs_screen``, goals that a page shows end when no page is open.
    """

    def __init__(self, *, voice: Voice | None = None, **node_kwargs: Any) -> None:
        super().__init__("robot", **node_kwargs)
        pace = describe("speed of everything relative to real time", minimum=0.1, maximum=1000.0)
        self._pace = float(declare(self, "pace", 1.0, pace))
        wanted = declare(
            self,
            "voice",
            "auto",
            describe(
                "whether the robot speaks texts aloud", choices=("auto", "off"), read_only=True
            ),
        )
        if wanted not in ("auto", "off"):
            raise Refused(
                RefusalCode.UNKNOWN_CHOICE, f"parameter voice is '{wanted}', expected auto or off"
            )
        if voice is None and wanted == "auto":
            voice = Voice(warn=self.get_logger().warning)
        self._voice = voice
        self._performed: list[_Performed] = []
        self._open_goals = 0
        self._stopping = False
        self._transcript = self.create_publisher(String, "robot/transcript", qos.HISTORY)
        self._questions = self.create_publisher(String, "robot/questions", qos.EVENTS)
        self._open_questions = self.create_publisher(
            OpenQuestions, "robot/open_questions", qos.FACT
        )
        self._asked = OpenQuestions()
        self._open_questions.publish(self._asked)
        self._states = self.create_publisher(RobotState, "robot/state", qos.FACT)
        self._state = RobotState(light="off")
        self._begun_acts = 0
        self._publish_state()
        self._heartbeat = self.create_publisher(Empty, "robot/heartbeat", qos.SENSOR)
        self._watch = HostWatch(self._declare_host_lease(), time.monotonic())
        self._screen = self._watch_screen()
        self._heartbeats: dict[str, Subscription[Heartbeat]] = {}
        self.create_subscription(OpenGoals, "bt_agents/open_goals", self._on_open_goals, qos.FACTS)
        self._fence = RunFence()
        self.create_subscription(MarketStatus, "bt_agents/market", self._on_market, qos.FACT)
        steady_timer(self, HEARTBEAT_S, self._beat)
        tick_s = min(max(_SLOWEST_TICK_S / self._pace, _FASTEST_TICK_S), _SLOWEST_TICK_S)
        self._timer = steady_timer(self, tick_s, self._tick, running=False)
        self._servers = [
            self._serve(SayAction, "say", self._say),
            self._serve(AskAction, "ask", self._ask),
            self._serve(ShowAction, "show", self._show),
            self._serve(DriveAction, "drive", self._drive),
        ]
        self.create_service(SetLight, "set_light", self._on_light, qos_profile=qos.SERVICE)
        self.create_subscription(String, "sound", self._on_sound, qos.EVENTS)
        self.create_subscription(String, "answers", self._on_answer, qos.EVENTS)

    # Hosts

    def _declare_host_lease(self) -> float:
        slowness = declare_slow_network(self)

        def take(seconds: float) -> None:
            self._watch.lease_s = seconds * slowness

        meaning = (
            "the robot gives up a goal when the host that sent it is silent for this long [s]"
        )
        limits = describe(meaning, minimum=0.5, maximum=60.0)
        return slowness * float(declare_and_watch(self, "host_lease", 1.0, limits, take))

    def _beat(self) -> None:
        self._heartbeat.publish(Empty())
        now = time.monotonic()
        lost = self._watch.lost(now)
        is_screen_gone = self._screen is not None and self._screen.is_gone(now)
        for performed in list(self._performed):
            reason = lost.get(bytes(performed.goal.goal_id.uuid))
            if reason is None and is_screen_gone and performed.act.uses_screen:
                reason = NO_PAGE
            if reason is not None:
                self.get_logger().warning(f"given up: {performed.act.line}: {reason}")
                self._end(performed, reason)

    def _on_open_goals(self, message: OpenGoals) -> None:
        try:
            goals = open_goals_from_msg(message)
            self._hear(message.host, message.heartbeat)
        except Refused as refused:
            self.get_logger().warning(f"open goals of a host: {refused}")
            return
        ids = [goal.goal_id for goal in goals]
        self._watch.on_open_goals(message.host, message.host_instance, ids, time.monotonic())
        for gone in self._heartbeats.keys() - self._watch.hosts:
            self.destroy_subscription(self._heartbeats.pop(gone))

    def _hear(self, host: str, topic: str) -> None:
        if host in self._heartbeats:
            return
        try:
            self._heartbeats[host] = self.create_subscription(
                Heartbeat, topic, self._on_heartbeat, qos.EVENTS, callback_group=PolledGroup()
            )
        except Exception as error:
            # The name comes from outside; rclpy's errors for bad names have no common base class.
            raise Refused(
                RefusalCode.BAD_NAME, f"its heartbeat cannot be heard: {error}"
            ) from None

    def _on_heartbeat(self, message: Heartbeat) -> None:
        self._watch.on_heartbeat(message.host, message.host_instance, time.monotonic())

    def _on_market(self, message: MarketStatus) -> None:
        if max(len(message.epoch), len(message.agent)) <= LONGEST_NAME:
            self._fence.on_market(RunKey.of(message))

    def _late_refusal(self, run: RunKey) -> Refused | None:
        """Return and log the refusal of a goal or request that is too late."""
        if not self._fence.is_over(run):
            return None
        refused = Refused(
            RefusalCode.OVER,
            f"it belongs to the run of {printable(run.agent[:LONGEST_NAME])} in round "
            f"{run.round}, from which the market has gone on; it was held up on its way",
        )
        self.get_logger().warning(f"too late: {refused}")
        return refused

    # Screen

    def _watch_screen(self) -> ScreenWatch | None:
        meaning = "true: the robot can speak, ask and show only while a page Person is open"
        if not declare(self, "needs_screen", False, describe(meaning, read_only=True)):
            return None
        screen = ScreenWatch(time.monotonic())

        def hear(_message: Empty) -> None:
            screen.on_heartbeat(time.monotonic())

        self.create_subscription(Empty, "studio/person/heartbeat", hear, qos.SENSOR)
        return screen

    def _check_screen(self, act: Act) -> None:
        if self._screen is None or not act.uses_screen:
            return
        now = time.monotonic()
        self._screen.on_goal(now)
        if self._screen.is_gone(now):
            raise Refused(RefusalCode.UNREACHABLE, NO_PAGE)

    # Ending

    def request_stop(self) -> None:
        self._stopping = True
        for performed in list(self._performed):
            self._end(performed, "the robot is being switched off")

    def stopped(self) -> bool:
        return self._open_goals == 0

    def destroy_node(self) -> None:
        for performed in self._performed:
            performed.act.stop()
        for server in self._servers:
            server.destroy()
        super().destroy_node()

    # Goals

    def _serve(self, kind: Any, name: str, make_act: Callable[[Any], Act]) -> ActionServer:
        return ActionServer(
            self,
            kind,
            name,
            partial(self._execute, kind, make_act),
            goal_callback=self._answer_goal,
            cancel_callback=lambda _goal: CancelResponse.ACCEPT,
            goal_service_qos_profile=qos.SERVICE,
            result_service_qos_profile=qos.SERVICE,
            cancel_service_qos_profile=qos.SERVICE,
            result_timeout=RESULT_TIMEOUT_S,
        )

    def _answer_goal(self, request: Any) -> GoalResponse:
        """Reject a late goal; before another one begins, end what earlier runs have left."""
        run = RunKey.of(request.run)
        if self._late_refusal(run) is not None:
            return GoalResponse.REJECT
        for one in list(self._performed):
            if self._fence.is_superseded(RunKey.of(one.goal.request.run), by=run):
                self._end(one, "the robot was asked to act for the next run")
        return GoalResponse.ACCEPT

    async def _execute(self, kind: Any, make_act: Callable[[Any], Act], goal: Any) -> Any:
        try:
            if self._stopping:
                raise Refused(RefusalCode.SHUTTING_DOWN, "the robot is being switched off")
            if len(self._performed) >= MOST_ACTS:
                raise Refused(
                    RefusalCode.BUSY, f"the robot does {MOST_ACTS} things already; cancel some"
                )
            act = make_act(goal.request)
            self._check_screen(act)
        except Refused as refused:
            self.get_logger().warning(f"goal refused: {refused}")
            goal.abort()
            return kind.Result(message=refused.reason)
        performed = _Performed(act=act, goal=goal, done=Future(executor=self.executor))
        self._performed.append(performed)
        self._open_goals += 1
        try:
            self._begin_waiting()
            self._publish_changes()
            self._timer.reset()
            message: str | None = await performed.done
        finally:
            self._open_goals -= 1
        return _result(act, time.monotonic(), message or "")

    def _say(self, request: Any) -> Act:
        self._check_mouth()
        return Say(request.text, request.rate, pace=self._present_pace(), voice=self._voice)

    def _ask(self, request: Any) -> Act:
        self._check_mouth()
        pace = self._present_pace()
        return Ask(request.text, request.choices, request.wait_s, pace=pace, voice=self._voice)

    def _show(self, request: Any) -> Act:
        return Show(request.clip, request.text, request.duration_s, pace=self._present_pace())

    def _drive(self, request: Any) -> Act:
        for performed in self._performed:
            if isinstance(performed.act, Drive):
                raise Refused(
                    RefusalCode.BUSY,
                    f"the robot is driving to {performed.act.text}; cancel that first",
                )
        return Drive(request.destination, pace=self._present_pace())

    def _present_pace(self) -> float:
        return float(self.get_parameter("pace").value)

    def _check_mouth(self) -> None:
        waiting = [p for p in self._performed if p.act.uses_mouth and p.act.begun_at is None]
        if len(waiting) >= MOST_WAITING:
            raise Refused(
                RefusalCode.BUSY, f"{MOST_WAITING} texts are waiting to be said; wait or cancel"
            )

    # Time

    def _tick(self) -> None:
        now = time.monotonic()
        for performed in list(self._performed):
            self._step(performed, now)
        self._begin_waiting()
        self._publish_changes()
        if not self._performed:
            self._timer.cancel()

    def _step(self, performed: _Performed, now: float) -> None:
        act = performed.act
        if performed.goal.is_cancel_requested:
            self._end(performed, "cancelled")
            return
        if act.begun_at is None:
            return
        if isinstance(act, Ask) and act.begins_waiting(now):
            self._questions.publish(String(data=act.text))
        if act.is_over(now):
            self._end(performed, None)
        elif act.progress(now) - performed.reported >= _FEEDBACK_STEP:
            performed.reported = act.progress(now)
            performed.goal.publish_feedback(_feedback(act, now))

    def _begin_waiting(self) -> None:
        """Begin waiting acts: a text as soon as no other is spoken, others at once.

        Those that need the screen wait for the first page.
        """
        now = time.monotonic()
        awaits_screen = self._screen is not None and not self._screen.was_seen
        for performed in self._performed:
            act = performed.act
            if act.begun_at is not None or (act.uses_screen and awaits_screen):
                continue
            if act.uses_mouth and any(other.act.is_speaking(now) for other in self._performed):
                continue
            act.begin(now)
            performed.begun = self.get_clock().now().to_msg()
            self._begun_acts += 1
            performed.number = self._begun_acts
            self._report(act.line)

    def _publish_changes(self) -> None:
        """Publish the acts and the open questions if they have changed."""
        acts = [_shown(one) for one in self._performed if one.act.begun_at is not None]
        if acts != self._state.acts:
            self._state.acts = acts
            self._publish_state()
        asked = OpenQuestions(
            questions=[
                OpenQuestion(stamp=one.begun, text=one.act.text, choices=one.act.choices)
                for one in self._performed
                if isinstance(one.act, Ask) and one.act.begun_at is not None and not one.act.answer
            ]
        )
        if asked != self._asked:
            self._asked = asked
            self._open_questions.publish(asked)

    def _publish_state(self) -> None:
        self._state.header.stamp = self.get_clock().now().to_msg()
        self._states.publish(self._state)

    def _end(self, performed: _Performed, message: str | None) -> None:
        """End an act and its goal; a message gives the reason for an early end."""
        self._performed.remove(performed)
        performed.act.stop()
        if performed.goal.is_cancel_requested:
            performed.goal.canceled()
        elif message is None:
            performed.goal.succeed()
        else:
            performed.goal.abort()
        performed.done.set_result(message)

    # Light, sound and answers

    def _report(self, line: str) -> None:
        shown = printable(line)
        self.get_logger().info(f"robot {shown}")
        self._transcript.publish(String(data=shown))

    def _on_light(self, request: Any, response: Any) -> Any:
        if (late := self._late_refusal(RunKey.of(request.run))) is not None:
            response.message = late.reason
            return response
        colour = request.colour.strip().lower()
        if colour not in COLOURS:
            response.message = (
                f"'{request.colour[:40]}' is not a colour of the light; expected "
                f"{', '.join(COLOURS)}"
            )
            return response
        response.accepted = True
        response.message = f"{colour}, blinking" if request.blink else colour
        self._state.light, self._state.light_blinks = colour, bool(request.blink)
        self._publish_state()
        self._report(f"light: {response.message}")
        return response

    def _on_sound(self, message: Any) -> None:
        try:
            sound = check_text(message.data, "sound")
        except Refused as refused:
            self.get_logger().warning(f"sound refused: {refused}")
            return
        self._state.sound = sound
        self._state.sounds += 1
        self._publish_state()
        self._report(f"sound: {sound}")

    def _on_answer(self, message: Any) -> None:
        for performed in self._performed:
            if isinstance(performed.act, Ask) and performed.act.receive(message.data):
                return


def _shown(performed: _Performed) -> Any:
    act = performed.act
    return RobotAct(
        stamp=performed.begun,
        number=performed.number,
        kind=act.kind,
        text=act.text,
        clip=act.clip,
        choices=act.choices,
        rate=act.rate,
        waiting=act.is_waiting,
    )


def _feedback(act: Act, now: float) -> Any:
    if isinstance(act, Drive):
        return DriveAction.Feedback(remaining_m=act.distance - act.driven(now))
    kinds = {Say: SayAction, Ask: AskAction, Show: ShowAction}
    return kinds[type(act)].Feedback(progress=act.progress(now))


def _result(act: Act, now: float, message: str) -> Any:
    match act:
        case Drive():
            return DriveAction.Result(distance_m=act.driven(now), message=message)
        case Ask():
            no_answer = "" if act.answer else "no answer"
            return AskAction.Result(answer=act.answer, message=message or no_answer)
        case Say():
            return SayAction.Result(duration_s=act.elapsed(now), message=message)
    return ShowAction.Result(message=message)


def make_node() -> RobotNode:
    """Create the node."""
    return RobotNode()


def main(args: Sequence[str] | None = None) -> int:
    """Run the robot until a signal ends it; return the exit code."""
    return run(make_node, args)


if __name__ == "__main__":
    raise SystemExit(main())
