# SPDX-License-Identifier: Apache-2.0
"""Environment of a rehearsal: answers skills from the script, and reports their events."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from bt_agents.engine.environment import GoalState, SkillGoal, server_missing
from bt_agents.engine.scripted_environment import ScriptedEnvironment, ScriptedGoal, ScriptedReply
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.local_time import LocalTime
from bt_agents_language.files.testing.scenarios import ScriptedAnswer
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes import remember
from bt_agents_language.nodes import set as set_
from bt_agents_tools.rehearsal.answers import Answers
from bt_agents_tools.rehearsal.events import Event, EventKind, Use

SCENE_LAYER = (remember.BINDING.name, set_.BINDING.name)
"""Services that nodes of the language itself use."""


class RehearsalEnvironment(ScriptedEnvironment):
    """Environment that answers skills from a script.

    ``ask`` returns a function that asks a person about a use of a skill after its start is
    published, or None to ask nobody; ``on_feedback`` takes feedback that the tree gives;
    ``tell_scene_layer`` takes values for the scene layer, and returns whether they arrived.

    Attributes:
        uses: The used skills, in order.
        active: True after a request of the tree, until it is set to False.
        told_time: True after the tree has read the local time, until it is set to False.
    """

    def __init__(
        self,
        nodes: Mapping[str, NodeSpec],
        answers: Answers,
        *,
        ask: Callable[[Use], Callable[[], ScriptedAnswer | None] | None],
        on_event: Callable[[Event], None],
        on_feedback: Callable[[FeedbackKind, str], None],
        tell_scene_layer: Callable[[SkillGoal], bool],
        begin: LocalTime,
    ) -> None:
        super().__init__(begin=begin)
        self.uses: list[Use] = []
        self.active = False
        self.told_time = False
        self._nodes = nodes
        self._script = answers
        self._ask = ask
        self._on_event = on_event
        self._on_feedback = on_feedback
        self._tell_scene_layer = tell_scene_layer
        self._requests: list[ScriptedGoal] = []
        self._open_goals: list[tuple[ScriptedGoal, Use, Mapping[str, Plain]]] = []

    def local_time(self) -> LocalTime:
        self.told_time = True
        return super().local_time()

    def send(self, goal: SkillGoal) -> ScriptedGoal:
        self.active = True
        if goal.name in SCENE_LAYER:
            request = ScriptedGoal(goal, self._answer_of_scene_layer(goal), self.clock)
            self._requests.append(request)
            return request
        self.report_ended()
        use = self._use(goal)
        question = self._ask(use)
        if question is not None:
            # Its duration is unknown until it is answered.
            self._event(EventKind.BEGINS, use)
        reply, outputs = self._script.play(use, question() if question is not None else None)
        scripted = ScriptedGoal(goal, reply, self.clock)
        self._open_goals.append((scripted, use, outputs))
        if question is None:
            self._event(EventKind.BEGINS, use, takes_s=reply.after_s)
        return scripted

    def publish(self, goal: SkillGoal) -> None:
        self.active = True
        self._event(EventKind.SENDS, self._use(goal))

    def log(self, level: str, text: str) -> None:
        self.active = True
        self._on_event(Event(at_s=self.clock(), kind=EventKind.LOGS, text=f"{level}: {text}"))

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> ScriptedGoal:
        self.active = True
        wanted = ", ".join(f"{name} {value:g}" for name, value in values.items())
        self._on_feedback(kind, ": ".join(filter(None, ("the tree", reason, wanted))))
        return super().give_feedback(kind, values, reason)

    @property
    def next_change(self) -> float:
        """Time of the next change of an open goal [s]; infinite for none."""
        self._requests = [one for one in self._requests if not one.state.ended]
        goals = [*self._requests, *(goal for goal, *_ in self._open_goals)]
        return min((goal.next_change for goal in goals), default=float("inf"))

    def report_ended(self) -> None:
        """Report goals that have ended by now as events."""
        ended = [one for one in self._open_goals if one[0].state.ended]
        self._open_goals = [one for one in self._open_goals if not one[0].state.ended]
        for goal, use, outputs in ended:
            if goal.state is GoalState.SUCCEEDED:
                self._event(EventKind.SUCCEEDS, use, outputs=outputs)
            elif goal.state is GoalState.CANCELLED:
                self._event(EventKind.STOPS, use)
            else:
                text = ": ".join(filter(None, (goal.state.value, goal.message)))
                self._event(EventKind.FAILS, use, text=text)

    def _answer_of_scene_layer(self, goal: SkillGoal) -> ScriptedReply:
        if self._tell_scene_layer(goal):
            return ScriptedReply(result={"accepted": True})
        limit_s = goal.timeouts.server_s
        return ScriptedReply(
            state=GoalState.UNREACHABLE, message=server_missing(limit_s), after_s=limit_s
        )

    def _use(self, goal: SkillGoal) -> Use:
        use = Use(node=self._nodes[goal.sender], inputs=goal.fields)
        self.uses.append(use)
        return use

    def _event(self, kind: EventKind, use: Use, **details: Any) -> None:
        at_s = self.clock()
        self._on_event(Event(at_s=at_s, kind=kind, node=use.node, inputs=use.inputs, **details))
