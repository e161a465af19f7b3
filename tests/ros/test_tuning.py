# SPDX-License-Identifier: Apache-2.0
"""Tuning over ROS: parameters, the service, undo, presets and restarts of the host."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from bt_agents.host.agent_registry import AgentRegistry, HostedAgent
from bt_agents.host.tuning.tunable import TICK_RATE, parameters_of
from bt_agents.host.tuning.tunable_parameters import TunableParameters
from bt_agents.host.tuning.tune_service import info_from_msg
from bt_agents_interfaces.msg import Tunables, Tunings
from bt_agents_interfaces.srv import Tune
from bt_agents_language.model.specs import AgentSpec
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from tree_harness import SPACE, agent

HEAD = """
learning_rate: 0.2
tunables:
  patience: {default: 8 s, min: 2 s, max: 30 s, description: how long}
  rate: {default: 0.9, min: 0.5, max: 1.5, step: 0.05, description: speed}
  tilt: {default: 0.0, min: -0.3, max: 0.3, step: 0.1, description: of the head}
  attempts: {default: 2, min: 1, max: 5, description: how often}
  loud: {default: true}
  place: {default: station 4}
"""


def spec(name: str = "a", head: str = HEAD) -> AgentSpec:
    return replace(agent("wait: 0 s", head), name=name)


class Host(BaseNode):
    """The tuning of a host, without its other parts."""

    def __init__(
        self,
        *specs: AgentSpec,
        tunings: str = "",
        presets: Path = Path("nowhere"),
        **node_kwargs: Any,
    ) -> None:
        super().__init__("agents", **node_kwargs)
        self.registry = AgentRegistry(SPACE, specs or (spec("a"), spec("b")))
        self.rates: list[float] = []
        self.cards = 0
        self.tunables = TunableParameters(
            self, self.registry, presets, self._card, set_rate=self.rates.append, tunings=tunings
        )

    def _card(self) -> None:
        self.cards += 1

    def destroy_node(self) -> None:
        self.tunables.close()
        super().destroy_node()

    def value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def member(self, name: str = "a") -> HostedAgent:
        return self.registry.members[name]


@pytest.fixture
def host(ros: Any, tmp_path: Path) -> Host:
    return ros.add(Host(presets=tmp_path / "presets"))  # type: ignore[no-any-return]


class Tuner:
    """Calls ``agents/tune``."""

    def __init__(self, ros: Any) -> None:
        self._ros = ros
        self._client = ros.node.create_client(Tune, "agents/tune", qos_profile=qos.SERVICE)
        self._together = ros.node.create_client(
            SetParametersAtomically, "agents/set_parameters_atomically", qos_profile=qos.SERVICE
        )

    def ask(self, action: int, **fields: Any) -> Any:
        return self._ros.call(self._client, Tune.Request(action=action, **fields))

    def send(self, action: int, **fields: Any) -> Any:
        return self._client.call_async(Tune.Request(action=action, **fields))

    def set(self, *, author: str = "anna", reason: str = "", **values: str) -> Any:
        names = [name.replace("__", ".") for name in values]
        return self.ask(
            Tune.Request.SET,
            names=names,
            values=list(values.values()),
            author=author,
            reason=reason,
        )

    def undo(self, *agents: str) -> Any:
        return self.ask(Tune.Request.UNDO, agents=list(agents), author="anna")

    def redo(self, *agents: str) -> Any:
        return self.ask(Tune.Request.REDO, agents=list(agents), author="anna")

    def send_parameters(self, **values: Any) -> Any:
        """Send a set of parameters; return the future of its answer."""
        parameters = [
            Parameter(name.replace("__", "."), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
        self._ros.until(self._together.service_is_ready)
        return self._together.call_async(SetParametersAtomically.Request(parameters=parameters))

    def parameters(self, **values: Any) -> Any:
        return self._ros.result(self.send_parameters(**values)).result


@pytest.fixture
def tuner(ros: Any, host: Host) -> Tuner:
    return Tuner(ros)


def test_every_tunable_is_a_described_parameter(ros: Any, host: Host) -> None:
    listed = ros.ask(ListParameters, "agents/list_parameters", prefixes=["a"]).result.names
    assert sorted(listed) == [
        "a.attempts", "a.learning_rate", "a.loud", "a.patience", "a.place", "a.rate", "a.tilt",
    ]  # fmt: skip
    names = ["a.patience", "tick_rate", "a.rate"]
    described = ros.ask(DescribeParameters, "agents/describe_parameters", names=names).descriptors
    ranges = [d.floating_point_range[0] for d in described]
    assert [(r.from_value, r.to_value) for r in ranges] == [(2, 30), (1, 200), (0.5, 1.5)]
    assert described[0].description == "how long [s]"
    assert [d.additional_constraints for d in described] == [
        "default: 8 s", "default: 20", "default: 0.9",
    ]  # fmt: skip
    assert ranges[2].step == 0.05


def test_latched_tunables_follow_changed_file(ros: Any, host: Host) -> None:
    seen = ros.collect(Tunables, "agents/tunables", qos.FACT)
    ros.until(lambda: seen)
    assert seen[-1].host == "/agents"
    known = {
        parameter.name: parameter
        for agent in ("a", "b")
        for parameter in parameters_of(spec(agent))
    }
    assert [one.name for one in seen[-1].tunables] == ["tick_rate", *known]
    for one in seen[-1].tunables[1:]:
        assert info_from_msg(one) == known[one.name]
    assert info_from_msg(seen[-1].tunables[0]) == TICK_RATE
    [patience] = [one for one in seen[-1].tunables if one.name == "a.patience"]
    assert (patience.unit, patience.default_value.double_value) == ("s", 8.0)
    retuned(host, HEAD.replace("default: 8 s", "default: 10 s"))
    ros.until(lambda: len(seen) == 2)
    [patience] = [one for one in seen[-1].tunables if one.name == "a.patience"]
    assert patience.default_value.double_value == 10.0
    host.tunables.remove("a")
    host.registry.remove("a")
    ros.until(lambda: len(seen) == 3)
    assert {one.agent for one in seen[-1].tunables} == {"", "b"}


def test_tuning_says_whether_undo_is_possible(ros: Any, host: Host, tuner: Tuner) -> None:
    seen = ros.collect(Tunings, "agents/tunings", qos.FACT)
    tuner.set(a__patience="12")
    tuner.set(b__attempts="4")
    tuner.undo("a")
    ros.until(lambda: seen and seen[-1].revision == 3)
    assert [(t.revision, t.undoable) for t in seen[-1].tunings] == [
        (1, False), (2, True), (3, False),
    ]  # fmt: skip
    tuner.redo()
    ros.until(lambda: seen[-1].revision == 4)
    assert [t.undoable for t in seen[-1].tunings] == [True, True, False, False]


def test_parameter_change_affects_agent_and_creates_revision(
    ros: Any, host: Host, tuner: Tuner
) -> None:
    seen = ros.collect(Tunings, "agents/tunings", qos.FACT)
    mapping = host.member().tunables
    assert tuner.parameters(a__patience=12.0, a__loud=False, tick_rate=30.0).successful
    assert host.member().tunables is mapping
    assert (mapping["patience"], mapping["loud"]) == (12.0, False)
    assert host.rates == [20.0, 30.0]
    ros.until(lambda: seen and seen[-1].revision == 1)
    assert [(t.name, t.before, t.after, t.author) for t in seen[-1].tunings] == [
        ("a.patience", "8 s", "12 s", "ros parameter"),
        ("a.loud", "true", "false", "ros parameter"),
        ("tick_rate", "20", "30", "ros parameter"),
    ]
    assert seen[-1].undo == (
        "a.patience: 12 s → 8 s, a.loud: false → true, tick_rate: 30 → 20 (revision 1)"
    )


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"a__patience": 31.0}, "out of range"),
        ({"a__rate": 0.93}, "step"),
        ({"a__tilt": 0.05}, "OFF_STEP: a.tilt is 0.05"),
        ({"a__attempts": 2.0}, "type"),
        ({"a__attempts": 9}, "out of range"),
        ({"a__loud": "yes"}, "type"),
        ({"a__place": "x" * 2000}, "NOT_A_VALUE: a.place has 2000 characters"),
    ],
)
def test_one_bad_value_rejects_whole_set_with_reason(
    host: Host, tuner: Tuner, bad: dict[str, Any], words: str
) -> None:
    before = {name: p.value for name, p in host._parameters.items()}
    result = tuner.parameters(b__patience=12.0, **bad)
    assert not result.successful
    assert words in result.reason
    assert {name: p.value for name, p in host._parameters.items()} == before
    assert host.member("b").tunables["patience"] == 8.0
    assert tuner.undo().code == "NOTHING_TO_UNDO"


def test_tunables_are_set_without_other_parameters(host: Host, tuner: Tuner) -> None:
    result = tuner.parameters(a__patience=12.0, use_sim_time=False)
    assert result.reason.startswith("NOT_TOGETHER: a.patience is tuned with one that is not")
    assert host.member().tunables["patience"] == host.value("a.patience") == 8.0


def test_what_the_service_sets_is_a_parameter_event(ros: Any, host: Host, tuner: Tuner) -> None:
    seen = ros.collect(ParameterEvent, "/parameter_events", qos.EVENTS)
    ros.until(lambda: host.count_subscribers("/parameter_events"))
    tuner.set(a__patience="12")
    ros.until(lambda: seen)
    [changed] = seen[-1].changed_parameters
    assert (seen[-1].node, changed.name) == ("/agents", "a.patience")
    assert changed.value.double_value == host.value("a.patience") == 12.0


def test_zero_can_be_set_when_steps_include_it(host: Host, tuner: Tuner) -> None:
    assert tuner.parameters(a__tilt=0.1).successful
    assert tuner.parameters(a__tilt=0.0).successful


def test_tuning_service_accepts_authored_notation_author_and_reason(
    host: Host, tuner: Tuner
) -> None:
    answer = tuner.set(a__patience="12", b__patience="0.5 min", reason="Mrs Smith is slow")
    assert answer.accepted
    assert answer.message == "a.patience: 8 s → 12 s, b.patience: 8 s → 30 s (revision 1)"
    assert [(t.author, t.reason, t.revision) for t in answer.tunings] == [
        ("anna", "Mrs Smith is slow", 1)
    ] * 2
    assert (host.value("a.patience"), host.value("b.patience")) == (12.0, 30.0)
    assert tuner.set(a__patience="12 s").message == "everything stands so already"


LOUD = {"names": ["a.loud"], "values": ["true"]}


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"action": 99}, "UNKNOWN_ACTION"),
        ({"action": 0, "names": ["a.patience"], "values": []}, "WRONG_LENGTH"),
        ({"action": 0, "names": ["use_sim_time"], "values": ["true"]}, "UNKNOWN_PARAMETER"),
        ({"action": 0, "names": ["a.patience"], "values": ["nan"]}, "NOT_A_VALUE"),
        ({"action": 0, **LOUD, "compare": True, "seen": 7}, "CHANGED_MEANWHILE"),
        ({"action": 0, "author": "x" * 61}, "BAD_TEXT"),
        ({"action": 0, "reason": "two\nlines"}, "BAD_TEXT"),
        ({"action": 2}, "NOTHING_TO_REDO"),
        ({"action": 3, "preset": "x"}, "UNKNOWN_PRESET"),
        ({"action": 4, "preset": ""}, "BAD_NAME"),
        ({"action": 5, "preset": "x"}, "UNKNOWN_PRESET"),
    ],
)
def test_invalid_request_is_refused_by_name(
    host: Host, tuner: Tuner, fields: dict[str, Any], code: str
) -> None:
    answer = tuner.ask(**fields)
    assert not answer.accepted
    assert answer.code == code
    assert answer.message


def test_preset_is_saved_applied_and_deleted(ros: Any, host: Host, tuner: Tuner) -> None:
    seen = ros.collect(Tunings, "agents/tunings", qos.FACT)
    tuner.set(a__patience="12", a__loud="false")
    saved = tuner.ask(Tune.Request.SAVE, preset="care home", agents=["a"])
    assert saved.message == "preset 'care home' keeps 7 values"
    ros.until(lambda: seen and seen[-1].presets)
    [preset] = seen[-1].presets
    assert dict(zip(preset.names, preset.values, strict=True))["a.patience"] == "12 s"
    assert host.cards == 0
    tuner.undo()
    applied = tuner.ask(Tune.Request.APPLY, preset="care home", author="anna")
    assert applied.message.endswith("a.patience: 8 s → 12 s, a.loud: true → false (revision 3)")
    assert [t.reason for t in applied.tunings] == ["preset 'care home'"] * 2
    assert tuner.ask(Tune.Request.FORGET, preset="care home").accepted
    ros.until(lambda: not seen[-1].presets)


def test_presets_that_authors_write_are_listed(
    ros: Any, host: Host, tuner: Tuner, tmp_path: Path
) -> None:
    seen = ros.collect(Tunings, "agents/tunings", qos.FACT)
    (tmp_path / "presets").mkdir()
    file = tmp_path / "presets" / "morning.yaml"
    file.write_text("format: 1\npreset: morning\nvalues:\n  a: {patience: 12 s}\n")
    ros.until(lambda: seen and [one.name for one in seen[-1].presets] == ["morning"])
    assert tuner.ask(Tune.Request.APPLY, preset="morning").accepted
    assert host.value("a.patience") == 12.0
    file.write_text("format: 1\n")
    ros.until(lambda: not seen[-1].presets and host.cards == 1)
    [problem] = host.tunables.preset_problems
    assert problem.startswith(f"{file}:1:1")


class SlowDisk:
    """Takes its time for each sync, which happens outside the executor's thread."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.free = threading.Event()
        self.threads: list[str] = []
        self.error: OSError | None = None
        monkeypatch.setattr(os, "fdatasync", self._sync)
        monkeypatch.setattr(os, "fsync", self._sync)

    def _sync(self, _file: int) -> None:
        self.threads.append(threading.current_thread().name)
        self.free.wait(20.0)
        if self.error is not None:
            raise self.error


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[SlowDisk]:
    disk = SlowDisk(monkeypatch)
    yield disk
    disk.free.set()


