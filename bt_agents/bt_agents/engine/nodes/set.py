# SPDX-License-Identifier: Apache-2.0
"""Set: assigns values to names, and puts what the person said into the scene."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.light_behaviour import RUNNING, SUCCESS
from bt_agents.engine.scene_layer_leaf import SceneLayerLeaf
from bt_agents.engine.scope import scene_value
from bt_agents_language.nodes.set import BINDING, SCENE

_SHOWN_WITHIN_S = 0.5
"""Longest wait for a live scene with the values [s]; newer values may replace them."""


class Set(SceneLayerLeaf):
    """Assigns values to names, in order.

    SUCCESS at once, unless values of the scene are among them: then SUCCESS once the live scene
    has them, and FAILURE with the reason if the scene layer refuses them.
    """

    binding = BINDING
    changes_values = True
    _shown_by: float | None = None

    def begin(self) -> None:
        self._run = self._shown_by = None
        self._told: dict[str, float] = {}
        for name in self.spec.fields:
            value = self.fields.value(name)
            if not name.startswith(SCENE):
                self.write(name, value)
                continue
            parameter = name.removeprefix(SCENE)
            space = self.context.scope.space
            self._told[parameter] = scene_value(space, parameter, value, "set")
        if self._told:
            names, values = tuple(self._told), tuple(self._told.values())
            self.request({"names": names, "values": values, "told": True})

    def step(self) -> Status:
        if not self._told:
            return SUCCESS
        status = self.answered()
        if status is not SUCCESS:
            return status
        self.tell({SCENE + name: value for name, value in self._told.items()})
        if self._shown_by is None:
            self._shown_by = self.context.clock() + _SHOWN_WITHIN_S
        live = self.context.scope.live()
        shown = all(live.get(name) == value for name, value in self._told.items())
        if shown or self.context.is_due(self.spec.path, self._shown_by):
            return SUCCESS
        return RUNNING


BEHAVIOURS = {"set": Set}
