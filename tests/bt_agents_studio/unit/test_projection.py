# SPDX-License-Identifier: Apache-2.0
"""Messages of a system as entries of the studio: scenes, pauses, countdowns, values of nodes."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bt_agents_interfaces.msg import (
    Breakpoint,
    ChangedValue,
    Countdown,
    NodeDetails,
    NodeValue,
    Run,
    RunControl,
    Scene,
    StatusChange,
    TreeStatus,
)
from bt_agents_ros.messages import header_at, to_time
from bt_agents_studio.projection import UNTOLD_S, Projection
from bt_agents_studio.store import Store

RUN = {"agent": "guide", "epoch": "e1", "round": 3}
KEY = "guide|tree/0.ask"


class Shown:
    """A store that is filled by messages, each a second after the last."""

    def __init__(self) -> None:
        self.store = Store()
        self._projection = Projection(self.store)
        self._now = 1000.0

    def take(self, message: Any) -> None:
        self._now += 1.0
        if hasattr(message, "header"):
            message.header = header_at(to_time(self._now))
        kind = f"bt_agents_interfaces/msg/{type(message).__name__}"
        self._projection.handle(kind, message, self._now)

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


def test_the_log_names_scenes_in_words(shown: Shown) -> None:
    shown.take(Scene(scene_id="scene-7", label="a child", person=True))
    shown.take(Run(**RUN, event=Run.ENDED, message="scene 'scene-7' was cancelled"))
    assert shown.log[-2:] == ["a child", "ended: scene 'a child' was cancelled"]


def time_left(seconds: float, path: str = "tree/0.ask") -> Countdown:
    return Countdown(path=path, kind="retry", unit=Countdown.TIME, remaining_s=seconds)


def rounds_left(count: int, path: str = "tree/0.ask") -> Countdown:
    return Countdown(
        path=path, kind="retry", unit=Countdown.ATTEMPTS, remaining_s=math.nan, remaining=count
    )


def test_time_and_rounds_of_a_node_are_one_entry(shown: Shown) -> None:
    shown.details(time_left(2.5), rounds_left(1))
    record = shown.get("countdowns")
    assert (record.kind, record.remaining_s, record.remaining) == ("retry", 2.5, 1)
    shown.details(rounds_left(0))
    record = shown.get("countdowns")
    assert (record.remaining_s, record.remaining) == (None, 0)


def test_a_countdown_that_is_over_is_removed_and_all_are_with_the_end_of_the_run(
    shown: Shown,
) -> None:
    shown.details(time_left(2.5), time_left(9.0, "tree"))
    shown.details(time_left(8.0, "tree"))
    assert shown.store.keys("countdowns") == ("guide|tree",)
    shown.take(Run(**RUN, event=Run.ENDED))
    shown.details(time_left(7.0, "tree"))
    assert shown.store.keys("countdowns") == ()


def value(name: str, text: str, *, written: bool = False) -> NodeValue:
    return NodeValue(path="tree/0.ask", name=name, value=text, written=written)


def test_the_last_value_of_each_name_is_kept_the_newest_last(shown: Shown) -> None:
    shown.details(values=(value("patience", "8"), value("answer", "'no'", written=True)))
    shown.details(values=(value("patience", "9"),))
    found = [(one.name, one.value, one.written) for one in shown.get("values").values]
    assert found == [("answer", "'no'", True), ("patience", "9", False)]


def test_of_very_many_names_the_newest_are_kept(shown: Shown) -> None:
    shown.details(values=tuple(value(f"name_{number}", "1") for number in range(100)))
    names = [one.name for one in shown.get("values").values]
    assert names == [f"name_{number}" for number in range(60, 100)]


def test_a_new_run_forgets_the_values_of_the_one_before(shown: Shown) -> None:
    shown.details(values=(value("patience", "8"),))
    shown.take(Run(**RUN | {"round": 4}, event=Run.STARTED))
    assert shown.get("values") is None


def test_details_of_an_earlier_run_change_nothing(shown: Shown) -> None:
    shown.take(Run(**RUN | {"round": 4}, event=Run.STARTED))
    late = NodeDetails(**RUN, values=[value("patience", "8")], header=header_at(to_time(1000.5)))
    shown._projection.handle("bt_agents_interfaces/msg/NodeDetails", late, 1003.0)
    assert shown.get("values") is None
    assert shown.get("runs", "guide").round == 4


def control(**fields: Any) -> RunControl:
    return RunControl(**RUN | {"host": "/agents"} | fields)


def test_breakpoints_are_by_agent(shown: Shown) -> None:
    stops = [Breakpoint(agent="guide", path=path) for path in ("tree", "tree/0.ask")]
    shown.take(control(breakpoints=[*stops, Breakpoint(agent="other", path="tree")]))
    assert shown.get("controls", "/agents").breakpoints == {
        "guide": ("tree", "tree/0.ask"),
        "other": ("tree",),
    }
    shown.take(control())
    assert shown.get("controls", "/agents").breakpoints == {}


def test_what_happened_tells_of_each_pause_once(shown: Shown) -> None:
    before = len(shown.log)
    shown.take(control())
    shown.take(control(paused=True, author="anna"))
    shown.take(control(paused=True, author="anna"))
    shown.take(control(paused=True, paused_at="tree/0.ask"))
    shown.take(control())
    shown.take(control())
    assert shown.log[before:] == ["is paused by anna", "is paused before tree/0.ask", "goes on"]


def test_a_pause_that_ends_with_its_run_does_not_go_on(shown: Shown) -> None:
    shown.take(control(paused=True))
    before = len(shown.log)
    shown.take(RunControl(host="/agents"))
    assert shown.log[before:] == []


def test_changed_values_are_those_that_a_node_has_written(shown: Shown) -> None:
    changed = [ChangedValue(name="answer", value="'yes'")]
    change = StatusChange(
        path="tree/0.ask", name="ask", status=StatusChange.SUCCESS, values=changed
    )
    shown.take(TreeStatus(**RUN, tick=8, changes=[change]))
    [record] = shown.get("values").values
    assert (record.name, record.value, record.written, record.tick) == ("answer", "'yes'", True, 8)
    assert shown.log[-1] == "ask: success, answer = 'yes'"
    shown.details(values=(value("answer", "'yes'", written=True),))
    assert len(shown.get("values").values) == 1


def test_a_running_node_with_another_message_has_not_started_again(shown: Shown) -> None:
    for message in ("", "attempt 2 of 3"):
        change = StatusChange(path="tree/0.ask", status=StatusChange.RUNNING, message=message)
        shown.take(TreeStatus(**RUN, changes=[change]))
    assert shown.get("nodes").starts == 1


def test_a_run_whose_first_tick_is_received_before_all_else_shows_its_scene(shown: Shown) -> None:
    shown.take(Run(**RUN, event=Run.ENDED))
    later = {**RUN, "round": 4}
    scene = Scene(scene_id="s4", label="the last guest")
    shown.take(TreeStatus(**later))
    shown.take(scene)
    shown.take(Run(**later, event=Run.STARTED, scene=scene))
    assert shown.get("scene", "").label == "the last guest"


def test_the_scene_beside_a_run_is_the_one_that_it_was_awarded_for(shown: Shown) -> None:
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


class Told:
    """Health that a node tells, and what the studio shows of it."""

    def __init__(self) -> None:
        self.store = Store()
        self.projection = Projection(self.store)

    def take(self, at_s: float, level: int, message: str = "m", **values: str) -> None:
        status = DiagnosticStatus(
            level=bytes([level]),
            name="agents: files",
            message=message,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        told = DiagnosticArray(status=[status])
        self.projection.handle("diagnostic_msgs/msg/DiagnosticArray", told, at_s)

    @property
    def shown(self) -> Any:
        return self.store.get("health", "agents: files")


def test_health_says_since_when_its_level_holds() -> None:
    told = Told()
    told.take(10.0, 0)
    told.take(11.0, 0)
    assert (told.shown.level, told.shown.since_s) == ("OK", 10.0)
    assert told.store.sequence == 1
    told.take(12.0, 2, "two files", file="a.yaml")
    assert (told.shown.level, told.shown.message, told.shown.since_s) == (
        "ERROR",
        "two files",
        12.0,
    )
    assert told.shown.values == {"file": "a.yaml"}


def test_recorded_health_whose_level_is_read_as_a_number_is_shown() -> None:
    told = Told()
    status = SimpleNamespace(level=1, name="agents: files", message="m", values=[])
    told.projection.handle(
        "diagnostic_msgs/msg/DiagnosticArray", SimpleNamespace(status=[status]), 10.0
    )
    assert told.shown.level == "WARN"


def test_health_of_which_nothing_is_told_any_more_is_stale_since_it_was_told_last() -> None:
    told = Told()
    told.take(10.0, 0)
    told.projection.check_health(10.0 + UNTOLD_S)
    assert told.shown.level == "OK"
    told.projection.check_health(10.1 + UNTOLD_S)
    assert (told.shown.level, told.shown.since_s) == ("STALE", 10.0)
    told.take(20.0, 0)
    assert (told.shown.level, told.shown.since_s) == ("OK", 20.0)


def test_health_of_unknown_nodes_is_bounded_and_shown_as_text() -> None:
    told = Told()
    told.take(10.0, 77, "\x1b[31mred\n" + "x" * 10_000)
    assert told.shown.level == "77"
    assert told.shown.message.startswith("[31mred xxx")
    assert len(told.shown.message) <= 500
