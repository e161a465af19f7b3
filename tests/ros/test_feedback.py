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
from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from bt_agents_interfaces.msg import (
    AgentCard,
    ChangedValue,
    Feedback,
    HostCard,
    Learning,
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
from bt_agents_ros.messages import scene_to_msg
from feedback_node.learning.profiles import MOST_HOSTS
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import RevisionCause
from feedback_node.simulated_feedback import SimulatedFeedback

pytestmark = pytest.mark.ros

NAN = math.nan
SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "familiarity", "mood")
    ),
    mood="mood",
)
WORSE = MoodRule(
    when="mood.change <= -1.0", hold_s=0.1, give=MoodRule.NEGATIVE, action=MoodRule.CANCEL
)


def scene(mood: float, scene_id: str = "s1") -> SceneMsg:
    values = zip(SPACE.names, (5.0, 1.0, mood), strict=True)
    return scene_to_msg(
        Scene(
            scene_id=scene_id,
            label="",
            person=True,
            values=tuple(
                SceneValue.missing(name)
                if math.isnan(value)
                else SceneValue(name=name, value=value, origin=Origin.MEASURED)
                for name, value in values
            ),
        )
    )


class FakeHost:
    """Introduces two agents and accepts new profiles."""

    def __init__(self, ros: Any, *, answers: bool = True) -> None:
        self.agents = {"guide": [4.0, 1.5, 3.0], "express": [2.0, 4.5, 3.0]}
        self.revisions = dict.fromkeys(self.agents, 0)
        self.told: list[SetProfile.Request] = []
        self.current: dict[str, Any] = {}
        self.cards = ros.node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
        if answers:
            ros.node.create_service(
                SetProfile, "/agents/set_profile", self._set, qos_profile=qos.SERVICE
            )

    def _set(self, request: Any, response: Any) -> Any:
        self.told.append(request)
        if not request.layer:
            self.current[request.agent] = request.values
        response.accepted = True
        return response

    def card(self, *rules: MoodRule, instance: str = "i1", **fields: Any) -> HostCard:
        agents = [
            AgentCard(
                name=name,
                profile=profile,
                current=self.current.get(name, profile) if self.revisions[name] else profile,
                revision=self.revisions[name],
                learning_rate=0.5,
                rules=rules,
            )
            for name, profile in self.agents.items()
        ]
        return HostCard(
            **{
                "host": "/agents",
                "host_instance": instance,
                "parameters": SPACE.names,
                "agents": agents,
                **fields,
            }
        )


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
        self.host = FakeHost(ros, answers=answers)
        self.runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
        self.live = ros.node.create_publisher(SceneMsg, "bt_agents/scene/live", qos.SENSOR)
        self.cancels: list[CancelRun.Request] = []
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
        self.ros.until(lambda: len(self.profiles) > seen)

    def event(self, event: int, number: int = 1, mood: float = 4.0) -> None:
        self.runs.publish(
            Run(epoch="e", round=number, event=event, agent="guide", scene=scene(mood))
        )

    def run(self) -> None:
        self.event(Run.STARTED)
        self.ros.until(lambda: self.node._controller._runs.current is not None)

    def give(self, **fields: Any) -> GiveFeedback.Response:
        return self.ros.call(self.give_client, GiveFeedback.Request(**fields))

    def collect(self, number: int = 1, **fields: Any) -> CollectFeedback.Response:
        request = {
            "epoch": "e",
            "round": number,
            "agent": "guide",
            "outcome": 1,
            "scene": scene(4.0),
        }
        return self.ros.call(self.collect_client, CollectFeedback.Request(**{**request, **fields}))

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


def test_host_card_introduces_agents_with_file_profiles(scenario):
    room = scenario()
    room.introduce()
    assert room.table() == {"guide": (0, [4.0, 1.5, 3.0]), "express": (0, [2.0, 4.5, 3.0])}
    assert room.host.told == []


