# SPDX-License-Identifier: Apache-2.0
"""Commands of operators, and previews that show the winner without a run."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, awarded_id, unawarded_id
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_language.diagnostics.collection import did_you_mean
from marketplace_node.effects import PreviewEnded, State
from marketplace_node.explanation.reason import reason_of
from marketplace_node.interaction.interaction import Interaction
from marketplace_node.interaction.phases import OpenRound, StopRequest
from marketplace_node.interaction.scene_admission import SceneAdmission
from marketplace_node.market_state import MarketState
from marketplace_node.operator_overrides import OperatorAction, OperatorCommand
from marketplace_node.settings import check_strategy

MOST_PREVIEWS = 8
"""Most previews open at a time."""


class OperatorCommands:
    """Executor of operator commands: pins and vetoes, stops of vetoed runs, awarded scenes."""

    def __init__(self, market_state: MarketState, admission: SceneAdmission) -> None:
        self._market_state = market_state
        self._admission = admission
        self._awards = 0

    def take(self, command: OperatorCommand, interaction: Interaction | None, now: float) -> str:
        """Execute a command; return the answer for the operator.

        Raises:
            Refused: The command is invalid; nothing is changed.
        """
        overrides = self._market_state.overrides
        if command.action is OperatorAction.UNPIN:
            return overrides.unpin()
        if command.action is OperatorAction.ALLOW:
            return overrides.allow(command)
        agents = self._market_state.hosts.registry.agents
        if command.agent not in agents:
            hint = did_you_mean(command.agent, agents) or "no host is there"
            raise Refused(
                RefusalCode.UNKNOWN_AGENT, f"no agent '{command.agent}' is registered; {hint}"
            )
        match command.action:
            case OperatorAction.PIN:
                return overrides.pin(command) + _runs_on(command.agent, interaction)
            case OperatorAction.VETO:
                return overrides.veto(command) + self._stop(command, interaction, now)
            case _:
                return self._award(command, interaction)

    def scene(self, scene: Scene | None) -> Scene:
        """Return the given scene, else the last one.

        Raises:
            Refused: ``NO_SCENE``.
        """
        found = scene or self._market_state.last_scene
        if found is None:
            raise Refused(
                RefusalCode.NO_SCENE,
                "there has been no scene yet; name one, or ask after the first",
            )
        return found

    def _stop(self, command: OperatorCommand, interaction: Interaction | None, now: float) -> str:
        """Stop the agent if it runs and ask the others; return the end of the answer."""
        goal = interaction.goal if interaction is not None else None
        if interaction is None or goal is None or goal.agent != command.agent:
            return ""
        if interaction.state is State.COLLECTING:
            return ""
        stopping = interaction.state is State.CANCELLING
        stop = StopRequest(
            reason=f"{command.who} vetoes it{command.because}",
            by=StoppedBy.OPERATOR,
            again=True,
            code=RefusalCode.VETOED,
        )
        _, message = interaction.stop(stop, now)
        return f"; {message}" + ("" if stopping else ", and asking the others")

    def _award(self, command: OperatorCommand, interaction: Interaction | None) -> str:
        self._market_state.overrides.check_award(command)
        scene = self.scene(command.scene)
        if command.scene is None:
            self._awards += 1
            scene = scene.with_id(awarded_id(scene.scene_id, self._awards))
        scene = replace(scene, urgent=True)
        self._admission.join(scene, interaction)
        self._market_state.overrides.award(command, scene.scene_id)
        named = unawarded_id(scene.scene_id)
        answer = f"{command.agent} gets the run for scene '{named}' if it bids"
        if interaction is None:
            return answer
        busy = f"scene '{interaction.origin.scene_id}' is under way"
        if self._market_state.settings.on_new_scene == "preempt":
            return f"{answer}; {busy} and may be stopped for it, otherwise it waits"
        return f"{answer}; it waits, number {len(self._admission)} in line: {busy}"


def _runs_on(agent: str, interaction: Interaction | None) -> str:
    goal = interaction.goal if interaction is not None else None
    if goal is None or goal.agent == agent:
        return ""
    return f"; {goal.agent} goes on until its run ends"


class Previews:
    """The open previews; each ends exactly once."""

    def __init__(self, market_state: MarketState) -> None:
        self._market_state = market_state
        self.open_rounds: list[OpenRound] = []

    def ask(self, scene: Scene, strategy: str, now: float) -> int:
        """Open a preview and return its number; an empty ``strategy`` means the one in force.

        Raises:
            Refused: ``UNKNOWN_STRATEGY`` or ``BUSY``.
        """
        strategy = strategy or self._market_state.settings.strategy
        check_strategy(strategy)
        if len(self.open_rounds) >= MOST_PREVIEWS:
            raise Refused(
                RefusalCode.BUSY,
                f"{MOST_PREVIEWS} previews are under way, and more may not be; ask again later",
            )
        preview = OpenRound(self._market_state, scene, now, preview=strategy)
        self.open_rounds.append(preview)
        return preview.number

    def update(self, now: float) -> None:
        """End the previews that are due."""
        for preview in tuple(self.open_rounds):
            by = preview.closing(now)
            if by is not None:
                self.open_rounds.remove(preview)
                decision = preview.close(by, now)
                outcome = self._market_state.as_published(decision, partial(reason_of, decision))
                self._market_state.effects.append(
                    PreviewEnded(number=preview.number, outcome=outcome)
                )

    def give_up(self, code: RefusalCode, reason: str) -> None:
        """End all previews without an outcome."""
        for preview in self.open_rounds:
            self._market_state.effects.append(
                PreviewEnded(number=preview.number, outcome=Refused(code, reason))
            )
        self.open_rounds.clear()
