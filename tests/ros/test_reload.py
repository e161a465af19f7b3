# SPDX-License-Identifier: Apache-2.0
"""A host with changing agent files: when changes take effect, and who is told."""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from bt_agents.host import market_registration
from bt_agents.host.node import HostNode
from bt_agents.host.reload.folder_watch import FolderWatch
from bt_agents_core.scene import Origin, Scene, SceneValue
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import AgentFiles, Heartbeat, HostCard, Trees, TreeStatus
from bt_agents_interfaces.srv import ReloadAgents, SetProfile
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from fake_market import Market, never_held_up
from marketplace_node.settings import Settings
from reload_harness import SKILLS, agent, new_folder, write

PATIENT = "tunables:\n  patience: {{default: {}, min: 1 s, max: 60 s, description: d}}\n"
WAITING = "{wait: '${patience}'}"
CLEANS_UP = "on_cancel: {log: cleaned up}\n"


@pytest.fixture(autouse=True)
def often_polled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let hosts poll their folders so often that no test waits for it."""
    monkeypatch.setattr("bt_agents.host.reload.reload_service.PERIOD_S", 0.05)


def patient(name: str, patience: str = "50 s") -> str:
    """Return the file of an agent that waits."""
    return agent(name, WAITING, PATIENT.format(patience))


class AgeMarket(Market):
    """A market whose scenes have only an age."""

    @property
    def registered(self) -> list[list[str]]:
        """The agents of each registration so far."""
        return [list(request.agents) for request in self.requests]

    def start(self, host: HostNode, name: str) -> Any:
        """Run an agent; return the handle of its goal."""
        value = SceneValue(name="age", value=3.0, origin=Origin.GIVEN)
        awarded = Scene(scene_id="s", label="", person=True, values=(value,))
        handle = self.send(self.goal(host, name, scene=scene_to_msg(awarded)))
        assert handle.accepted
        return handle

    def end(self, handle: Any) -> Any:
        """Cancel a run; return its result."""
        handle.cancel_goal_async()
        return self.result(handle).result


class Host:
    """A host with some agents that no stall holds up, and its messages."""

    def __init__(self, ros: Any, path: Path, **agents: str) -> None:
        self.ros = ros
        self.folder = new_folder(path / "trees")
        for name, text in agents.items():
            write(self.folder, name, text)
        self.market = AgeMarket(ros)
        self.cards = ros.collect(HostCard, "bt_agents/cards", qos.FACTS)
        self.trees = ros.collect(Trees, "agents/trees", qos.FACTS)
        self.node = never_held_up(self.market.host(self.folder))
        ros.until(lambda: self.cards and len(self.cards[-1].agents) == len(agents))

    def edit(self, name: str, text: str) -> None:
        write(self.folder, name, text)

    def card(self, name: str) -> Any:
        return next((one for one in self.cards[-1].agents if one.name == name), None)

    def await_version(self, name: str, version: int) -> None:
        self.ros.until(lambda: self.card(name) and self.card(name).version == version)

    def ask(self, kind: Any, service: str, **fields: Any) -> Any:
        return self.ros.ask(kind, f"agents/{service}", **fields)

    def said(self, name: str) -> str:
        """Return the text that an agent's tree says."""
        return str(self.node.registry.members[name].spec.tree.fields["text"].value)

    def says_on(self) -> set[str]:
        """Return the topics for texts that its node publishes."""
        names = {publisher.topic_name for publisher in self.node.publishers}
        return {name for name in names if name.startswith("/say")}


def test_file_texts_are_republished_only_when_changed(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, ann=agent("ann"))
    texts = ros.collect(AgentFiles, "agents/files", qos.FACTS)
    host.ask(ReloadAgents, "reload")
    rules = "format: 1\nrules: [{when: scene.age > 2, agents: [ann]}]\n"
    (host.folder / "market.yaml").write_text(rules)
    ros.until(lambda: texts and "market.yaml" in texts[-1].files)
    assert len(texts) == 2
    assert rules in texts[-1].texts


