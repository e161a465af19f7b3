# SPDX-License-Identifier: Apache-2.0
"""The simulated robot behind its real actions, services and topics."""

from __future__ import annotations

import math
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from std_msgs.msg import Empty, String

from bt_agents_interfaces.action import Ask, Drive, Say, Show
from bt_agents_interfaces.msg import (
    Heartbeat,
    MarketStatus,
    OpenGoal,
    OpenGoals,
    OpenQuestions,
    RobotAct,
    RobotState,
    RunKey,
)
from bt_agents_interfaces.srv import SetLight
from bt_agents_robot.robot import MOST_WAITING, NO_PAGE, RobotNode
from bt_agents_robot.speech import Voice
from bt_agents_ros import qos
from bt_agents_ros.messages import seconds

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
ACTIONS = {"say": Say, "ask": Ask, "show": Show, "drive": Drive}
ACTS = {
    "ask": {"text": "Well?"},
    "say": {"text": "A long story."},
    "show": {"clip": "first_time"},
    "drive": {"destination": "gate"},
}
"""Goals that last; a page Person shows all but the drive."""


class Robot:
    """A robot, its transcript, and clients of its actions."""

    def __init__(
        self, ros, pace: float = 100.0, voice: Voice | None = None, needs_screen: bool = False
    ) -> None:
        self.ros = ros
        self.transcript = ros.collect(String, "robot/transcript", qos.EVENTS)
        self.questions = ros.collect(String, "robot/questions", qos.EVENTS)
        self.answers = ros.node.create_publisher(String, "answers", qos.EVENTS)
        self.clients = {n: ActionClient(ros.node, kind, n) for n, kind in ACTIONS.items()}
        overrides = [Parameter("pace", value=pace), Parameter("needs_screen", value=needs_screen)]
        if voice is None:
            overrides.append(Parameter("voice", value="off"))
        self.node = ros.add(RobotNode(voice=voice, parameter_overrides=overrides))
        ros.until(lambda: all(c.server_is_ready() for c in self.clients.values()))
        ros.until(self.answers.get_subscription_count)
        ros.until(lambda: self.node.count_subscribers("robot/transcript"))
        ros.until(lambda: self.node.count_subscribers("robot/questions"))

    @property
    def lines(self) -> list[str]:
        return [line.data for line in self.transcript]

    def send(self, action: str, feedback: list[Any] | None = None, **goal: Any) -> Any:
        """Send a goal and return its accepted handle."""
        client = self.clients[action]
        heard = (lambda m: feedback.append(m.feedback)) if feedback is not None else None
        sent = client.send_goal_async(ACTIONS[action].Goal(**goal), feedback_callback=heard)
        handle = self.ros.result(sent)
        assert handle.accepted
        return handle

    def result(self, handle: Any) -> tuple[int, Any]:
        """Wait for the end of a goal; return its status and result."""
        ended = self.ros.result(handle.get_result_async())
        return ended.status, ended.result

    def do(self, action: str, **goal: Any) -> tuple[int, Any]:
        return self.result(self.send(action, **goal))

    def cancel(self, handle: Any) -> tuple[int, Any]:
        assert len(self.ros.result(handle.cancel_goal_async()).goals_canceling) == 1
        return self.result(handle)


@pytest.mark.parametrize(
    ("action", "goal", "message", "line"),
    [
        ("say", {"text": "Hello", "rate": 1.0}, "", "says: Hello"),
        ("show", {"clip": "first_time"}, "", "shows: first_time"),
        ("ask", {"text": "Anybody?", "wait_s": 1.0}, "no answer", "asks: Anybody?"),
    ],
)
def test_action_succeeds_and_is_written_down(ros, action, goal, message, line):
    robot = Robot(ros)
    status, result = robot.do(action, **goal)
    assert (status, result.message) == (GoalStatus.STATUS_SUCCEEDED, message)
    ros.until(lambda: robot.lines == [line])
    late = ros.collect(String, "robot/transcript", qos.FACTS)
    ros.until(lambda: [act.data for act in late] == [line])


def test_drive_reports_remaining_distance(ros):
    robot = Robot(ros, pace=50.0)
    feedback: list[Any] = []
    status, result = robot.result(robot.send("drive", feedback, destination="gate"))
    assert (status, result.distance_m, result.message) == (GoalStatus.STATUS_SUCCEEDED, 12.0, "")
    left = [f.remaining_m for f in feedback]
    assert left
    assert left == sorted(left, reverse=True)
    ros.until(lambda: robot.lines == ["drives to: gate"])


