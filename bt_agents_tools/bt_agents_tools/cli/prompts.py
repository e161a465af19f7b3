# SPDX-License-Identifier: Apache-2.0
"""Asks an author at the terminal what the world does in a rehearsal."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.files.testing.scenarios import (
    GoalEnd,
    Scenario,
    ScriptedAnswer,
    ScriptedEvent,
)
from bt_agents_language.files.testing.test_reader import read_scenario_text
from bt_agents_language.model.specs import AgentSpec, Literal, NodeSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_tools.cli.scenario_options import Words, happens, typed_answer, typed_happening
from bt_agents_tools.rehearsal import default_answers
from bt_agents_tools.rehearsal.events import Use
from bt_agents_tools.rehearsal.transcript import value_text

_INDENT = 13


class InteractiveAnswers:
    """Asks the author what the world does."""

    def __init__(self, console: Console, agent: AgentSpec, vocabulary: SymbolTable) -> None:
        self._console = console
        self._agent = agent
        self._vocabulary = vocabulary
        self._space = vocabulary.space
        self._explained = False

    def asks(self, use: Use) -> bool:
        """Return whether a skill is asked for: not for texts that are only said or shown."""
        skill = use.node.skill
        outputs = default_answers.returned(use.node)
        if skill is None or (skill.main == "text" and not outputs):
            return False
        return bool(outputs) or default_answers.duration_s(use.node, use.inputs, fails=False) > 0.0

    def answer(self, use: Use) -> ScriptedAnswer | ScriptedEvent | None:
        """Ask how a skill ends, or what happens first."""
        if not self._explained:
            self._explained = True
            self._say("Enter: as is likely · fail WHY · never · anything else is the answer")
            self._say(f"{self._mood_example()} happens meanwhile, at any question")
        outputs = default_answers.outputs(use.node, use.inputs)
        name, usual = next(iter(outputs.items()), ("ends", "done"))
        choices = use.inputs.get("choices")
        possible = [*map(value_text, choices)] if isinstance(choices, tuple | list) else []
        others = "".join(f" or {one}" for one in possible if one != value_text(usual))
        typed = self._ask(f"{name} [{value_text(usual)}]{others}")
        word, _, rest = (typed or "").partition(" ")
        if not typed:
            return None
        if word == "fail":
            return ScriptedAnswer(end=GoalEnd.FAILS, reason=rest.strip() or "typed so")
        if typed == "never":
            return ScriptedAnswer(end=GoalEnd.NEVER)
        if typed not in possible and happens(self._agent, self._space, typed):
            return self._happening(typed) or self.answer(use)
        read = self._read(typed_answer(use.node.path, typed))
        return self.answer(use) if read is None else read.answers[0].answers[0]

    def happening(self, reason: str, waits: Sequence[NodeSpec]) -> ScriptedEvent | None:
        """Ask what happens while the tree only waits."""
        self._console.print(Text(f"{'':{_INDENT}}{reason}", style="yellow"), soft_wrap=True)
        examples = [*map(_message_example, waits), self._mood_example(), "cancel"]
        self._say(f"Enter: nothing · {' · '.join(filter(None, dict.fromkeys(examples)))}")
        while typed := self._ask("what happens? [nothing]"):
            happening = self._happening(typed)
            if happening is not None:
                return happening
        return None

    def _happening(self, typed: str) -> ScriptedEvent | None:
        try:
            words = typed_happening(self._agent, typed)
        except BtAgentsError as error:
            self._console.print(Text(str(error), style="red"), soft_wrap=True)
            return None
        read = self._read(words)
        return None if read is None else read.during[0]

    def _mood_example(self) -> str:
        name = self._space.mood or next(iter(self._space.names), "")
        return f"3s {name}=1" if name else "3s person=false"

    def _read(self, words: Words) -> Scenario | None:
        """Return what typed words mean; None when they mean nothing, which is then shown."""
        try:
            return read_scenario_text(words.text, "typed", self._agent, self._vocabulary)
        except ReadError as error:
            self._console.print(Text(words.explained(error), style="red"), soft_wrap=True)
            return None

    def _say(self, text: str) -> None:
        self._console.print(Text(f"{'':{_INDENT}}{text}", style="dim"), soft_wrap=True)

    def _ask(self, question: str) -> str | None:
        """Return what is typed; None at the end of the input."""
        prompt = Text(f"{'?':>{_INDENT - 2}} {question} > ", style="bold")
        try:
            typed = self._console.input(prompt).strip()
        except EOFError:
            self._console.print()
            return None
        if not sys.stdin.isatty():
            # Nobody has ended the line by typing.
            self._console.print(typed, markup=False)
        return typed


def _message_example(node: NodeSpec) -> str:
    """Return how a message is typed that a node waits for; empty when it waits for none."""
    topic, until = node.fields.get("topic"), node.fields.get("until")
    if not isinstance(topic, Literal):
        return ""
    names = until.names if isinstance(until, Expression) else ()
    field = next((name for name in names if name.startswith("msg.")), "")
    said = f" {field.removeprefix('msg.')}=true" if field else ""
    return f"8s {topic.value}{said}"