def test_collection_is_answered_after_host_has_new_profile(scenario):
    room = scenario(SimulatedFeedback(PreparedFeedback(sequence=((5.0, NAN, 1.0),))))
    room.introduce()
    answer = room.collect()
    assert (answer.accepted, answer.applied) == (True, True)
    assert [list(one.values) for one in room.host.told] == [[4.5, 1.5, 2.0]]
    assert list(answer.feedback.after) == [4.5, 1.5, 2.0]
    assert list(answer.feedback.before) == [4.0, 1.5, 3.0]
    assert math.isnan(answer.feedback.target[1])
    assert (answer.feedback.source, answer.feedback.revision) == ("simulated", 1)
    room.ros.until(lambda: room.feedback and room.table()["guide"][0] == 1)
    assert [str(one) for one in room.feedback] == [str(answer.feedback)]


def test_collecting_twice_for_one_round_applies_once(scenario):
    room = scenario(SimulatedFeedback(PreparedFeedback(sequence=((5.0, 5.0, 5.0),), repeat=True)))
    room.introduce()
    first, again = room.collect(), room.collect()
    assert again.applied
    assert again.feedback.revision == first.feedback.revision == 1
    assert again.feedback.after == first.feedback.after
    assert room.collect(2).feedback.revision == 2
    assert len(room.feedback) == 2


def test_collection_without_simulated_feedback_applies_nothing(scenario):
    room = scenario()
    room.introduce()
    answer = room.collect()
    assert (answer.accepted, answer.applied, answer.message) == (
        True,
        False,
        "no feedback for guide",
    )


@pytest.mark.parametrize(
    ("sources", "text"),
    [
        (["tree"], "guide was given feedback once during its run (tree)"),
        (["tree", "", "tree"], "guide was given feedback 3 times during its run (tree, somebody)"),
    ],
)
def test_collection_acknowledges_feedback_given_by_tree(scenario, sources, text):
    room = scenario()
    room.introduce()
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


def test_positive_and_negative_feedback_move_last_agents_profile(scenario):
    room = scenario()
    room.introduce()
    room.run()
    room.event(Run.ENDED)
    room.ros.until(lambda: room.node._controller._runs.current is None)
    towards = room.give(kind=Feedback.POSITIVE, source="button")
    assert list(towards.feedback.after) == [4.5, 1.25, 3.5]
    away = room.give(kind=Feedback.NEGATIVE, source="button")
    assert list(away.feedback.after) == [4.25, 1.375, 3.25]
    direct = room.give(agent="express", kind=Feedback.DIRECT, values=[NAN, NAN, 5.0])
    assert list(direct.feedback.after) == [2.0, 4.5, 4.0]
    assert [(one.agent, one.revision) for one in room.host.told] == [
        ("guide", 1),
        ("guide", 2),
        ("express", 1),
    ]


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"kind": 1}, "NO_AGENT"),
        ({"kind": 1, "agent": "guide"}, "NO_SCENE"),
        ({"kind": 1, "agent": "ghost"}, "UNKNOWN_AGENT"),
        ({"kind": 200, "agent": "guide"}, "UNKNOWN_KIND"),
        ({"kind": 0, "agent": "guide", "values": []}, "WRONG_LENGTH"),
        ({"kind": 0, "agent": "guide", "values": [1.0] * 5000}, "WRONG_LENGTH"),
        ({"kind": 0, "agent": "guide", "values": [NAN, NAN, NAN]}, "NO_OPINION"),
        ({"kind": 0, "agent": "guide", "values": [math.inf, 1.0, 1.0]}, "NOT_FINITE"),
        ({"kind": 0, "agent": "guide", "values": [6.0, 1.0, 1.0]}, "OUT_OF_RANGE"),
    ],
)
def test_hostile_feedback_is_refused_and_changes_nothing(scenario, fields, code):
    room = scenario()
    room.introduce()
    answer = room.give(**fields)
    assert (answer.accepted, answer.code) == (False, code)
    assert answer.message
    assert room.table()["guide"] == (0, [4.0, 1.5, 3.0])
    assert room.host.told == room.feedback == []
    assert room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0]).accepted