def test_only_tuning_answers_wait_for_disk(
    ros: Any, disk: SlowDisk, restarted: Callable[..., Host]
) -> None:
    host, tuner = restarted(), Tuner(ros)
    for number in range(30):
        assert tuner.parameters(a__patience=3.0 + number % 2).successful
    ros.until(lambda: disk.threads)
    asked = tuner.send(Tune.Request.SET, names=["a.attempts"], values=["4"])
    saved = tuner.send(Tune.Request.SAVE, preset="slow")
    ros.until(lambda: host.value("a.attempts") == 4)
    assert tuner.parameters(a__patience=12.0).successful
    assert not asked.done()
    assert not saved.done()
    disk.free.set()
    ros.until(lambda: asked.done() and saved.done())
    assert asked.result().accepted
    assert saved.result().accepted
    assert set(disk.threads) == {"tunings"}


def test_values_adopted_by_agent_file_need_no_sync(
    ros: Any, disk: SlowDisk, restarted: Callable[..., Host]
) -> None:
    disk.free.set()
    host, tuner = restarted(), Tuner(ros)
    tuner.set(a__patience="12", a__attempts="4", a__rate="1")
    ros.turns()
    before = len(disk.threads)
    kept = HEAD.replace("default: 8 s", "default: 12 s").replace("default: 2,", "default: 4,")
    host.tunables.replace(host.member(), spec(head=kept.replace("default: 0.9", "default: 1.0")))
    ros.until(lambda: host.get_parameter("a.rate").value == 1.0)
    ros.turns()
    assert len(disk.threads) == before


