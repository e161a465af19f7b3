# SPDX-License-Identifier: Apache-2.0
"""Commands of operators, executed by the market."""

from __future__ import annotations

import re
from dataclasses import replace

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Scene
from bt_agents_language.diagnostics.collection import did_you_mean
from marketplace_node.effects import State
from marketplace_node.interaction.award import StopRequest
from marketplace_node.interaction.interaction import Interaction
from marketplace_node.interaction.scene_admission import SceneAdmission
from marketplace_node.market_state import MarketState
from marketplace_node.operators.operator_overrides import VETOED, OperatorAction, OperatorCommand

_AWARDED = re.compile(r"\+award\d+$")


class OperatorCommands:
    """Executor of operator commands: pins and vetoes, stops of vetoed runs, awarded scenes.

    Args:
        floor: Shared by all rounds.
        arrivals: Takes the scenes.
    """

    def __init__(self, floor: MarketState, arrivals: SceneAdmission) -> None:
        self._floor = floor
        self._arrivals = arrivals
        self._awards = 0

    def take(self, order: OperatorCommand, interaction: Interaction | None, now: float) -> str:
        """Do what is asked for; return it in words.

        Raises:
            Refused: Nothing is changed.
        """
        overrides = self._floor.overrides
        if order.act is OperatorAction.UNPIN:
            return overrides.unpin()
        if order.act is OperatorAction.ALLOW:
            return overrides.allow(order)
        self._check_known(order.agent)
        match order.act:
            case OperatorAction.PIN:
                return overrides.pin(order) + _runs_on(order.agent, interaction)
            case OperatorAction.VETO:
                return overrides.veto(order) + self._stop(order, interaction, now)
            case _:
                return self._award(order, interaction)

    def restore(self, text: str) -> str:
        """Take over what an earlier market was ordered; return it in words, empty for nothing.

        Raises:
            Refused: ``MALFORMED``; nothing is changed.
        """
        self._floor.restore(text)
        return self._floor.overrides.intervention("")

    def scene(self, scene: Scene | None) -> Scene:
        """Return a scene, or the one that was taken last.

        Raises:
            Refused: ``NO_SCENE``.
        """
        found = scene or self._floor.last_scene
        if found is None:
            raise Refused(
                "NO_SCENE", "there has been no scene yet; name one, or ask after the first"
            )
        return found

    def _check_known(self, agent: str) -> None:
        if self._floor.registry.holder(agent) is None:
            hint = did_you_mean(agent, self._floor.registry.agents)
            raise Refused(
                "UNKNOWN_AGENT",
                f"no agent '{agent}' is registered; {hint or 'no host is there'}",
            )

    def _stop(self, order: OperatorCommand, interaction: Interaction | None, now: float) -> str:
        """Stop the agent when it has the run, and let the others be asked; return it in words."""
        goal = interaction.goal if interaction is not None else None
        if interaction is None or goal is None or goal.agent != order.agent:
            return ""
        if interaction.state is State.COLLECTING:
            return ""
        stopping = interaction.state is State.CANCELLING
        stop = StopRequest(reason=f"{order.who} vetoes it{order.because}", again=True, code=VETOED)
        _, message = interaction.stop(stop, now)
        return f"; {message}" + ("" if stopping else ", and the others are asked")

    def _award(self, order: OperatorCommand, interaction: Interaction | None) -> str:
        self._floor.overrides.check_award(order)
        scene = self.scene(order.scene)
        if order.scene is None:
            self._awards += 1
            scene = scene.with_id(f"{_AWARDED.sub('', scene.scene_id)}+award{self._awards}")
        scene = replace(scene, urgent=True)
        self._arrivals.join(scene, interaction)
        self._floor.overrides.award(order, scene.scene_id)
        named = _AWARDED.sub("", scene.scene_id)
        answer = f"{order.agent} gets the run for scene '{named}' if it bids"
        if interaction is not None:
            answer += f"; scene '{interaction.origin.scene_id}' is under way"
        return answer


def _runs_on(agent: str, interaction: Interaction | None) -> str:
    goal = interaction.goal if interaction is not None else None
    if goal is None or goal.agent == agent:
        return ""
    return f"; {goal.agent} goes on until its run ends"