def test_mood_change_is_credited_to_active_tree_node(scenario):
    room = scenario()
    room.introduce(WORSE)
    status = room.ros.node.create_publisher(TreeStatus, "/agents/status", qos.EVENTS)
    traces: list[MoodTrace] = room.ros.collect(MoodTrace, "bt_agents/mood_traces", qos.HISTORY)
    room.ros.until(lambda: status.get_subscription_count() == 1)
    room.run()
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
    room.ros.until(lambda: room.node._controller._trace.leaf_at(math.inf) == "tree/0.say")
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    room.live.publish(scene(2.5))
    room.ros.until(lambda: room.feedback)
    assert room.feedback[0].leaf == "tree/0.say"
    room.event(Run.ENDED)
    room.ros.until(lambda: traces)
    trace = traces[0]
    assert (trace.epoch, trace.round, trace.agent) == ("e", 1, "guide")
    assert (list(trace.leaves), list(trace.change)) == (["tree/0.say"], [-1.5])
    assert 2.5 <= trace.mean[0] <= 4.0
    assert trace.seconds[0] > 0.0
    [value] = trace.values
    assert (value.path, value.name, value.value) == ("tree/0.say", "word", "'hello'")


def test_agent_learns_by_rule_of_its_card(scenario):
    room = scenario()
    learning = Learning(
        update="plain", rates=[0.25, NAN, 0.0], window=5, drift=[NAN, 0.5, NAN], general=1.0
    )
    card = room.host.card()
    card.agents[0].learning = learning
    room.host.cards.publish(card)
    room.ros.until(lambda: room.profiles)
    answer = room.give(agent="guide", kind=Feedback.DIRECT, values=[2.0, 5.0, 5.0])
    assert list(answer.feedback.after) == [3.5, 2.0, 3.0]
    assert list(answer.feedback.rates) == [0.25, 0.5, 0.0]


def test_undecidable_mood_rule_is_published_with_profiles(scenario):
    room = scenario()
    room.introduce(MoodRule(when="1 / (live.mood - 3) > 0", give=MoodRule.NEGATIVE))
    room.run()
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    room.live.publish(scene(3.0))
    room.ros.until(lambda: room.profiles[-1].problems)
    [problem] = room.profiles[-1].problems
    assert (problem.agent, problem.message) == (
        "guide",
        "the mood rule cannot be decided: 1 / (live.mood - 3) > 0 ('/' by zero)",
    )


def test_falling_mood_teaches_agent_and_restarts_market_round(scenario):
    room = scenario()
    room.introduce(WORSE)
    room.run()
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    for mood in (4.0, 2.5):
        room.live.publish(scene(mood))
    room.ros.until(lambda: room.cancels and room.host.told and room.feedback)
    cancel, feedback = room.cancels[0], room.feedback[0]
    assert (cancel.epoch, cancel.round, cancel.again) == ("e", 1, True)
    assert cancel.scene == scene(2.5)
    assert cancel.reason == "mood.change <= -1.0 held 0.1 s: mood 4 → 2.5"
    assert (feedback.source, feedback.kind, feedback.cancels) == ("mood rule", 2, True)
    assert feedback.reason == cancel.reason
    assert list(feedback.after) == list(room.host.told[0].values) == [3.75, 1.625, 2.75]
    assert (feedback.weight, feedback.learning_rate, list(feedback.rates)) == (
        0.5,
        0.5,
        [0.25] * 3,
    )
    room.ros.turns()
    assert (len(room.cancels), len(room.feedback)) == (1, 1)


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
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    for mood in (4.0, 2.5):
        room.live.publish(scene(mood))
    room.ros.until(lambda: room.cancels)
    assert (room.feedback, room.host.told) == ([], [])
    database.execute("PRAGMA max_page_count = 1000000")
    room.ros.until(lambda: room.feedback and room.host.told)
    assert list(room.host.told[-1].values) == [3.75, 1.625, 2.75]
    assert (len(room.feedback), len(room.cancels)) == (1, 1)


