# SPDX-License-Identifier: Apache-2.0
"""Projection of messages: scenes, pauses, countdowns, values of nodes."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bt_agents_interfaces.msg import (
    AgentCard,
    AgentFiles,
    Auction,
    Breakpoint,
    ChangedValue,
    Countdown,
    Feedback,
    HostCard,
    MoodRule,
    NodeDetails,
    NodeValue,
    Preset,
    RecordingStatus,
    RobotAct,
    RobotState,
    Run,
    RunControl,
    Scene,
    StatusChange,
    TreeStatus,
    Tunings,
)
from bt_agents_ros.messages import header_at, to_time
from bt_agents_studio.projection import Projection
from bt_agents_studio.projection.health import UNTOLD_S
from bt_agents_studio.store import Store

RUN = {"agent": "guide", "epoch": "e1", "round": 3}
KEY = "guide|tree/0.ask"


class Shown:
    """A store filled by messages, one second apart."""

    def __init__(self) -> None:
        self.store = Store()
        self.projection = Projection(self.store)
        self._now = 1000.0

    def take(self, message: Any, stamp: float | None = None) -> None:
        self._now += 1.0
        if hasattr(message, "header"):
            message.header = header_at(to_time(self._now if stamp is None else stamp))
        kind = f"bt_agents_interfaces/msg/{type(message).__name__}"
        self.projection.handle(kind, message, self._now)

    def details(self, *countdowns: Countdown, values: tuple[NodeValue, ...] = ()) -> None:
        self.take(NodeDetails(**RUN, tick=7, countdowns=countdowns, values=values))

    def get(self, collection: str, key: str = KEY) -> Any:
        return self.store.get(collection, key)

    @property
    def log(self) -> list[str]:
        return [self.get("log", key).text for key in self.store.keys("log")]


@pytest.fixture
def shown() -> Shown:
    one = Shown()
    one.take(Run(**RUN, event=Run.STARTED))
    return one


def test_log_names_scenes_by_label(shown: Shown) -> None:
    shown.take(Scene(scene_id="scene-7", label="a child", person=True))
    shown.take(Run(**RUN, event=Run.ENDED, message="scene 'scene-7' was cancelled"))
    assert shown.log[-2:] == ["a child", "ended: scene 'a child' was cancelled"]


def time_left(seconds: float, path: str = "tree/0.ask") -> Countdown:
    return Countdown(path=path, kind="retry", unit=Countdown.TIME, remaining_s=seconds)


def rounds_left(count: int, path: str = "tree/0.ask") -> Countdown:
    return Countdown(
        path=path, kind="retry", unit=Countdown.ATTEMPTS, remaining_s=math.nan, remaining=count
    )


def test_remaining_time_and_rounds_share_one_entry(shown: Shown) -> None:
    found = []
    for countdowns in ((time_left(2.5), rounds_left(1)), (rounds_left(0),)):
        shown.details(*countdowns)
        record = shown.get("countdowns")
        found.append((record.kind, record.remaining_s, record.remaining))
    assert found == [("retry", 2.5, 1), ("retry", None, 0)]


def test_countdown_knows_its_whole_time(shown: Shown) -> None:
    shown.details(time_left(8.0), rounds_left(1, "tree"))
    shown.details(time_left(5.0), rounds_left(1, "tree"))
    assert shown.get("countdowns").whole_s == 8.0
    assert shown.get("countdowns", "guide|tree").whole_s is None
    shown.details(time_left(6.0))
    assert shown.get("countdowns").whole_s == 6.0


def test_countdown_is_removed_at_its_or_runs_end(shown: Shown) -> None:
    shown.details(time_left(2.5), time_left(9.0, "tree"))
    shown.details(time_left(8.0, "tree"))
    assert shown.store.keys("countdowns") == ("guide|tree",)
    shown.take(Run(**RUN, event=Run.ENDED))
    shown.details(time_left(7.0, "tree"))
    assert shown.store.keys("countdowns") == ()


def value(name: str, text: str, *, written: bool = False) -> NodeValue:
    return NodeValue(path="tree/0.ask", name=name, value=text, written=written)


def test_last_value_per_name_is_kept_newest_last(shown: Shown) -> None:
    shown.details(values=(value("patience", "8"), value("answer", "'no'", written=True)))
    shown.details(values=(value("patience", "9"),))
    found = [(one.name, one.value, one.written) for one in shown.get("values").values]
    assert found == [("answer", "'no'", True), ("patience", "9", False)]


def test_newest_of_too_many_names_are_kept(shown: Shown) -> None:
    shown.details(values=tuple(value(f"name_{number}", "1") for number in range(100)))
    names = [one.name for one in shown.get("values").values]
    assert names == [f"name_{number}" for number in range(60, 100)]


def test_new_run_clears_values_of_previous_run(shown: Shown) -> None:
    shown.details(values=(value("patience", "8"),))
    shown.take(Run(**RUN | {"round": 4}, event=Run.STARTED))
    assert shown.get("values") is None


def test_details_of_earlier_run_change_nothing(shown: Shown) -> None:
    shown.take(Run(**RUN | {"round": 4}, event=Run.STARTED))
    late = NodeDetails(**RUN, values=[value("patience", "8")], header=header_at(to_time(1000.5)))
    shown.projection.handle("bt_agents_interfaces/msg/NodeDetails", late, 1003.0)
    assert shown.get("values") is None
    assert shown.get("runs", "guide").round == 4


def control(**fields: Any) -> RunControl:
    return RunControl(**RUN | {"host": "/agents"} | fields)


def test_breakpoints_are_kept_per_agent(shown: Shown) -> None:
    stops = [Breakpoint(agent="guide", path=path) for path in ("tree", "tree/0.ask")]
    shown.take(control(breakpoints=[*stops, Breakpoint(agent="other", path="tree")]))
    kept = {"guide": ("tree", "tree/0.ask"), "other": ("tree",)}
    assert shown.get("controls", "/agents").breakpoints == kept
    shown.take(control())
    assert shown.get("controls", "/agents").breakpoints == {}


def test_log_reports_each_pause_once(shown: Shown) -> None:
    before = len(shown.log)
    shown.take(control())
    shown.take(control(paused=True, author="anna"))
    shown.take(control(paused=True, author="anna"))
    shown.take(control(paused=True, paused_at="tree/0.ask"))
    shown.take(control())
    shown.take(control())
    assert shown.log[before:] == ["is paused by anna", "is paused before tree/0.ask", "goes on"]


def test_pause_ending_with_run_is_no_resume(shown: Shown) -> None:
    shown.take(control(paused=True))
    before = len(shown.log)
    shown.take(RunControl(host="/agents"))
    assert shown.log[before:] == []


def test_changed_values_belong_to_their_node(shown: Shown) -> None:
    change = StatusChange(path="tree/0.ask", name="ask", status=StatusChange.SUCCESS)
    change.values = [ChangedValue(name="answer", value="'yes'")]
    shown.take(TreeStatus(**RUN, tick=8, changes=[change]))
    [record] = shown.get("values").values
    assert (record.name, record.value, record.written, record.tick) == ("answer", "'yes'", True, 8)
    assert shown.log[-1] == "ask: success, answer = 'yes'"
    shown.details(values=(value("answer", "'yes'", written=True),))
    assert len(shown.get("values").values) == 1


def test_new_message_of_running_node_is_no_restart(shown: Shown) -> None:
    for message in ("", "attempt 2 of 3"):
        change = StatusChange(path="tree/0.ask", status=StatusChange.RUNNING, message=message)
        shown.take(TreeStatus(**RUN, changes=[change]))
    assert shown.get("nodes").starts == 1


PATHS = {
    "tree": "tree",
    "ask": "tree/0.ask",
    "ask_timeout": "tree/0.ask@timeout",
    "say": "tree/1.say",
    "handled": "tree/1.say@on_failure",
    "handler": "tree/1.say@on_failure/0.light",
}


def tick(shown: Shown, *changed: str) -> None:
    """Take the changes of a tick, in order, such as ``ask SUCCESS``."""
    pairs = [one.split() for one in changed]
    changes = [
        StatusChange(path=PATHS[name], status=getattr(StatusChange, status))
        for name, status in pairs
    ]
    shown.take(TreeStatus(**RUN, tick=8, changes=changes))


def statuses(shown: Shown) -> set[str]:
    """Return the status of each node, in the words of :func:`tick`."""
    known = {f"guide|{path}": name for name, path in PATHS.items()}
    return {f"{known[k]} {shown.get('nodes', k).status}" for k in shown.store.keys("nodes")}


ENDED = ("handled RUNNING", "say FAILURE", "handler RUNNING")


def test_stopped_run_keeps_how_each_node_ended(shown: Shown) -> None:
    tick(shown, "tree RUNNING", "ask SUCCESS", *ENDED)
    tick(shown, *(f"{name} INVALID" for name in ("ask", "say", "handler", "handled", "tree")))
    stopped = {"tree STOPPED", "handled STOPPED", "handler STOPPED"}
    assert statuses(shown) == {*stopped, "ask SUCCESS", "say FAILURE"}
    record = shown.get("nodes")
    assert (record.starts, record.successes) == (1, 1)
    assert shown.get("nodes", "guide|tree").busy_s == 1.0


def test_node_stopped_by_its_timeout_says_so(shown: Shown) -> None:
    others = ("tree RUNNING", "say RUNNING")
    tick(shown, *others, "ask_timeout RUNNING", "ask RUNNING")
    tick(shown, "ask_timeout FAILURE", "ask INVALID")
    assert statuses(shown) == {*others, "ask_timeout FAILURE", "ask STOPPED"}
    tick(shown, "ask_timeout RUNNING", "ask RUNNING")
    assert shown.get("nodes").status == "RUNNING"
    assert shown.get("nodes").starts == 2


def test_restart_clears_what_stopped_subtree_did(shown: Shown) -> None:
    tick(shown, "tree RUNNING", *ENDED, "ask SUCCESS")
    tick(shown, "say INVALID", "handler INVALID", "handled INVALID")
    assert "handler STOPPED" in statuses(shown)
    tick(shown, "say RUNNING", "handled RUNNING")
    running = {"tree RUNNING", "say RUNNING", "handled RUNNING"}
    assert statuses(shown) == {*running, "ask SUCCESS", "handler INVALID"}


def test_next_round_clears_results_of_previous_round(shown: Shown) -> None:
    tick(shown, "tree RUNNING", "ask SUCCESS", "say RUNNING")
    tick(shown, "ask INVALID")
    assert statuses(shown) == {"tree RUNNING", "ask INVALID", "say RUNNING"}


def test_lost_run_leaves_running_nodes_unknown(shown: Shown) -> None:
    tick(shown, "tree RUNNING", "ask SUCCESS", "say RUNNING")
    shown.take(Run(**RUN, event=Run.ENDED, outcome=Run.LOST))
    assert statuses(shown) == {"tree UNKNOWN", "ask SUCCESS", "say UNKNOWN"}


def test_run_shows_its_scene_despite_early_tick(shown: Shown) -> None:
    shown.take(Run(**RUN, event=Run.ENDED))
    later = {**RUN, "round": 4}
    scene = Scene(scene_id="s4", label="the last guest")
    shown.take(TreeStatus(**later))
    shown.take(scene)
    shown.take(Run(**later, event=Run.STARTED, scene=scene))
    assert shown.get("scene", "").label == "the last guest"


def test_running_agent_is_shown_with_its_awarded_scene(shown: Shown) -> None:
    shown.take(Run(**RUN, event=Run.ENDED))
    shown.take(Scene(scene_id="s2", label="a guest"))
    assert shown.get("scene", "").label == "a guest"
    later = RUN | {"round": 4}
    shown.take(Run(**later, event=Run.STARTED, scene=Scene(scene_id="s2", label="a guest")))
    shown.take(Scene(scene_id="s3", label="somebody in line"))
    assert shown.get("scene", "").label == "a guest"
    shown.take(Run(**later, event=Run.ENDED))
    following = RUN | {"round": 5}
    scene = Scene(scene_id="s3", label="somebody in line")
    shown.take(Run(**following, event=Run.STARTED, scene=scene))
    assert shown.get("scene", "").label == "somebody in line"


def events(shown: Shown) -> list[tuple[str, str, float, float | None]]:
    found = [shown.get("events", key) for key in shown.store.keys("events")]
    return [(one.lane, one.kind, one.began_s, one.ended_s) for one in found]


def test_run_is_one_event_until_its_end(shown: Shown) -> None:
    assert events(shown) == [("AGENT", "RUNNING", 1001.0, None)]
    shown.take(Run(**RUN, event=Run.ENDED, outcome=Run.FAILED, duration_s=1.0, message="no"))
    assert events(shown) == [("AGENT", "FAILED", 1001.0, 1002.0)]
    shown.take(Run(**RUN | {"round": 4}, event=Run.REFUSED))
    assert events(shown)[1:] == [("AGENT", "REFUSED", 1003.0, 1003.0)]


def test_recording_is_one_event_until_its_end(shown: Shown) -> None:
    shown.take(Run(**RUN, event=Run.ENDED, outcome=Run.FAILED))

    def recording(since_s: float, *, on: bool = True, **told: Any) -> None:
        shown.take(RecordingStatus(recording=on, file="a.mcap", **told), since_s)

    def spans() -> list[tuple[str, str, float, float | None]]:
        _, *found = [shown.get("events", key) for key in shown.store.keys("events")]
        return [(one.kind, one.text, one.began_s, one.ended_s) for one in found]

    recording(900.0)
    assert spans() == [("RECORDING", "a.mcap", 900.0, None)]
    recording(950.0, on=False)
    ended = [("RECORDED", "a.mcap", 900.0, 950.0)]
    assert spans() == ended
    recording(960.0, label="a class")
    recording(960.0, label="a class", bookmarks=1)
    assert spans() == [*ended, ("RECORDING", "a class", 960.0, None)]
    # A crashed journal reports no end.
    recording(970.0)
    ended.append(("RECORDED", "a class", 960.0, 970.0))
    assert spans() == [*ended, ("RECORDING", "a.mcap", 970.0, None)]
    shown.projection.graph({}, 980.0, is_journal_there=False)
    ended.append(("RECORDED", "a.mcap", 970.0, 980.0))
    assert spans() == ended


def test_act_of_robot_ends_when_untold(shown: Shown) -> None:
    acts = [
        RobotAct(stamp=to_time(1000.0 + number), number=number, kind=kind, text="Hello")
        for number, kind in ((1, RobotAct.SAY), (2, RobotAct.SHOW))
    ]
    shown.take(RobotState(acts=acts))
    shown.take(RobotState(acts=acts[1:]))
    assert events(shown)[1:] == [("ROBOT", "SAY", 1001.0, 1003.0), ("ROBOT", "SHOW", 1002.0, None)]


def test_round_and_feedback_are_moments(shown: Shown) -> None:
    shown.take(Auction(epoch="e1", round=3, outcome=Auction.AWARDED, winner="guide"))
    shown.take(Auction(epoch="e1", round=4, outcome=Auction.AWARDED, preview=True))
    shown.take(Feedback(agent="guide", kind=Feedback.NEGATIVE, source="button"))
    assert events(shown)[1:] == [
        ("MARKET", "AWARDED", 1002.0, 1002.0),
        ("FEEDBACK", "NEGATIVE", 1004.0, 1004.0),
    ]


def test_text_of_event_is_short_and_printable(shown: Shown) -> None:
    shown.take(Run(**RUN, event=Run.ENDED, message="\x1b[31m\n" + "x" * 10_000))
    [record] = [shown.get("events", key) for key in shown.store.keys("events")]
    assert record.text.isprintable()
    assert len(record.text) <= 200


class Told(Shown):
    """Health that a node reports, and what the studio shows of it."""

    def tell(self, at_s: float, level: int, message: str = "m", **values: str) -> None:
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        status = DiagnosticStatus(name="agents: files", message=message, values=pairs)
        status.level = bytes([level])
        told = DiagnosticArray(status=[status])
        self.projection.handle("diagnostic_msgs/msg/DiagnosticArray", told, at_s)

    @property
    def level(self) -> tuple[str, float]:
        """The level, and since when it holds."""
        record = self.get("health", "agents: files")
        return record.level, record.since_s


@pytest.fixture
def told() -> Told:
    return Told()


def test_health_states_since_when_its_level_holds(told: Told) -> None:
    told.tell(10.0, 0)
    told.tell(11.0, 0)
    assert (told.level, told.store.sequence) == (("OK", 10.0), 1)
    told.tell(12.0, 2, "two files", file="a.yaml")
    assert told.level == ("ERROR", 12.0)
    record = told.get("health", "agents: files")
    assert (record.message, record.values) == ("two files", {"file": "a.yaml"})


def test_each_new_error_of_health_is_an_event(told: Told) -> None:
    for at_s, level in ((10.0, 2), (11.0, 2), (12.0, 0), (13.0, 1), (14.0, 2)):
        told.tell(at_s, level, "two files")
    assert events(told) == [("FAULT", "ERROR", 10.0, 10.0), ("FAULT", "ERROR", 14.0, 14.0)]
    found = [told.get("events", key).text for key in told.store.keys("events")]
    assert found == ["agents: files: two files"] * 2


def test_recorded_health_with_numeric_level_is_shown(told: Told) -> None:
    status = SimpleNamespace(level=1, name="agents: files", message="m", values=[])
    recorded = SimpleNamespace(status=[status])
    told.projection.handle("diagnostic_msgs/msg/DiagnosticArray", recorded, 10.0)
    assert told.level == ("WARN", 10.0)


def test_unreported_health_is_stale_since_last_report(told: Told) -> None:
    told.tell(10.0, 0)
    for now_s in (10.0, 10.0 + UNTOLD_S):
        told.projection.health.check(now_s)
        assert told.level == ("OK", 10.0)
    told.projection.health.check(10.1 + UNTOLD_S)
    assert told.level == ("STALE", 10.0)
    told.tell(20.0, 0)
    assert told.level == ("OK", 20.0)


def test_other_clock_does_not_make_health_stale(told: Told) -> None:
    for now_s in (3600.0, 3601.0, 3602.0):
        told.tell(now_s - 3600.0, 0)
        told.projection.health.check(now_s)
        assert told.level == ("OK", 0.0)
    told.projection.health.check(3602.1 + UNTOLD_S)
    assert told.level == ("STALE", 3602.0)


def test_health_of_unknown_nodes_is_bounded_and_sanitised(told: Told) -> None:
    told.tell(10.0, 77, "\x1b[31mred\n" + "x" * 10_000)
    assert told.level == ("77", 10.0)
    message = told.get("health", "agents: files").message
    assert message.startswith("[31mred xxx")
    assert len(message) <= 500


def test_files_of_one_host_leave_those_of_another(shown: Shown) -> None:
    def send(host: str, **texts: str) -> None:
        shown.take(AgentFiles(host=host, files=[*texts], texts=[*texts.values()]))

    send("/one", a="1", b="2")
    send("/two", a="3")
    send("/one", a="4")
    found = {key: shown.get("files", key).text for key in shown.store.keys("files")}
    assert found == {"/one|a": "4", "/two|a": "3"}


@pytest.mark.parametrize(
    ("when", "changes"),
    [
        ("mood.change >= 0.5", (0.5,)),
        ("abs(mood.change) > 1", (-1.0, 1.0)),
        ("mood.change >= 0.5 and scene.age > 3", ()),
        ("mood.change < 1", ()),
        ("1 / mood.change > 2", ()),
        ("mood.change <=", ()),
        ("mood.change >= 0.5" + " or mood.change >= 0.5" * 10, ()),
    ],
)
def test_mood_rule_says_where_it_begins(
    shown: Shown, when: str, changes: tuple[float, ...]
) -> None:
    rules = [MoodRule(when=when, give=1), MoodRule(when=when, give=1, baseline_s=2.0)]
    shown.take(HostCard(host="/agents", agents=[AgentCard(name="guide", rules=rules)]))
    first, second = shown.get("agents", "guide").rules
    assert first.changes == pytest.approx(changes)
    assert second.changes == ()


def test_preset_has_values_and_their_settings(shown: Shown) -> None:
    written = {"a": "1.5 min", "b": "90 deg", "c": "0.25", "d": "yes sir", "e": "true"}
    preset = Preset(name="evening", names=[*written], values=[*written.values()])
    shown.take(Tunings(host="/one", presets=[preset]))
    [found] = shown.get("tunings", "/one").presets
    assert found.values == written
    assert found.settings == {"a": 90.0, "b": math.pi / 2, "c": 0.25, "d": "yes sir", "e": True}
