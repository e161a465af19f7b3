# SPDX-License-Identifier: Apache-2.0
"""A system that a lifecycle manager brings up, takes down, and brings up again."""

from __future__ import annotations

from dataclasses import replace

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from bt_agents_ros.managed_node import AUTOSTART
from bt_agents_tools.launcher import components
from processes import System, write_trees

pytestmark = pytest.mark.e2e

ORDER = ("marketplace", "feedback", "scene_layer", "agents")


class LifecycleManager:
    """Manager that drives nodes like nav2's: one after another, by their services."""

    def __init__(self, system: System) -> None:
        self._system = system
        create = system.ros.node.create_client
        self._change = {name: create(ChangeState, f"/{name}/change_state") for name in ORDER}
        self._state = {name: create(GetState, f"/{name}/get_state") for name in ORDER}

    def states(self) -> set[str]:
        asked = [self._system.ask(one, GetState.Request()) for one in self._state.values()]
        return {one.current_state.label for one in asked}

    def all(self, number: int, names: tuple[str, ...]) -> None:
        for name in names:
            client = self._change[name]
            self._system.until(client.service_is_ready, f"/{name}/change_state")
            request = ChangeState.Request(transition=Transition(id=number))
            answer = client.call_async(request)
            self._system.until(answer.done, f"transition {number} of {name}")
            assert answer.result().success, name

    def startup(self) -> None:
        self.all(Transition.TRANSITION_CONFIGURE, ORDER)
        self.all(Transition.TRANSITION_ACTIVATE, ORDER)

    def reset(self) -> None:
        self.all(Transition.TRANSITION_DEACTIVATE, ORDER[::-1])
        self.all(Transition.TRANSITION_CLEANUP, ORDER[::-1])


@pytest.mark.parametrize("layout", ["processes", "one process"])
def test_lifecycle_manager_can_restart_whole_system(system: System, layout: str) -> None:
    trees = write_trees(system.folder / "trees", leo=(4.5, "say: leo speaks"))
    system.say_server.let_go()
    parts = [
        replace(one, parameters={**one.parameters, AUTOSTART: False})
        for one in (
            components.market(trees),
            components.scene_layer(trees),
            components.feedback(trees, ":memory:"),
            components.host(trees),
        )
    ]
    for component in [components.one_process(parts)] if layout == "one process" else parts:
        system.start(component)
    manager = LifecycleManager(system)
    assert manager.states() == {"unconfigured"}
    assert not system.statuses

    manager.startup()
    assert manager.states() == {"active"}
    epochs = []
    for number, scene_id in enumerate(("s1", "s2"), 1):
        system.until_ready(hosts=1, agents=1, after=epochs[-1] if epochs else "")
        system.old_person(scene_id)
        assert system.until_end_of(scene_id).code == "SUCCEEDED"
        assert len(system.started("leo")) == number
        epochs.append(system.epoch)
        manager.reset()
        assert manager.states() == {"unconfigured"}
        if number == 1:
            manager.startup()

    for process in system.processes:
        process.terminate()
    for process in system.processes:
        system.until(lambda process=process: process.ended, f"the end of {process.node}")
        assert process.exit_code == 0
        assert "UNKNOWN_PARAMETER" not in process.said