def test_failed_reload_is_rolled_back_and_reported(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    host = Host(ros, tmp_path, ann=patient("ann", "8 s"))

    def broken(*_arguments: Any) -> None:
        raise RuntimeError("cogwheel")

    with monkeypatch.context() as patch:
        patch.setattr(host.node._tunables, "add", broken)
        host.edit("bob", patient("bob", "8 s"))
        answer = host.ask(ReloadAgents, "reload")
        assert not answer.accepted
        assert answer.message == "bob: version 1 could not be added: RuntimeError: cogwheel"
        assert list(host.node.registry.members) == ["ann"]

    replace, count = host.node._tunables.replace, 0

    def broken_once(*arguments: Any) -> None:
        nonlocal count
        count += 1
        if count == 1:
            raise RuntimeError("cogwheel")
        replace(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(host.node._tunables, "replace", broken_once)
        host.edit("ann", agent("ann", "{say: bye}"))
        answer = host.ask(ReloadAgents, "reload")
    assert not answer.accepted
    assert "ann: version 2 could not be brought into force, version 1 stays" in answer.message
    assert host.node.has_parameter("ann.patience")
    assert host.node.registry.members["ann"].spec.tree.kind == "wait"
    assert list(host.node.registry.members) == ["ann", "bob"]

    host.edit("ann", agent("ann", "{say: good-bye}"))
    answer = host.ask(ReloadAgents, "reload")
    assert answer.accepted
    assert host.said("ann") == "good-bye"


def test_changed_file_reloads_only_its_own_agent(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # After a stall of the machine it would register once more.
    monkeypatch.setattr(market_registration, "STALL_S", 300.0)
    host = Host(ros, tmp_path, ann=agent("ann"), bob=agent("bob"))
    ann = host.node.registry.members["ann"]
    spec, tunables, cards, trees = ann.spec, ann.tunables, len(host.cards), len(host.trees)
    host.edit("bob", agent("bob", "{say: bye}"))
    host.await_version("bob", 2)
    assert host.said("bob") == "bye"
    assert host.node.registry.members["ann"] is ann
    assert (ann.spec, ann.tunables) == (spec, tunables)
    assert ann.spec is spec
    assert host.card("ann").version == 1
    ros.turns(60)
    assert host.market.registered == [["ann", "bob"]]
    assert len(host.cards) == cards + 1
    assert len(host.trees) == trees + 1


def test_forced_reload_cancels_run_with_clean_up(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, bob=patient("bob") + CLEANS_UP)
    statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
    handle = host.market.start(host.node, "bob")
    host.edit("bob", agent("bob", "{say: bye}"))
    answer = host.ask(ReloadAgents, "reload", now=False)
    assert answer.accepted
    assert "bob: version 2 waits for the end of its run" in answer.message
    ros.until(lambda: host.card("bob").waiting)
    assert host.card("bob").version == 1
    answer = host.ask(ReloadAgents, "reload", now=False)
    assert answer.message == (
        "version 2 of bob waits for the end of the run; 'bt-agents reload --now' cancels it"
    )
    answer = host.ask(ReloadAgents, "reload", now=True)
    assert answer.message == "version 2 of bob waits: the run of bob is cancelled for it"
    result = host.market.result(handle).result
    assert result.outcome == RunAgent.Result.CANCELLED
    assert result.message == "version 2 of bob waits, and somebody wants it now"
    assert any(c.message == "cleaned up" for status in statuses for c in status.changes)
    host.await_version("bob", 2)


def test_agents_change_while_another_agent_runs(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, ann=patient("ann"), bob=patient("bob"))
    handle = host.market.start(host.node, "bob")
    host.edit("mia", patient("mia", "9 s"))
    host.await_version("mia", 1)
    assert host.market.registered[-1] == ["ann", "bob", "mia"]
    assert host.node.get_parameter("mia.patience").value == 9.0
    (host.folder / "agents" / "mia.yaml").unlink()
    ros.until(lambda: host.card("mia") is None)
    ros.until(lambda: host.market.registered[-1] == ["ann", "bob"])
    assert not host.node.has_parameter("mia.patience")
    host.edit("ann", agent("anna"))
    host.await_version("anna", 1)
    ros.until(lambda: host.market.registered[-1] == ["bob", "anna"])
    ros.until(lambda: [tree.agent for tree in host.trees[-1].trees] == ["bob", "anna"])
    assert host.node.registry.members["bob"].tunables == {"patience": 50.0}
    result = host.market.end(handle)
    assert result.outcome == RunAgent.Result.CANCELLED


def test_agent_deleted_while_running_leaves_after_its_run(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, ann=agent("ann"), bob=patient("bob"))
    handle = host.market.start(host.node, "bob")
    (host.folder / "agents" / "bob.yaml").unlink()
    ros.until(lambda: host.card("bob").degraded)
    assert "is gone" in host.card("bob").removal_reason
    assert "is gone" in host.node.registry.members["bob"].removal_reason
    host.market.end(handle)
    ros.until(lambda: host.card("bob") is None)
    ros.until(lambda: host.market.registered[-1] == ["ann"])


def test_broken_file_is_reported_and_last_version_runs(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, bob=agent("bob", "{wait: 0 s}"))
    host.edit("bob", agent("bob", "{wiat: 0 s}"))
    ros.until(lambda: host.card("bob").degraded)
    card = host.card("bob")
    assert card.version == 1
    [problem] = card.problems
    assert (Path(problem.file).name, problem.line, problem.agent) == ("bob.yaml", 4, "bob")
    assert "bob.yaml:4:8: error[unknown-node]" in problem.message
    assert list(host.cards[-1].problems) == [problem]
    assert [Path(file).name for file in host.cards[-1].broken_files] == ["bob.yaml"]
    result = host.market.result(host.market.start(host.node, "bob")).result
    assert result.outcome == RunAgent.Result.SUCCEEDED
    host.edit("bob", agent("bob", "{wait: 0.01 s}"))
    host.await_version("bob", 2)
    assert not host.card("bob").degraded
    assert list(host.cards[-1].problems) == []


def test_changed_scene_file_is_reported_as_problem(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, bob=agent("bob"))
    assert host.cards[-1].trees == str(host.folder.resolve())
    scene = host.folder / "scene.yaml"
    scene.write_text(scene.read_text() + "# more\n")
    words = f"{scene} has changed; restart everything to use it"
    ros.until(lambda: [one.message for one in host.cards[-1].problems] == [words])


def test_unreadable_folder_is_problem_until_mended(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    host = Host(ros, tmp_path, bob=agent("bob"))

    def broken(_watch: FolderWatch, **_options: Any) -> None:
        raise RuntimeError("cogwheel")

    with monkeypatch.context() as patch:
        patch.setattr(FolderWatch, "poll", broken)
        words = "changed files are not applied: RuntimeError: cogwheel"
        ros.until(lambda: [one.message for one in host.cards[-1].problems] == [words])
    ros.until(lambda: not host.cards[-1].problems)


def test_switched_off_reload_happens_only_on_request(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, bob=agent("bob"))
    [set_to] = host.node.set_parameters([Parameter("reload", value=False)])
    assert set_to.successful
    host.edit("bob", agent("bob", "{say: bye}"))
    ros.turns(150)
    assert host.card("bob").version == 1
    answer = host.ask(ReloadAgents, "reload")
    assert answer.message == "bob: version 2 in force (tree changed: 1 node changed)"
    host.node.set_parameters([Parameter("reload", value=True)])
    host.edit("bob", agent("bob", "{say: again}"))
    host.await_version("bob", 3)


def test_reload_keeps_learned_profile_and_updates_initial_one(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, ann=agent("ann"), bob=agent("bob"))
    host.ask(SetProfile, "set_profile", agent="ann", values=[4.5], revision=4)
    for name in ("ann", "bob"):
        host.edit(name, agent(name).replace("{age: 3}", "{age: 2}"))
        host.await_version(name, 2)
    assert [list(host.card(name).profile) for name in ("ann", "bob")] == [[2.0], [2.0]]
    assert [list(host.card(name).current) for name in ("ann", "bob")] == [[4.5], [2.0]]


MARKED = (
    "{{parallel: {{succeed_on: one, children: [{{name: v{0}_a, wait: {1} ms}}, "
    "{{name: v{0}_b, repeat: forever, log: v{0}}}, {{name: v{0}_c, wait: 9 s}}]}}}}"
)


def test_thousand_swaps_under_ticking_never_mix_versions(ros: Any, tmp_path: Path) -> None:
    def text(name: str, number: int) -> str:
        return agent(name, MARKED.format(number, 60 + number % 7))

    host = Host(ros, tmp_path, ann=text("ann", 0), bob=text("bob", 0))
    host.node.set_parameters(
        [Parameter("tick_rate", value=200.0), Parameter("reload", value=False)]
    )
    statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
    watch = FolderWatch(host.node._versions.trees)
    runs: list[tuple[list[Any], Any]] = []
    replacements = replaced = 0
    while replacements < 1000:
        first = len(statuses)
        handle = host.market.start(host.node, "bob")
        future = handle.get_result_async()
        most = min(1000, 100 * (len(runs) + 1))
        while not future.done():
            for name in ("ann", "bob") if replacements < most else ():
                replacements += 1
                before = host.node.registry.members[name].spec
                host.edit(name, text(name, replacements))
                trees = watch.poll(settle=False)
                assert trees is not None
                host.node._reloading.update(trees)
                replaced += host.node.registry.members[name].spec is not before
            ros.turns(3)
        result = future.result().result
        ros.until(lambda r=result, f=first: statuses[f:] and statuses[-1].tick == r.ticks)
        runs.append((statuses[first:], result))
    assert len(runs) >= 10
    assert replaced >= 500, "ann does not run, so that each change of her tree acts at once"
    versions = []
    for reported, result in runs:
        assert result.outcome == RunAgent.Result.SUCCEEDED
        assert [status.tick for status in reported] == list(range(1, result.ticks + 1))
        names = {c.name for s in reported for c in s.changes if c.name.startswith("v")}
        marks = {name.partition("_")[0] for name in names}
        assert len(marks) == 1
        assert {name.partition("_")[2] for name in names} == {"a", "b", "c"}
        versions.append(int(marks.pop()[1:]))
    assert versions == sorted(versions)
    assert len(set(versions)) == len(versions)
    host.await_version("ann", 501)
    host.await_version("bob", 501)


def test_heartbeats_continue_while_many_agents_reload(ros: Any, tmp_path: Path) -> None:
    tree = "{sequence: [" + "{say: hello}, " * 20 + "{wait: 0 s}]}"
    host = Host(ros, tmp_path, **{f"a{n}": agent(f"a{n}", tree) for n in range(200)})
    for heard in list(ros.node.subscriptions):
        if heard.topic_name == "/agents/trees":
            # The probe shares the thread, and would need longer for them than the host does.
            ros.node.destroy_subscription(heard)
    beats: list[float] = []
    ros.node.create_subscription(
        Heartbeat, "agents/heartbeat", lambda _: beats.append(time.process_time()), qos.EVENTS
    )
    ros.until(lambda: len(beats) > 3)
    (host.folder / "skills" / "robot.yaml").write_text(SKILLS.replace("name: say,", "name: talk,"))
    ros.until(lambda: all(one.version == 2 for one in host.cards[-1].agents), 90.0)
    gaps = [after - before for before, after in pairwise(beats)]
    # CPU time: the probe is in the same process, and other processes may use the cores.
    assert max(gaps) < Settings().host_lease_s


def test_changes_are_published_after_last_agents_time_slice(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bt_agents.host.reload.reload_service._SLICE_S", 0.0)
    host = Host(ros, tmp_path, ann=agent("ann", "{say: hello}"), bob=agent("bob", "{say: hello}"))
    (host.folder / "skills" / "robot.yaml").write_text(SKILLS.replace("name: say,", "name: talk,"))
    ros.until(lambda: [one.version for one in host.cards[-1].agents] == [2, 2])


def test_idle_host_drops_clients_of_earlier_versions(ros: Any, tmp_path: Path) -> None:
    host = Host(ros, tmp_path, ann=agent("ann"), bob=patient("bob"))
    handle = host.market.start(host.node, "bob")
    robot = host.folder / "skills" / "robot.yaml"
    for number in range(3):
        robot.write_text(SKILLS.replace("name: say,", f"name: say_{number},"))
        host.await_version("ann", number + 2)
    assert host.says_on() == {"/say", "/say_0", "/say_1", "/say_2"}
    host.market.end(handle)
    ros.until(lambda: host.says_on() == {"/say_2"})