def test_late_subscriber_receives_robot_state_and_question(ros):
    robot = Robot(ros, pace=20.0)
    handle = robot.send("ask", text="Shall we go?", choices=["Yes", " ", "No"], wait_s=1000.0)
    sounds = ros.node.create_publisher(String, "sound", qos.EVENTS)
    ros.until(sounds.get_subscription_count)
    assert ros.ask(SetLight, "set_light", colour="green", blink=True).accepted
    sounds.publish(String(data="chime"))
    ros.until(lambda: robot.questions)
    assert robot.questions[0].data == "Shall we go?"
    states = ros.collect(RobotState, "robot/state", qos.FACT)
    ros.until(lambda: states and states[-1].sounds == 1)
    state = states[-1]
    assert (state.light, state.light_blinks, state.sound) == ("green", True, "chime")
    [act] = state.acts
    assert (act.kind, act.text, act.number) == (RobotAct.ASK, "Shall we go?", 1)
    assert (list(act.choices), act.waiting) == (["Yes", "No"], True)
    told = ros.collect(OpenQuestions, "robot/open_questions", qos.FACT)
    ros.until(lambda: told)
    [question] = told[-1].questions
    assert (question.text, list(question.choices)) == ("Shall we go?", ["Yes", "No"])
    assert 0 <= seconds(ros.node.get_clock().now().to_msg()) - seconds(question.stamp) < 60
    robot.answers.publish(String(data="perhaps"))
    robot.answers.publish(String(data="yes"))
    status, result = robot.result(handle)
    assert (status, result.answer, result.message) == (GoalStatus.STATUS_SUCCEEDED, "Yes", "")
    ros.until(lambda: not states[-1].acts and not told[-1].questions)


@pytest.mark.parametrize(
    ("action", "goal", "words"),
    [
        ("say", {"text": "Hi", "rate": math.nan}, "rate is nan"),
        ("ask", {"text": "Hi?", "wait_s": math.inf}, "wait_s is inf"),
        ("show", {"clip": "a", "duration_s": math.nan}, "duration_s is nan"),
        ("drive", {"destination": "nowhere"}, "no way to 'nowhere'"),
    ],
)
def test_invalid_goal_is_aborted_with_message(ros, action, goal, words):
    robot = Robot(ros)
    status, result = robot.do(action, **goal)
    assert status == GoalStatus.STATUS_ABORTED
    assert words in result.message
    assert robot.lines == []


@pytest.mark.parametrize("action", ACTS)
def test_cancel_ends_running_action(ros, action):
    robot = Robot(ros, pace=0.1)
    handle = robot.send(action, **ACTS[action])
    ros.until(lambda: robot.lines)
    status, result = robot.cancel(handle)
    assert status == GoalStatus.STATUS_CANCELED
    assert result.message == "cancelled"


def test_two_texts_are_said_in_sequence(ros):
    robot = Robot(ros, pace=0.5)
    story = "One, two, three. " * 50 + "Four."  # the robot says it until it is cancelled
    first = robot.send("say", text=story)
    second = robot.send("say", text="Four.")
    third = robot.send("ask", text="Five?", wait_s=0.1)
    ros.turns()
    assert robot.lines == [f"says: {story}"]
    robot.cancel(first)
    status, result = robot.result(second)
    assert (status, result.duration_s > 0.0) == (GoalStatus.STATUS_SUCCEEDED, True)
    assert robot.result(third)[0] == GoalStatus.STATUS_SUCCEEDED
    assert robot.lines == [f"says: {story}", "says: Four.", "asks: Five?"]


def test_waiting_text_can_be_cancelled(ros):
    robot = Robot(ros, pace=0.1)
    robot.send("say", text="A long story.")
    waiting = robot.send("say", text="Never said.")
    assert robot.cancel(waiting)[0] == GoalStatus.STATUS_CANCELED
    assert robot.lines == ["says: A long story."]