def test_cancel_request_waits_for_market_to_return(scenario):
    room = scenario(market=False)
    room.introduce(WORSE)
    room.run()
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    room.live.publish(scene(2.5))
    room.ros.until(lambda: room.node._stops._unanswered)
    room.start_market()
    room.ros.until(lambda: room.cancels)
    assert (room.cancels[0].round, room.cancels[0].again) == (1, True)
    assert room.cancels[0].by == Run.MOOD_RULE
    assert room.cancels[0].scene == scene(2.5)
    room.ros.turns(150)
    assert len(room.cancels) == 1


def test_ended_run_is_not_cancelled(scenario):
    room = scenario(market=False)
    room.introduce(WORSE)
    room.run()
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    room.live.publish(scene(2.5))
    room.ros.until(lambda: room.node._stops._unanswered)
    room.event(Run.ENDED)
    room.ros.until(lambda: room.node._controller._runs.current is None)
    room.ros.until(lambda: not (room.node._stops._unanswered or room.node._calls._open))
    room.start_market()
    room.ros.turns(150)
    assert room.cancels == []


def test_empty_card_of_other_instance_keeps_agents_known(scenario):
    room = scenario()
    room.introduce()
    room.host.cards.publish(room.host.card(instance="i2", agents=[]))
    room.ros.turns()
    assert room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0]).accepted


def test_idle_host_without_agents_is_forgotten(scenario):
    room = scenario()
    room.introduce()
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
    ros.until(lambda: room.live.get_subscription_count() == 1)
    room.live.publish(scene(1.0))
    ros.until(lambda: room.node._controller._runs.last() is not None)
    room.live.publish(scene(1.0))
    ros.turns()
    assert room.cancels == room.feedback == []
    assert room.give(kind=Feedback.POSITIVE).feedback.agent == "guide"


def test_returning_host_gets_its_missed_profile(scenario):
    room = scenario(answers=False)
    room.introduce()
    answer = room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0])
    assert answer.accepted
    assert "when its card shows up again" in answer.message
    host = FakeHost(room.ros)
    host.cards.publish(host.card(instance="i2"))
    room.ros.until(lambda: host.told)
    assert (list(host.told[0].values), host.told[0].revision) == ([4.5, 3.25, 4.0], 1)


def test_restarted_node_restores_learned_profiles(ros, tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        room = Scenario(ros, ledger)
        room.introduce()
        room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0])
        ros.remove(room.node)
    with Ledger(path) as ledger:
        # The latched card is still there, so no host must introduce itself again.
        room.node = ros.add(active_feedback(SPACE, ledger))
        ros.until(lambda: len(room.host.told) == 2)
        ros.until(lambda: room.table()["guide"] == (1, [4.5, 3.25, 4.0]))
        ros.remove(room.node)
    assert room.host.told[0].values == room.host.told[1].values


def test_host_with_current_profiles_is_not_updated(scenario):
    room = scenario()
    room.introduce()
    room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0])
    room.host.revisions["guide"] = 1
    room.host.cards.publish(room.host.card())
    room.ros.turns()
    assert len(room.host.told) == 1


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


def test_forged_hosts_do_not_displace_real_host(scenario):
    room = scenario()
    forger = room.ros.node.create_publisher(HostCard, "bt_agents/cards", qos.FACTS)

    def forge(first: int) -> None:
        last = first + MOST_HOSTS + 20
        for number in range(first, last):
            agent = AgentCard(name=f"a{number}", profile=[3.0, 3.0, 3.0])
            forger.publish(room.host.card(host=f"/h{number}", agents=[agent]))
        room.ros.until(lambda: f"/h{last - 1}" in room.node._profiles.hosts)

    forge(0)
    room.introduce()
    assert room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0]).accepted
    forge(1_000)
    assert room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0]).accepted
    assert len(room.node._profiles.hosts) == MOST_HOSTS


