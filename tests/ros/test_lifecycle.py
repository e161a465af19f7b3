# SPDX-License-Identifier: Apache-2.0
"""Managed nodes as seen by a lifecycle manager."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from bt_agents.host.environment.open_goals_file import OpenGoalsFile
from bt_agents.host.node import HostNode
from bt_agents_core.errors import BtAgentsError
from bt_agents_interfaces.msg import Run, TreeStatus
from bt_agents_ros import qos
from bt_agents_ros.managed_node import AUTOSTART, ManagedNode, make_managed
from feedback_node.ledger import Ledger
from feedback_node.node import FeedbackNode
from graph import Ros
from marketplace_node.node import MarketplaceNode
from scene_layer.node import SceneLayerNode
from whole_system import System, write_agents

CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP = (
    Transition.TRANSITION_CONFIGURE,
    Transition.TRANSITION_ACTIVATE,
    Transition.TRANSITION_DEACTIVATE,
    Transition.TRANSITION_CLEANUP,
)
NODES: dict[str, Callable[[], ManagedNode[Any]]] = {
    "marketplace": MarketplaceNode,
    "scene_layer": SceneLayerNode,
    "feedback": FeedbackNode,
    "agents": HostNode,
}


class Manager:
    """Lifecycle manager of one node, which uses only its services."""

    def __init__(self, ros: Ros, name: str) -> None:
        self.ros = ros
        self._name = name
        self._change = ros.node.create_client(ChangeState, f"{name}/change_state")
        self.events: list[TransitionEvent] = ros.collect(
            TransitionEvent, f"{name}/transition_event", qos.EVENTS
        )
        ros.until(lambda: ros.node.count_publishers(f"{name}/transition_event"))

    def begin(self, number: int = 0, label: str = "") -> Future:
        self.ros.until(self._change.service_is_ready)
        transition = Transition(id=number, label=label)
        return self._change.call_async(ChangeState.Request(transition=transition))

    def change(self, number: int = 0, label: str = "") -> bool:
        return bool(self.ros.result(self.begin(number, label)).success)

    @property
    def state(self) -> str:
        return str(self.ros.ask(GetState, f"{self._name}/get_state").current_state.label)

    @property
    def transitions(self) -> set[str]:
        service = f"{self._name}/get_available_transitions"
        answer = self.ros.ask(GetAvailableTransitions, service)
        return {one.transition.label for one in answer.available_transitions}


def endpoints(node: Node) -> dict[str, int]:
    """Return the numbers of endpoints, timers and parameters of a node."""
    kinds = ("publishers", "subscriptions", "services", "clients", "timers", "waitables")
    counts = {kind: len(list(getattr(node, kind))) for kind in kinds}
    return {**counts, "parameters": len(node.list_parameters([], 0).names)}


@pytest.fixture
def system(ros: Ros, tmp_path: Path) -> System:
    return System(ros, write_agents(tmp_path, ann=4.0), epoch=None)


def unconfigured(ros: Ros, name: str, trees: Path, **values: Any) -> ManagedNode[Any]:
    parameters = {"trees": str(trees), "ledger": ":memory:", **values}
    given = [Parameter(key, value=value) for key, value in parameters.items()]
    return ros.add(NODES[name](parameter_overrides=given))  # type: ignore[call-arg]


@pytest.mark.parametrize("name", NODES)
def test_node_cycles_repeatedly_through_all_lifecycle_states(
    ros: Ros, tmp_path: Path, name: str
) -> None:
    node = unconfigured(ros, name, write_agents(tmp_path, ann=4.0))
    manager = Manager(ros, name)
    bare = endpoints(node)
    assert (manager.state, manager.transitions) == ("unconfigured", {"configure", "shutdown"})

    assert manager.change(CONFIGURE)
    assert manager.state == "inactive"
    assert manager.transitions == {"activate", "cleanup", "shutdown"}
    assert endpoints(node) == bare
    active = []
    for _ in range(3):
        assert manager.change(label="activate")
        ros.turns(20)
        active.append(endpoints(node))
        assert manager.change(DEACTIVATE)
        assert endpoints(node) == bare
    assert active[0] == active[1] == active[2]
    assert active[0]["publishers"] > bare["publishers"]
    assert manager.change(CLEANUP)
    assert manager.change(label="shutdown")
    assert (manager.state, manager.transitions) == ("finalized", set())

    ways = [(one.start_state.label, one.goal_state.label) for one in manager.events]
    assert ways[:2] == [("unconfigured", "configuring"), ("configuring", "inactive")]
    assert ways[-2:] == [("unconfigured", "shuttingdown"), ("shuttingdown", "finalized")]
    assert all(earlier[1] == later[0] for earlier, later in pairwise(ways))


def test_transition_from_wrong_state_is_refused_without_effect(
    ros: Ros, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    unconfigured(ros, "marketplace", write_agents(tmp_path, ann=4.0))
    manager = Manager(ros, "marketplace")

    assert not manager.change(ACTIVATE)
    assert not manager.change(label="no\nsuch")
    assert manager.state == "unconfigured"
    log = capfd.readouterr().err
    assert (
        "NO_TRANSITION: transition 3 does not begin in the state 'unconfigured', "
        "expected 'configure' (1), 'shutdown' (5)"
    ) in log
    assert "NO_TRANSITION: 'no such' does not begin" in log


def test_node_stays_unconfigured_until_files_are_repaired(
    ros: Ros, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    trees = write_agents(tmp_path, ann=4.0)
    scene = trees / "scene.yaml"
    text = scene.read_text()
    scene.write_text("format: 1\nparametres: {}\n")
    unconfigured(ros, "scene_layer", trees)
    manager = Manager(ros, "scene_layer")

    assert not manager.change(CONFIGURE)
    assert manager.state == "unconfigured"
    assert "parametres" in capfd.readouterr().err
    scene.write_text(text)
    assert manager.change(CONFIGURE)


def test_deactivation_fault_is_answered_and_cleaned_up(
    ros: Ros, system: System, capfd: pytest.CaptureFixture[str]
) -> None:
    manager = Manager(ros, "scene_layer")
    node = system.scene_layer

    def fail() -> None:
        raise RuntimeError("the disk is gone")

    node._closing.callback(fail)
    assert not manager.change(DEACTIVATE)
    assert manager.state == "unconfigured"
    assert "RuntimeError: the disk is gone" in capfd.readouterr().err
    assert not node.is_active
    ros.until(lambda: not ros.node.count_publishers("bt_agents/scene"))
    assert not ros.node.count_services("scene_layer/analyze")
    assert not list(node.timers)


@pytest.mark.parametrize(
    "bad", [{"qos_overrides./agents/run_control.publisher.depth": -1}, {"live_lease": "x"}]
)
def test_failed_activation_leaves_node_clean(
    ros: Ros, tmp_path: Path, bad: dict[str, Any]
) -> None:
    file = tmp_path / "open_goals.json"
    trees = write_agents(tmp_path, ann=4.0)
    node = unconfigured(ros, "agents", trees, open_goals=str(file), **bad)
    manager = Manager(ros, "agents")
    bare = endpoints(node)
    assert manager.change(CONFIGURE)
    assert not manager.change(ACTIVATE)

    OpenGoalsFile(file).close()
    assert (manager.state, endpoints(node)) == ("inactive", bare)


def test_system_continues_after_temporary_deactivation_of_any_node(
    ros: Ros, system: System
) -> None:
    assert system.interact(age=4) == "ann"
    for node in (system.market, system.scene_layer, system.feedback, system.host):
        manager = Manager(ros, node.get_name())
        assert manager.change(DEACTIVATE)
        ros.turns(50)
        assert manager.change(ACTIVATE)
        ros.until(lambda: system.host.registered)
        assert system.interact(age=4) == "ann"
    ros.until(lambda: len(system.ends) == 5)
    assert {end.code for end in system.ends} == {"SUCCEEDED"}


class Deactivation:
    """A running tree with a clean-up that takes a while and then logs, on a managed host."""

    def __init__(self, ros: Ros, folder: Path, clean_up: str) -> None:
        trees = write_agents(folder, ann=4.0, wait="60 s")
        file = trees / "agents" / "ann.yaml"
        agent = yaml.safe_load(file.read_text())
        agent["on_cancel"] = {"sequence": [{"wait": clean_up}, {"log": "cleaned up"}]}
        agent["on_cancel_within"] = "10 s"
        file.write_text(yaml.safe_dump(agent, sort_keys=False))
        self.system = System(ros, trees)
        self.statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
        self.manager = Manager(ros, "agents")
        self.system.analyze(age=4)
        self.runs = self.system.runs
        ros.until(lambda: self.runs and self.runs[-1].event == Run.STARTED)

    @property
    def cleaned_up(self) -> bool:
        return any(c.message == "cleaned up" for one in self.statuses for c in one.changes)


def test_deactivated_host_first_ends_its_tree_cleanly(
    ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = Deactivation(ros, tmp_path, "1 s")
    host, manager = running.system.host, running.manager

    # It stays in the state until the test has seen that.
    seen: list[bool] = []
    has_stopped = host.has_stopped
    monkeypatch.setattr(host, "has_stopped", lambda: bool(seen) and has_stopped())
    answer = manager.begin(DEACTIVATE)
    ros.until(lambda: manager.events)
    assert manager.state == "deactivating"
    assert not manager.change(CLEANUP)
    assert not manager.change(Transition.TRANSITION_ON_DEACTIVATE_SUCCESS)
    assert not manager.change(label="transition_error")
    assert manager.state == "deactivating"
    assert not answer.done()
    seen.append(True)
    assert ros.result(answer).success
    assert manager.state == "inactive"
    ros.until(lambda: running.runs[-1].event == Run.ENDED)
    assert running.runs[-1].outcome == Run.CANCELLED
    assert running.cleaned_up
    assert not host.is_active


def test_end_of_process_cuts_deactivation_short(ros: Ros, tmp_path: Path) -> None:
    running = Deactivation(ros, tmp_path, "9 s")
    answer = running.manager.begin(DEACTIVATE)
    ros.until(lambda: running.manager.events)
    running.system.host.request_stop()
    assert ros.result(answer).success
    ros.until(lambda: running.runs[-1].event == Run.ENDED)
    assert running.runs[-1].outcome == Run.CANCELLED
    assert not running.cleaned_up


def test_parameters_survive_reactivation_and_tunables_reset_to_file(
    ros: Ros, system: System
) -> None:
    manager = Manager(ros, "agents")
    wanted = [Parameter("live_lease", value=3.0), Parameter("tick_rate", value=33.0)]
    asked = [one.to_parameter_msg() for one in wanted]
    answer = ros.ask(SetParameters, "agents/set_parameters", parameters=asked)
    assert [one.reason for one in answer.results] == ["", ""]

    assert manager.change(DEACTIVATE)
    assert not system.host.has_parameter("live_lease")
    assert manager.change(ACTIVATE)
    assert system.host.get_parameter("live_lease").value == 3.0
    assert system.host.get_parameter("tick_rate").value != 33.0


def test_inactive_feedback_node_releases_its_ledger(ros: Ros, tmp_path: Path) -> None:
    ledger = tmp_path / "ledger.sqlite"
    unconfigured(ros, "feedback", write_agents(tmp_path, ann=4.0), ledger=str(ledger))
    manager = Manager(ros, "feedback")
    assert manager.change(CONFIGURE)
    assert manager.change(ACTIVATE)
    assert manager.change(DEACTIVATE)

    with Ledger(ledger) as other:
        assert not manager.change(ACTIVATE)
        assert not other.failure
    assert manager.change(ACTIVATE)


def test_process_starts_active_unless_autostart_is_off(ros: Ros, tmp_path: Path) -> None:
    trees = Parameter("trees", value=str(write_agents(tmp_path, ann=4.0)))
    for given, is_active in (([trees], True), ([trees, Parameter(AUTOSTART, value=False)], False)):
        node = ros.add(make_managed(partial(MarketplaceNode, parameter_overrides=given)))
        assert node.is_active is is_active
        ros.remove(node)
    broken = [Parameter("trees", value=str(tmp_path / "nowhere"))]
    with pytest.raises(BtAgentsError, match="nowhere' is not a trees folder"):
        make_managed(partial(MarketplaceNode, parameter_overrides=broken))