def test_number_of_waiting_texts_is_limited(ros):
    robot = Robot(ros, pace=0.1)
    for _ in range(1 + MOST_WAITING):
        robot.send("say", text="A long story.")
    status, result = robot.do("say", text="One too many.")
    assert status == GoalStatus.STATUS_ABORTED
    assert "waiting to be said" in result.message


def test_robot_drives_to_one_place_at_a_time(ros):
    robot = Robot(ros, pace=0.1)
    robot.send("drive", destination="gate")
    status, result = robot.do("drive", destination="lift")
    assert status == GoalStatus.STATUS_ABORTED
    assert "driving to gate" in result.message


class Caller:
    """A host as seen by the robot: its open goals and its heartbeat."""

    def __init__(self, ros: Any) -> None:
        self.lists = ros.node.create_publisher(OpenGoals, "bt_agents/open_goals", qos.FACT)
        self.beats = ros.node.create_publisher(Heartbeat, "/agents/heartbeat", qos.EVENTS)
        beat = Heartbeat(host="/agents", host_instance="first")
        self.timer = ros.node.create_timer(0.05, lambda: self.beats.publish(beat), clock=STEADY)

    def open(self, handle: Any) -> None:
        """Publish an open goal."""
        goals = [OpenGoal(action="/drive", goal_id=handle.goal_id.uuid)]
        who = {"host": "/agents", "host_instance": "first", "heartbeat": "/agents/heartbeat"}
        self.lists.publish(OpenGoals(**who, goals=goals))


def test_drive_is_aborted_when_its_host_disappears(ros):
    robot = Robot(ros, pace=0.1)
    caller = Caller(ros)
    theirs, ours = robot.send("drive", destination="gate"), robot.send("show", clip="waves")
    caller.open(theirs)
    ros.until(caller.beats.get_subscription_count)
    caller.open(theirs)
    ros.turns(120)
    assert theirs.status == GoalStatus.STATUS_EXECUTING, "its host lives"
    caller.timer.cancel()
    status, result = robot.result(theirs)
    assert status == GoalStatus.STATUS_ABORTED
    assert "has been silent for" in result.message
    assert ours.status == GoalStatus.STATUS_EXECUTING, "nobody's goal goes on"
    robot.cancel(ours)


def person_page(ros: Any) -> Any:
    """Return the timer that sends the heartbeat of a page Person; it stands still at first."""
    beats = ros.node.create_publisher(Empty, "studio/person/heartbeat", qos.SENSOR)
    timer = ros.node.create_timer(
        0.05, lambda: beats.publish(Empty()), clock=STEADY, autostart=False
    )
    ros.until(beats.get_subscription_count)
    return timer


def test_closed_page_ends_what_it_shows(ros):
    robot = Robot(ros, pace=0.1, needs_screen=True)
    page = person_page(ros)
    page.reset()
    *shown, driving = [robot.send(action, **goal) for action, goal in ACTS.items()]
    ros.until(lambda: len(robot.lines) == 3)
    page.cancel()
    for handle in shown:
        status, result = robot.result(handle)
        assert (status, result.message) == (GoalStatus.STATUS_ABORTED, NO_PAGE)
    assert driving.status == GoalStatus.STATUS_EXECUTING
    for action in ("ask", "say", "show"):
        status, result = robot.do(action, **ACTS[action])
        assert (status, result.message) == (GoalStatus.STATUS_ABORTED, NO_PAGE)
    page.reset()
    wave = {"clip": "waves", "duration_s": 0.1}
    ros.until(lambda: robot.do("show", **wave)[0] == GoalStatus.STATUS_SUCCEEDED)
    robot.cancel(driving)


def test_first_goal_begins_when_page_is_opened(ros):
    robot = Robot(ros, needs_screen=True)
    page = person_page(ros)
    said = robot.send("say", text="Hello")
    ros.turns()
    assert robot.lines == []
    page.reset()
    assert robot.result(said)[0] == GoalStatus.STATUS_SUCCEEDED
    ros.until(lambda: robot.lines == ["says: Hello"])