def test_failed_sync_is_reported_in_answer(
    ros: Any, disk: SlowDisk, restarted: Callable[..., Host]
) -> None:
    disk.free.set()
    disk.error = OSError(5, "Input/output error")
    host, tuner = restarted(), Tuner(ros)
    answer = tuner.set(a__patience="12")
    assert answer.accepted
    assert "a power cut may undo it: [Errno 5] Input/output error" in answer.message
    assert host.value("a.patience") == 12.0
    assert tuner.ask(Tune.Request.SAVE, preset="slow").code == "CANNOT_WRITE"


def test_unexpected_tuning_error_is_answered(
    host: Host, tuner: Tuner, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise RuntimeError("something else")

    monkeypatch.setattr(host.tunables._store, "read", fail)
    answer = tuner.set(a__patience="12")
    assert (answer.accepted, answer.code) == (False, "FAILED")
    assert answer.message == "RuntimeError: something else; the log says more"


@pytest.fixture
def file(tmp_path: Path) -> str:
    return str(tmp_path / "state" / "tunings.json")


@pytest.fixture
def restarted(ros: Any, file: str, tmp_path: Path) -> Callable[..., Host]:
    """Start a host on the same file, in place of the previous one."""
    hosts: list[Host] = []

    def restart(*specs: AgentSpec, **node_kwargs: Any) -> Host:
        if hosts:
            ros.remove(hosts.pop())
        presets = tmp_path / "presets"
        hosts.append(ros.add(Host(*specs, tunings=file, presets=presets, **node_kwargs)))
        return hosts[0]

    return restart


def test_new_default_overrides_stored_tuning_at_start(
    ros: Any, restarted: Callable[..., Host]
) -> None:
    restarted()
    tuner = Tuner(ros)
    tuner.set(a__patience="12")
    seen = ros.collect(Tunings, "agents/tunings", qos.FACT)
    host = restarted(spec(head=HEAD.replace("default: 8 s", "default: 10 s")))
    assert host.value("a.patience") == 10.0
    ros.until(lambda: seen and seen[-1].revision == 2)
    assert (seen[-1].tunings[-1].author, seen[-1].tunings[-1].reason) == (
        "file",
        "a.patience: the file says 10 s now",
    )
    assert tuner.undo().accepted
    assert host.value("a.patience") == 12.0


def test_restart_keeps_tunings_but_no_launch_file_values(
    ros: Any, restarted: Callable[..., Host]
) -> None:
    restarted()
    Tuner(ros).set(a__patience="12", tick_rate="30")
    launched = restarted(parameter_overrides=[Parameter("a.patience", value=20.0)])
    assert launched.member().tunables["patience"] == 20.0
    host = restarted()
    assert host.member().tunables["patience"] == host.value("a.patience") == 12.0
    assert host.rates == [30.0]


@pytest.mark.parametrize("value", [99.0, "soon", math.nan])
def test_invalid_launch_file_value_is_ignored(ros: Any, value: Any) -> None:
    host = ros.add(Host(parameter_overrides=[Parameter("a.patience", value=value)]))
    assert host.value("a.patience") == 8.0
    assert host.tunables.left_out["a.patience"].startswith(
        "a.patience as it was given at the start is left out, it is 8 s: "
    )


def test_parameter_file_integer_is_accepted_as_double(ros: Any) -> None:
    host = ros.add(Host(parameter_overrides=[Parameter("a.patience", value=12)]))
    assert host.value("a.patience") == 12.0
    assert host.member().tunables["patience"] == 12.0
    assert host.tunables.left_out == {}


def test_second_host_on_same_file_works_in_memory(ros: Any, file: str) -> None:
    ros.add(Host(tunings=file))
    second = Host(tunings=file, namespace="/other")
    ros.add(second)
    second.set_parameters([Parameter("a.patience", value=12.0)])
    assert second.value("a.patience") == 12.0


def retuned(host: Host, head: str) -> None:
    host.tunables.replace(host.member(), spec(head=head))


def test_changed_default_in_file_wins_and_is_undoable(host: Host, tuner: Tuner) -> None:
    tuner.set(a__patience="12", a__attempts="4")
    mapping = host.member().tunables
    retuned(host, HEAD.replace("default: 8 s", "default: 10 s").replace("0.2", "0.4"))
    assert host.member().tunables is mapping
    assert (mapping["patience"], mapping["attempts"]) == (10.0, 4)
    assert host.member().learning_rate == host.value("a.learning_rate") == 0.4
    assert tuner.undo().message.startswith("undo of revision 2: a.patience: 10 s → 12 s")


def test_narrower_range_keeps_value_that_still_fits(host: Host, tuner: Tuner) -> None:
    tuner.set(a__patience="12")
    retuned(host, HEAD.replace("max: 30 s", "max: 12 s"))
    assert host.value("a.patience") == 12.0
    retuned(host, HEAD.replace("max: 30 s", "max: 10 s"))
    assert host.value("a.patience") == host.member().tunables["patience"] == 8.0
    assert not tuner.parameters(a__patience=11.0).successful


def test_tunables_can_appear_disappear_and_change_type(host: Host, tuner: Tuner) -> None:
    tuner.set(a__patience="12", a__loud="false")
    fresh = "fresh: {default: 1 s, min: 0 s, max: 2 s}"
    retuned(host, f"tunables:\n  patience: {{default: soon}}\n  {fresh}")
    assert host.member().tunables == {"patience": "soon", "fresh": 1.0}
    assert not host.has_parameter("a.loud")
    assert tuner.parameters(a__fresh=2.0).successful
    retuned(host, HEAD)
    assert host.member().tunables["patience"] == 8.0
    assert host.member().tunables["loud"] is False


def test_swap_leaves_old_mapping_to_running_tree(host: Host, tuner: Tuner) -> None:
    tuner.set(a__patience="12")
    running = host.member().tunables
    host.member().tunables = dict(running)
    retuned(host, HEAD.replace("default: 2,", "default: 3,"))
    assert running["attempts"] == 2
    assert host.member().tunables["attempts"] == 3
    assert host.member().tunables["patience"] == 12.0


def test_tick_sees_atomic_set_completely_or_not(ros: Any, host: Host, tuner: Tuner) -> None:
    seen: set[tuple[Any, Any]] = set()
    tunables = host.member().tunables
    timer = host.create_timer(
        0.001, lambda: seen.add((tunables["patience"], tunables["attempts"]))
    )
    pairs = [(2.0 + number % 4, 1 + number % 4) for number in range(400)]
    futures = [
        tuner.send_parameters(a__patience=patience, a__attempts=attempts)
        for patience, attempts in pairs
    ]
    ros.until(lambda: all(future.done() for future in futures))
    assert timer is not None
    assert len(seen) > 2
    assert seen <= {*pairs, (8.0, 2)}


def test_ten_thousand_updates_arrive_with_bounded_history(
    ros: Any, host: Host, tuner: Tuner
) -> None:
    seen = ros.collect(Tunings, "agents/tunings", qos.FACT)
    for start in range(0, 10_000, 500):
        futures = [
            tuner.send_parameters(a__patience=2.0 + number % 28)
            for number in range(start, start + 500)
        ]
        ros.until(lambda futures=futures: all(future.done() for future in futures))
    last = 2.0 + 9_999 % 28
    assert host.member().tunables["patience"] == host.value("a.patience") == last
    ros.until(lambda: seen and seen[-1].revision == 10_000)
    assert len(seen[-1].tunings) == 100
    assert tuner.undo().accepted
    assert host.value("a.patience") == last - 1.0
