# SPDX-License-Identifier: Apache-2.0
"""The feedback node between a host, a market and people, over real DDS."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest
from rclpy.parameter import Parameter

from active_nodes import active_feedback
from bt_agents_interfaces.msg import (
    AgentCard,
    ChangedValue,
    Feedback,
    HostCard,
    MoodRule,
    MoodTrace,
    Profiles,
    Run,
    StatusChange,
    TreeStatus,
)
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import CancelRun, CollectFeedback, GiveFeedback, SetProfile
from bt_agents_language.model.experiment import PreparedFeedback
from bt_agents_ros import qos
from bt_agents_ros.messages import header_at, scene_to_msg, to_time
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import RevisionCause
from feedback_node.simulated_feedback import SimulatedFeedback
from market_harness import SPACE
from market_harness import scene as market_scene

NAN = math.nan
WORSE = MoodRule(
    when="mood.change <= -1.0", hold_s=0.1, give=MoodRule.NEGATIVE, action=MoodRule.CANCEL
)


def scene(mood: float) -> SceneMsg:
    return scene_to_msg(market_scene("s1", 5.0, 1.0, mood))


class FakeHost:
    """Introduces two agents and accepts new profiles."""

    def __init__(self, ros: Any) -> None:
        self.agents = {"guide": [4.0, 1.5, 3.0], "express": [2.0, 4.5, 3.0]}
        self.told: list[SetProfile.Request] = []
        self.cards = ros.node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
        self._node = ros.node

    def start(self) -> None:
        self._node.create_service(
            SetProfile, "/agents/set_profile", self._set, qos_profile=qos.SERVICE
        )

    def _set(self, request: Any, response: Any) -> Any:
        self.told.append(request)
        response.accepted = True
        return response

    def card(self, *rules: MoodRule, **fields: Any) -> HostCard:
        agents = [
            AgentCard(name=name, profile=profile, current=profile, learning_rate=0.5, rules=rules)
            for name, profile in self.agents.items()
        ]
        usual = {"host": "/agents", "host_instance": "i1", "parameters": SPACE.names}
        return HostCard(**{**usual, "agents": agents, **fields})


class Scenario:
    """The node under test; the probe node fakes everything around it."""

    def __init__(
        self,
        ros: Any,
        ledger: Ledger,
        simulated: SimulatedFeedback | None = None,
        *,
        answers: bool = True,
        market: bool = True,
    ) -> None:
        self.ros = ros
        self.host = FakeHost(ros)
        self.runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
        self.live = ros.node.create_publisher(SceneMsg, "bt_agents/scene/live", qos.SENSOR)
        self.cancels: list[CancelRun.Request] = []
        if answers:
            self.host.start()
        if market:
            self.start_market()
        self.feedback: list[Feedback] = ros.collect(Feedback, "bt_agents/feedback", qos.HISTORY)
        self.profiles: list[Profiles] = ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
        self.collect_client = ros.node.create_client(
            CollectFeedback, "feedback/collect", qos_profile=qos.SERVICE
        )
        self.give_client = ros.node.create_client(
            GiveFeedback, "feedback/give", qos_profile=qos.SERVICE
        )
        self.node = ros.add(active_feedback(SPACE, ledger, simulated))
        # A live scene that is published once counts until its rule fires.
        [done] = self.node.set_parameters([Parameter("live_lease", value=60.0)])
        assert done.successful, done.reason

    def start_market(self) -> None:
        self.ros.node.create_service(
            CancelRun, "marketplace/cancel", self._cancel, qos_profile=qos.SERVICE
        )

    def _cancel(self, request: Any, response: Any) -> Any:
        self.cancels.append(request)
        response.accepted = True
        return response

    def introduce(self, *rules: MoodRule, **fields: Any) -> None:
        seen = len(self.profiles)
        self.host.cards.publish(self.host.card(*rules, **fields))
        self.ros.until(lambda: len(self.profiles) > seen and self.live.get_subscription_count())

    def event(self, event: int) -> None:
        at = header_at(to_time(7.0))  # simulated time
        self.runs.publish(
            Run(header=at, epoch="e", round=1, event=event, agent="guide", scene=scene(4.0))
        )

    def run(self) -> None:
        self.event(Run.STARTED)
        self.ros.until(lambda: self.node._controller._runs.current is not None)

    def give(self, **fields: Any) -> GiveFeedback.Response:
        return self.ros.call(self.give_client, GiveFeedback.Request(**fields))

    def collect(self, number: int = 1, **fields: Any) -> CollectFeedback.Response:
        usual = {"epoch": "e", "agent": "guide", "outcome": 1, "scene": scene(4.0)}
        request = CollectFeedback.Request(round=number, **{**usual, **fields})
        return self.ros.call(self.collect_client, request)

    def table(self) -> dict[str, tuple[int, list[float]]]:
        last = self.profiles[-1]
        width = len(last.parameters)
        return {
            name: (last.revisions[row], list(last.vectors[row * width : (row + 1) * width]))
            for row, name in enumerate(last.agents)
        }


@pytest.fixture
def ledger() -> Iterator[Ledger]:
    """A ledger; requested before ``ros``, so it is closed after the node that writes to it."""
    with Ledger(":memory:") as ledger:
        yield ledger


@pytest.fixture
def scenario(ledger: Ledger, ros: Any) -> Callable[..., Scenario]:
    return lambda *args, **fields: Scenario(ros, ledger, *args, **fields)


@pytest.fixture
def room(scenario: Callable[..., Scenario]) -> Scenario:
    """The node with the agents of a host."""
    made = scenario()
    made.introduce()
    return made


@pytest.fixture
def running(scenario: Callable[..., Scenario]) -> Scenario:
    """The node during a run whose agent has a mood rule."""
    made = scenario()
    made.introduce(WORSE)
    made.run()
    return made


def test_collection_is_answered_after_host_has_new_profile(scenario):
    rows = PreparedFeedback(sequence=((5.0, NAN, 1.0),), repeat=True)
    room = scenario(SimulatedFeedback(rows))
    room.introduce()
    assert room.table() == {"guide": (0, [4.0, 1.5, 3.0]), "express": (0, [2.0, 4.5, 3.0])}
    answer = room.collect()
    assert (answer.accepted, answer.applied) == (True, True)
    assert [list(one.values) for one in room.host.told] == [[4.5, 1.5, 2.0]]
    assert list(answer.feedback.after) == [4.5, 1.5, 2.0]
    assert list(answer.feedback.before) == [4.0, 1.5, 3.0]
    assert math.isnan(answer.feedback.target[1])
    assert (answer.feedback.source, answer.feedback.revision) == ("simulated", 1)
    again = room.collect()
    assert again.applied
    assert str(again.feedback) == str(answer.feedback)
    later = room.collect(2)
    room.ros.until(lambda: room.table()["guide"][0] == 2 and len(room.feedback) == 2)
    assert [str(one) for one in room.feedback] == [str(answer.feedback), str(later.feedback)]


@pytest.mark.parametrize(
    ("sources", "text"),
    [
        ([], "no feedback for guide"),
        (["tree"], "guide was given feedback once during its run (tree)"),
        (["tree", "", "tree"], "guide was given feedback 3 times during its run (tree, somebody)"),
    ],
)
def test_collection_acknowledges_feedback_given_by_tree(room, sources, text):
    room.run()
    for source in sources:
        assert room.give(agent="guide", kind=Feedback.NEGATIVE, source=source).accepted
    answer = room.collect()
    assert (answer.accepted, answer.applied, answer.message) == (True, False, text)


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"agent": "ghost"}, "UNKNOWN_AGENT"),
        ({"number": 0}, "NO_RUN"),
        ({"epoch": ""}, "NO_RUN"),
        ({"outcome": 9}, "UNKNOWN_OUTCOME"),
        ({"scene": SceneMsg()}, "EMPTY"),
    ],
)
def test_invalid_collection_is_refused(scenario, fields, code):
    room = scenario(SimulatedFeedback(PreparedFeedback(each={"guide": (5.0, 5.0, 5.0)})))
    room.introduce()
    room.node._cards_until = 0.0
    answer = room.collect(**fields)
    assert (answer.accepted, answer.applied, answer.code) == (False, False, code)
    assert room.table()["guide"] == (0, [4.0, 1.5, 3.0])


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"kind": 1}, "NO_AGENT"),
        ({"kind": 1, "agent": "guide"}, "NO_SCENE"),
        ({"kind": 1, "agent": "ghost"}, "UNKNOWN_AGENT"),
        ({"kind": 200, "agent": "guide"}, "UNKNOWN_KIND"),
    ],
)
def test_hostile_feedback_is_refused_and_changes_nothing(room, fields, code):
    answer = room.give(**fields)
    assert (answer.accepted, answer.code) == (False, code)
    assert answer.message
    assert room.table()["guide"] == (0, [4.0, 1.5, 3.0])
    assert room.host.told == room.feedback == []
    assert room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0]).accepted


def test_mood_change_is_credited_to_active_tree_node(running):
    status = running.ros.node.create_publisher(TreeStatus, "/agents/status", qos.EVENTS)
    traces: list[MoodTrace] = running.ros.collect(MoodTrace, "bt_agents/mood_traces", qos.HISTORY)
    running.ros.until(lambda: status.get_subscription_count() == 1)
    changed = [ChangedValue(name="word", value="'hello'")]
    status.publish(
        TreeStatus(
            epoch="e",
            round=1,
            agent="guide",
            tick=1,
            tip="tree/0.say",
            changes=[StatusChange(path="tree/0.say", values=changed)],
        )
    )
    running.ros.until(lambda: running.node._controller._trace.leaf_at(math.inf) == "tree/0.say")
    running.live.publish(scene(2.5))
    running.ros.until(lambda: running.feedback)
    assert running.feedback[0].leaf == "tree/0.say"
    running.event(Run.ENDED)
    running.ros.until(lambda: traces)
    trace = traces[0]
    assert (trace.epoch, trace.round, trace.agent) == ("e", 1, "guide")
    assert trace.header.stamp == to_time(7.0)
    assert (list(trace.leaves), list(trace.change)) == (["tree/0.say"], [-1.5])
    assert 2.5 <= trace.mean[0] <= 4.0
    assert trace.seconds[0] > 0.0
    [value] = trace.values
    assert (value.path, value.name, value.value) == ("tree/0.say", "word", "'hello'")


def test_undecidable_mood_rule_is_published_with_profiles(scenario):
    room = scenario()
    room.introduce(MoodRule(when="1 / (live.mood - 3) > 0", give=MoodRule.NEGATIVE))
    room.run()
    room.live.publish(scene(3.0))
    room.ros.until(lambda: room.profiles[-1].problems)
    [problem] = room.profiles[-1].problems
    assert (problem.agent, problem.message) == (
        "guide",
        "the mood rule cannot be decided: 1 / (live.mood - 3) > 0 ('/' by zero)",
    )


def test_falling_mood_teaches_agent_and_restarts_market_round(running):
    for mood in (4.0, 2.5):
        running.live.publish(scene(mood))
    running.ros.until(lambda: running.cancels and running.host.told and running.feedback)
    cancel, feedback = running.cancels[0], running.feedback[0]
    assert (cancel.epoch, cancel.round, cancel.again) == ("e", 1, True)
    assert cancel.scene == scene(2.5)
    assert cancel.reason == "mood.change <= -1.0 held 0.1 s: mood 4 → 2.5"
    assert (feedback.source, feedback.kind, feedback.cancels) == ("mood rule", 2, True)
    assert feedback.reason == cancel.reason
    assert list(feedback.after) == list(running.host.told[0].values) == [3.75, 1.625, 2.75]
    assert (feedback.weight, feedback.learning_rate) == (0.5, 0.5)
    assert list(feedback.rates) == [0.25] * 3
    running.ros.turns()
    assert (len(running.cancels), len(running.feedback)) == (1, 1)


def test_full_disk_delays_rule_feedback_until_space_returns(scenario, ledger):
    room = scenario()
    room.introduce(WORSE)
    database = ledger._database
    pages = database.execute("PRAGMA page_count").fetchone()[0]
    database.execute(f"PRAGMA max_page_count = {pages}")
    for reason in ("long" * 200, ""):
        with suppress(LedgerError):
            while True:
                ledger.append("express", {"age": 3.0}, RevisionCause(reason=reason))
    room.run()
    for mood in (4.0, 2.5):
        room.live.publish(scene(mood))
    room.ros.until(lambda: room.cancels)
    assert (room.feedback, room.host.told) == ([], [])
    database.execute("PRAGMA max_page_count = 1000000")
    room.ros.until(lambda: room.feedback and room.host.told)
    assert list(room.host.told[-1].values) == [3.75, 1.625, 2.75]
    assert (len(room.feedback), len(room.cancels)) == (1, 1)


@pytest.fixture
def unanswered(scenario: Callable[..., Scenario]) -> Scenario:
    """The node whose mood rule asks an absent market to cancel the run."""
    made = scenario(market=False)
    made.introduce(WORSE)
    made.run()
    made.live.publish(scene(2.5))
    made.ros.until(lambda: made.node._stops._unanswered)
    return made


def test_cancel_request_waits_for_market_to_return(unanswered):
    unanswered.start_market()
    unanswered.ros.until(lambda: unanswered.cancels)
    [cancel] = unanswered.cancels
    assert (cancel.round, cancel.again, cancel.by) == (1, True, Run.MOOD_RULE)
    assert cancel.scene == scene(2.5)
    unanswered.ros.turns(150)
    assert len(unanswered.cancels) == 1


def test_ended_run_is_not_cancelled(unanswered):
    node = unanswered.node
    unanswered.event(Run.ENDED)
    unanswered.ros.until(lambda: node._controller._runs.current is None)
    unanswered.ros.until(lambda: not (node._stops._unanswered or node._calls._open))
    unanswered.start_market()
    unanswered.ros.turns(150)
    assert unanswered.cancels == []


def test_idle_host_without_agents_is_forgotten(room):
    room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0])
    assert set(room.node._hosts._clients) == {"/agents"}
    room.introduce(agents=[])
    room.ros.until(lambda: not room.node._hosts._clients)
    room.introduce()
    room.ros.until(lambda: len(room.host.told) == 2)


def test_ended_run_replayed_from_history_is_not_watched(ledger, ros):
    runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
    for event in (Run.STARTED, Run.ENDED):
        runs.publish(Run(epoch="e", round=1, event=event, agent="guide", scene=scene(4.0)))
    eager = MoodRule(
        when="live.mood < 3", hold_s=0.0, give=MoodRule.NEGATIVE, action=MoodRule.CANCEL
    )
    room = Scenario(ros, ledger)
    room.introduce(eager)
    room.live.publish(scene(1.0))
    ros.until(lambda: room.node._controller._runs.last() is not None)
    room.live.publish(scene(1.0))
    ros.turns()
    assert room.cancels == room.feedback == []
    assert room.give(kind=Feedback.POSITIVE).feedback.agent == "guide"


@pytest.mark.parametrize(
    "fields",
    [
        {"parameters": ["age"]},
        {"parameters": ["mood", "familiarity", "age"]},
        {"host": ""},
        {"host": "/not a name"},
        {"host": "//"},
    ],
)
def test_hostile_card_is_refused_and_node_survives(scenario, fields):
    room = scenario()
    room.host.cards.publish(room.host.card(**fields))
    room.ros.until(lambda: room.node._problems)
    assert room.node._profiles.table() == ()
    room.introduce()
    assert set(room.table()) == {"guide", "express"}


def test_rule_still_fires_after_hostile_scenes_and_runs(scenario):
    room = scenario()
    room.introduce(WORSE)
    room.runs.publish(Run(event=Run.STARTED, agent="guide"))
    room.runs.publish(Run(event=200, agent="guide", scene=scene(4.0)))
    room.run()
    short = scene(4.0)
    short.values = short.values[:1]
    for message in (SceneMsg(), scene(math.inf), short, scene(2.0)):
        room.live.publish(message)
    room.ros.until(lambda: room.cancels)


def test_concurrent_feedback_requests_are_answered_in_order(room):
    room.ros.until(room.give_client.service_is_ready)
    request = GiveFeedback.Request(agent="guide", kind=0, values=[5.0, 5.0, 5.0])
    futures = [room.give_client.call_async(request) for _ in range(5)]
    room.ros.until(lambda: all(future.done() for future in futures))
    assert sorted(future.result().feedback.revision for future in futures) == [1, 2, 3, 4, 5]
    assert [one.revision for one in room.host.told] == [1, 2, 3, 4, 5]


# --- feedback that waited for the node -----------------------------------------------------


def test_kept_feedback_waits_for_its_agents_card(scenario):
    room = scenario(SimulatedFeedback(PreparedFeedback(sequence=((5.0, 5.0, 5.0),))))
    room.ros.until(lambda: room.give_client.service_is_ready())
    room.ros.until(lambda: room.collect_client.service_is_ready())
    given = room.give_client.call_async(
        GiveFeedback.Request(feedback_id="tree/1", agent="guide", kind=1, scene=scene(5.0))
    )
    collected = room.collect_client.call_async(
        CollectFeedback.Request(epoch="e", round=1, agent="guide", outcome=1, scene=scene(4.0))
    )
    room.ros.turns()
    assert not given.done()
    assert not collected.done()
    room.introduce()
    room.ros.until(lambda: given.done() and collected.done())
    assert given.result().accepted
    assert collected.result().applied
    assert room.table()["guide"][0] == 2


def test_unresponsive_host_gets_its_profile_on_return(scenario):
    room = scenario(answers=False)
    room.introduce()
    answer = room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0])
    assert answer.accepted
    assert "it is kept and goes to the host when its card shows up again" in answer.message
    room.host.start()
    room.ros.until(lambda: room.host.told)
    room.ros.turns(150)
    [late] = room.host.told
    assert (list(late.values), late.revision) == ([4.5, 3.25, 4.0], 1)
