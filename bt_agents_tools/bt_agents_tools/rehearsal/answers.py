# SPDX-License-Identifier: Apache-2.0
"""Answers of a rehearsal to skills: typed, scripted or default ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scope import MessageNames, explain_false
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.field_types import Plain
from bt_agents_core.text import counted_answer
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.expressions import MissingValue
from bt_agents_language.files.testing import default_answers
from bt_agents_language.files.testing.path_patterns import is_path, matches
from bt_agents_language.files.testing.scenarios import (
    AnswerRule,
    GoalEnd,
    ScriptedAnswer,
    ScriptedEvent,
)
from bt_agents_language.model.specs import NodeSpec
from bt_agents_tools.rehearsal.events import Use


class AnswerSource(Protocol):
    """Source of answers from a person, in place of the script."""

    def asks(self, use: Use) -> bool:
        """Return whether to ask the person about a use of a skill."""

    def answer(self, use: Use) -> ScriptedAnswer | ScriptedEvent | None:
        """Return the answer to a use of a skill, or an event before it; None for the default."""


_STATES = {
    GoalEnd.SUCCEEDS: GoalState.SUCCEEDED,
    GoalEnd.FAILS: GoalState.ABORTED,
    GoalEnd.REJECTED: GoalState.REJECTED,
    GoalEnd.UNREACHABLE: GoalState.UNREACHABLE,
    GoalEnd.NEVER: GoalState.SUCCEEDED,
}


class Answers:
    """Answers of a script, used in turn."""

    def __init__(self, rules: Iterable[AnswerRule]) -> None:
        self._rules = sorted(rules, key=lambda rule: not is_path(rule.key))
        self._turns = dict.fromkeys(range(len(self._rules)), 0)

    def play(
        self, use: Use, typed: ScriptedAnswer | None = None
    ) -> tuple[ScriptedReply, Mapping[str, Plain]]:
        """Return the reply to a use of a skill, typed, scripted or default, and its outputs."""
        scripted = typed or self._scripted(use.node) or ScriptedAnswer()
        given = {**default_answers.outputs(use.node, use.inputs), **scripted.outputs}
        answer = _Answer.of(use, given)
        outputs = {**given, answer.output: answer.counted} if answer is not None else given
        result, feedback = _messages(use.node, outputs)
        state, reason = _STATES[scripted.end], scripted.reason
        if scripted.end is GoalEnd.SUCCEEDS and (rejection := _rejection(use, answer, result)):
            state, reason = GoalState.ABORTED, rejection
        fails = state is not GoalState.SUCCEEDED
        after_s = scripted.after_s
        if scripted.end is GoalEnd.NEVER:
            after_s = math.inf
        elif after_s is None and scripted.end in (GoalEnd.REJECTED, GoalEnd.UNREACHABLE):
            after_s = 0.0
        elif after_s is None:
            after_s = default_answers.duration_s(use.node, use.inputs, fails=fails)
        reply = ScriptedReply(
            state=state,
            result=result,
            message=reason,
            after_s=after_s,
            feedback=((0.0, feedback),) if feedback else (),
        )
        return reply, {} if fails else outputs

    def _scripted(self, node: NodeSpec) -> ScriptedAnswer | None:
        for number, rule in enumerate(self._rules):
            if rule.key == node.kind or (is_path(rule.key) and matches(rule.key, node.path)):
                turn = self._turns[number]
                self._turns[number] += 1
                return rule.answers[min(turn, len(rule.answers) - 1)]
        return None


def _messages(
    node: NodeSpec, outputs: Mapping[str, Plain]
) -> tuple[dict[str, Plain], dict[str, Plain]]:
    binding = node.skill.binding if node.skill is not None else None
    paths = {**node.outputs, **(binding.outputs if binding is not None else {})}
    of_feedback = {**node.feedback, **(binding.feedback if binding is not None else {})}
    result: dict[str, Plain] = {}
    feedback: dict[str, Plain] = {}
    for name, value in outputs.items():
        if name in of_feedback:
            _put(feedback, of_feedback[name], value)
        else:
            _put(result, paths.get(name, name), value)
    return result, feedback


def _put(message: dict[str, Plain], path: str, value: Plain) -> None:
    *groups, last = path.split(".")
    inner = message
    for group in groups:
        below = inner.setdefault(group, {})
        if not isinstance(below, dict):
            break
        inner = below
    inner[last] = value


@dataclass(frozen=True, kw_only=True)
class _Answer:
    """Text output of a skill that has ``choices``, as given and as matched to them."""

    output: str
    text: str
    choices: tuple[str, ...]

    @property
    def counted(self) -> str:
        return counted_answer(self.text, self.choices)

    @classmethod
    def of(cls, use: Use, outputs: Mapping[str, Plain]) -> _Answer | None:
        """Return the first text among outputs; None without a text or without ``choices``."""
        choices = use.inputs.get("choices")
        texts = ((name, value) for name, value in outputs.items() if isinstance(value, str))
        name, text = next(texts, ("", ""))
        if not name or not isinstance(choices, tuple | list):
            return None
        return cls(output=name, text=text, choices=tuple(map(str, choices)))


def _rejection(use: Use, answer: _Answer | None, result: Mapping[str, Plain]) -> str:
    """Return why an answer is not a success; empty if it is one.

    A successful answer is one of the skill's ``choices`` and fulfils its ``succeed_when``; fields
    that the script does not give count as right.
    """
    if answer is not None and answer.choices and not answer.counted:
        return f"'{answer.text}' is none of the choices"
    binding = use.node.skill.binding if use.node.skill is not None else None
    if binding is None or binding.succeed_when is None:
        return ""

    names = MessageNames(prefix="result", message=result, around=_NoNames())
    try:
        if binding.succeed_when.is_true(names.lookup):
            return ""
    except MissingValue:
        return ""
    except Undecided as undecided:
        return str(undecided)
    return explain_false(binding.succeed_when, names)


class _NoNames:
    def lookup(self, name: str) -> Plain:
        raise MissingValue(name)