def test_unreadable_rule_does_not_disable_agents_other_rules(scenario):
    room = scenario()
    broken = MoodRule(
        when="mood.change <=", hold_s=0.1, give=MoodRule.NEGATIVE, action=MoodRule.CANCEL
    )
    room.introduce(broken, WORSE)
    assert "the rule is skipped" in room.node._problems["/agents"][0]
    room.run()
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    room.live.publish(scene(2.0))
    room.ros.until(lambda: room.cancels)


def test_rule_still_fires_after_hostile_scenes_and_runs(scenario):
    room = scenario()
    room.introduce(WORSE)
    room.runs.publish(Run(event=Run.STARTED, agent="guide"))
    room.runs.publish(Run(event=200, agent="guide", scene=scene(4.0)))
    room.run()
    room.ros.until(lambda: room.live.get_subscription_count() == 1)
    wrong = scene(4.0)
    wrong.values[0].value = math.inf
    short = scene(4.0)
    short.values = short.values[:1]
    for message in (SceneMsg(), wrong, short, scene(2.0)):
        room.live.publish(message)
    room.ros.until(lambda: room.cancels)


def test_concurrent_feedback_requests_are_answered_in_order(scenario):
    room = scenario()
    room.introduce()
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


def test_feedback_without_id_does_not_wait_for_card(scenario):
    room = scenario()
    assert room.give(agent="guide", kind=1).code == "UNKNOWN_AGENT"


def test_late_feedback_applies_to_scene_it_names(scenario):
    room = scenario()
    room.introduce()
    room.run()
    late = scene(5.0, "s0")
    late.values[0].value, late.values[1].value = 1.0, 5.0
    answer = room.give(feedback_id="tree/1", agent="guide", kind=Feedback.POSITIVE, scene=late)
    assert list(answer.feedback.after) == [2.5, 3.25, 4.0]
    assert (answer.feedback.epoch, answer.feedback.round) == ("", 0)
    now = room.give(agent="guide", kind=Feedback.POSITIVE, scene=scene(4.0))
    assert (now.feedback.epoch, now.feedback.round) == ("e", 1)


def test_feedback_with_malformed_scene_is_refused(scenario):
    room = scenario()
    room.introduce()
    wrong = scene(4.0)
    wrong.values[0].value = 77.0
    answer = room.give(agent="guide", kind=Feedback.POSITIVE, scene=wrong)
    assert (answer.accepted, answer.code) == (False, "OUT_OF_RANGE")
    assert room.table()["guide"][0] == 0


def test_tuned_profile_becomes_revision_immediately(scenario):
    room = scenario()
    room.introduce()
    answer = room.give(
        feedback_id="tuning/1", agent="guide", kind=Feedback.SET, values=[NAN, 5.0, NAN]
    )
    assert list(answer.feedback.after) == [4.0, 5.0, 3.0]
    assert (answer.feedback.kind, answer.feedback.learning_rate) == (Feedback.SET, 1.0)
    assert list(room.host.told[0].values) == [4.0, 5.0, 3.0]


def test_unresponsive_host_gets_its_profile_on_return(scenario):
    room = scenario(answers=False)
    room.introduce()
    assert "it is kept" in room.give(agent="guide", kind=0, values=[5.0, 5.0, 5.0]).message
    late: list[SetProfile.Request] = []

    def take(request: SetProfile.Request, response: SetProfile.Response) -> SetProfile.Response:
        late.append(request)
        response.accepted = True
        return response

    room.ros.node.create_service(SetProfile, "/agents/set_profile", take, qos_profile=qos.SERVICE)
    room.ros.until(lambda: late)
    assert (list(late[0].values), late[0].revision) == ([4.5, 3.25, 4.0], 1)
    room.ros.turns(150)
    assert len(late) == 1
