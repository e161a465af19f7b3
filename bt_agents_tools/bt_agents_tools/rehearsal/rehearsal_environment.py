# SPDX-License-Identifier: Apache-2.0
"""Environment of a rehearsal: answers skills from the script, and publishes their events."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bt_agents.engine.environment import GoalState, SkillGoal
from bt_agents.engine.scripted_environment import ManualClock, ScriptedEnvironment, ScriptedGoal
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_language.files.testing.scenarios import ScriptedAnswer
from bt_agents_language.model.specs import NodeSpec
from bt_agents_tools.rehearsal.answers import Answers, PlayedSkill
from bt_agents_tools.rehearsal.events import Event, EventKind, Use


@dataclass(frozen=True, kw_only=True)
class _Open:
    run: ScriptedGoal
    use: Use
    performance: PlayedSkill


class RehearsalEnvironment(ScriptedEnvironment):
    """Environment that answers from a script.

    Args:
        nodes: The agent's nodes by path.
        answers: How skills are answered.
        ask: Asks a person how a use of a skill goes, once its begin is published; None when nobody
            wants to be asked about it.
        on_event: Called with every event.
        on_feedback: Called with feedback that the tree gives.

    Attributes:
        uses: The skills that were used, in order.
        active: Whether something was asked of it since this was last set to False.
    """

    def __init__(
        self,
        nodes: Mapping[str, NodeSpec],
        answers: Answers,
        *,
        ask: Callable[[Use], Callable[[], ScriptedAnswer | None] | None],
        on_event: Callable[[Event], None],
        on_feedback: Callable[[FeedbackKind, str], None],
    ) -> None:
        super().__init__(clock=ManualClock())
        self.uses: list[Use] = []
        self.active = False
        self._nodes = nodes
        self._script = answers
        self._ask = ask
        self._on_event = on_event
        self._on_feedback = on_feedback
        self._under_way: list[_Open] = []

    def send(self, goal: SkillGoal) -> ScriptedGoal:
        """Take a goal or request."""
        self.active = True
        self.report_ended()
        use = self._use(goal)
        question = self._ask(use)
        if question is not None:
            # How long it takes is not known before it is answered.
            self._event(EventKind.BEGINS, use)
        performance = self._script.perform(use, question() if question is not None else None)
        run = ScriptedGoal(goal, performance.answer, self.clock)
        self._under_way.append(_Open(run=run, use=use, performance=performance))
        if question is None:
            self._event(EventKind.BEGINS, use, takes_s=performance.answer.after_s)
        return run

    def publish(self, goal: SkillGoal) -> None:
        """Take a message."""
        self.active = True
        self._event(EventKind.SENDS, self._use(goal))

    def log(self, level: str, text: str) -> None:
        """Take a line of the log."""
        self.active = True
        self._on_event(Event(at_s=self.clock(), kind=EventKind.LOGS, text=f"{level}: {text}"))

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> ScriptedGoal:
        """Take feedback; it is always accepted."""
        self.active = True
        wanted = ", ".join(f"{name} {value:g}" for name, value in values.items())
        self._on_feedback(kind, ": ".join(filter(None, ("the tree", reason, wanted))))
        return super().give_feedback(kind, values, reason)

    @property
    def next_change(self) -> float:
        """When a goal next becomes something else [s]; infinite for never."""
        return min((one.run.next_change for one in self._under_way), default=float("inf"))

    def report_ended(self) -> None:
        """Publish the ends of goals that have ended by now."""
        for one in list(self._under_way):
            state = one.run.state
            if not state.ended:
                continue
            self._under_way.remove(one)
            if state is GoalState.SUCCEEDED:
                self._event(EventKind.SUCCEEDS, one.use, outputs=one.performance.outputs)
            elif state is GoalState.CANCELLED:
                self._event(EventKind.STOPS, one.use)
            else:
                reason = one.run.message
                text = f"{state.value}: {reason}" if reason else state.value
                self._event(EventKind.FAILS, one.use, text=text)

    def _use(self, goal: SkillGoal) -> Use:
        use = Use(node=self._nodes[goal.sender], inputs=goal.fields)
        self.uses.append(use)
        return use

    def _event(
        self,
        kind: EventKind,
        use: Use,
        *,
        outputs: Mapping[str, Plain] | None = None,
        takes_s: float = 0.0,
        text: str = "",
    ) -> None:
        self._on_event(
            Event(
                at_s=self.clock(),
                kind=kind,
                node=use.node,
                inputs=use.inputs,
                outputs=outputs or {},
                takes_s=takes_s,
                text=text,
            )
        )