def test_robot_refuses_actions_of_ended_run(ros):
    robot = Robot(ros)
    market = ros.node.create_publisher(MarketStatus, "bt_agents/market", qos.FACT)

    def is_accepted(run: RunKey) -> bool:
        goal = Say.Goal(text="I stop here.", run=run)
        return ros.result(robot.clients["say"].send_goal_async(goal)).accepted

    leo = RunKey(epoch="e1", round=7, agent="leo")
    market.publish(MarketStatus(epoch="e1", round=7, agent="leo", state=MarketStatus.RUNNING))
    ros.until(lambda: robot.do("say", text="One.", run=leo)[0] == GoalStatus.STATUS_SUCCEEDED)
    market.publish(MarketStatus(epoch="e1", round=8, agent="mira", state=MarketStatus.RUNNING))
    ros.until(lambda: not is_accepted(leo))
    said = len(robot.lines)
    assert not is_accepted(leo)
    lit = ros.ask(SetLight, "set_light", colour="green", run=leo)
    assert not lit.accepted
    assert "the run of leo in round 7, from which the market has gone on" in lit.message
    mira = RunKey(epoch="e1", round=8, agent="mira")
    assert robot.do("say", text="Three.", run=mira)[0] == GoalStatus.STATUS_SUCCEEDED
    assert robot.do("say", text="Four.")[0] == GoalStatus.STATUS_SUCCEEDED, "sent by hand"
    assert robot.lines[said:] == ["says: Three.", "says: Four."]


def test_next_run_ends_what_earlier_one_left(ros):
    robot = Robot(ros, pace=1.0)
    runs = [RunKey(epoch="e1", round=number, agent="leo") for number in (7, 8)]
    left = robot.send("drive", destination="gate", run=runs[0])
    by_hand = robot.send("show", clip="map")
    robot.send("say", text="Hello.", run=runs[1])
    assert robot.result(left)[0] == GoalStatus.STATUS_ABORTED
    assert robot.cancel(by_hand)[0] == GoalStatus.STATUS_CANCELED


def test_invalid_open_goals_lists_change_nothing(ros):
    robot = Robot(ros, pace=0.1)
    caller = Caller(ros)
    theirs = robot.send("drive", destination="gate")
    for topic in ("no topic", "/agents/heartbeat", ""):
        caller.lists.publish(
            OpenGoals(host=f"/h{topic!r}", heartbeat=topic, goals=[OpenGoal()], host_instance="x")
        )
        caller.lists.publish(OpenGoals(host=f"/h{topic!r}", heartbeat=topic, host_instance="x"))
        ros.turns()
    assert theirs.status == GoalStatus.STATUS_EXECUTING
    robot.cancel(theirs)


def test_switching_off_ends_everything(ros):
    robot = Robot(ros, pace=0.1)
    handles = [robot.send("say", text="A long story."), robot.send("drive", destination="gate")]
    robot.node.request_stop()
    for handle in handles:
        status, result = robot.result(handle)
        assert status == GoalStatus.STATUS_ABORTED
        assert "switched off" in result.message
    ros.until(robot.node.stopped)
    assert robot.do("say", text="More.")[0] == GoalStatus.STATUS_ABORTED


def test_light_accepts_only_known_colours(ros):
    robot = Robot(ros)
    for colour, accepted in (("green", True), ("Off", True), ("pink", False), ("", False)):
        answer = ros.ask(SetLight, "set_light", colour=colour, blink=True)
        assert answer.accepted is accepted
        assert answer.message
    ros.until(lambda: robot.lines == ["light: green, blinking", "light: off, blinking"])


def test_sound_is_played_and_empty_one_is_ignored(ros):
    robot = Robot(ros)
    sound = ros.node.create_publisher(String, "sound", qos.EVENTS)
    ros.until(sound.get_subscription_count)
    sound.publish(String(data=""))
    sound.publish(String(data="chi\x1bme"))
    ros.until(lambda: robot.lines == [r"sound: chi\x1bme"])


class FakeProcess:
    """A speech program that never ends by itself."""

    def __init__(self) -> None:
        self.code: int | None = None

    def poll(self) -> int | None:
        return self.code

    def terminate(self) -> None:
        self.code = -15


def test_a_cancelled_text_falls_silent(ros):
    processes: list[FakeProcess] = []

    def start(_command, _text):
        processes.append(FakeProcess())
        return processes[-1]

    voice = Voice(warn=print, find=lambda name: name, start=start)
    robot = Robot(ros, pace=0.1, voice=voice)
    handle = robot.send("say", text="A long story.")
    ros.until(lambda: processes)
    assert robot.cancel(handle)[0] == GoalStatus.STATUS_CANCELED
    assert processes[0].code == -15
