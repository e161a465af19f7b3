# SPDX-License-Identifier: Apache-2.0
"""Interactive answers of a rehearsal: terminal prompts for the behaviour of the world."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.files.testing import default_answers
from bt_agents_language.files.testing.scenarios import (
    GoalEnd,
    Scenario,
    ScriptedAnswer,
    ScriptedEvent,
)
from bt_agents_language.files.testing.test_reader import read_scenario_text
from bt_agents_language.model.specs import AgentSpec, Literal, NodeSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_tools.cli.scenario_options import TypedYaml, is_event, typed_answer, typed_event
from bt_agents_tools.rehearsal.events import Use
from bt_agents_tools.rehearsal.transcript import value_text

_INDENT = 13


class InteractiveAnswers:
    """Source of answers that prompts the author."""

    def __init__(self, console: Console, agent: AgentSpec, symbols: SymbolTable) -> None:
        self._console = console
        self._agent = agent
        self._symbols = symbols
        self._space = symbols.space
        self._explained = False

    def asks(self, use: Use) -> bool:
        # Texts that are only said or shown need no answer.
        skill = use.node.skill
        outputs = default_answers.returned(use.node)
        if skill is None or (skill.main == "text" and not outputs):
            return False
        return bool(outputs) or default_answers.duration_s(use.node, use.inputs, fails=False) > 0.0

    def answer(self, use: Use) -> ScriptedAnswer | ScriptedEvent | None:
        if not self._explained:
            self._explained = True
            self._print_hint(
                "Enter: as is likely · fail WHY · never · anything else is the answer"
            )
            self._print_hint(f"{self._mood_example()} happens meanwhile, at any question")
        outputs = default_answers.outputs(use.node, use.inputs)
        name, usual = next(iter(outputs.items()), ("ends", "done"))
        choices = use.inputs.get("choices")
        possible = [*map(value_text, choices)] if isinstance(choices, tuple | list) else []
        others = "".join(f" or {one}" for one in possible if one != value_text(usual))
        typed = self._prompt(f"{name} [{value_text(usual)}]{others}")
        word, _, rest = (typed or "").partition(" ")
        if not typed:
            return None
        if word == "fail":
            return ScriptedAnswer(end=GoalEnd.FAILS, reason=rest.strip() or "typed so")
        if typed == "never":
            return ScriptedAnswer(end=GoalEnd.NEVER)
        if typed not in possible and is_event(self._agent, self._space, typed):
            return self._read_event(typed) or self.answer(use)
        read = self._read(typed_answer(use.node.path, typed))
        return self.answer(use) if read is None else read.answers[0].answers[0]

    def event(self, reason: str, waits: Sequence[NodeSpec]) -> ScriptedEvent | None:
        """Prompt for an event while the tree only waits; None for none."""
        self._console.print(Text(f"{'':{_INDENT}}{reason}", style="yellow"))
        examples = [*map(_message_example, waits), self._mood_example(), "cancel"]
        self._print_hint(f"Enter: nothing · {' · '.join(filter(None, dict.fromkeys(examples)))}")
        while typed := self._prompt("what happens? [nothing]"):
            event = self._read_event(typed)
            if event is not None:
                return event
        return None

    def _read_event(self, typed: str) -> ScriptedEvent | None:
        try:
            read = self._read(typed_event(self._agent, typed))
        except BtAgentsError as error:
            self._console.print(Text(str(error), style="red"))
            return None
        return None if read is None else read.during[0]

    def _mood_example(self) -> str:
        name = self._space.mood or next(iter(self._space.names), "")
        return f"3s {name}=1" if name else "3s person=false"

    def _read(self, typed: TypedYaml) -> Scenario | None:
        """Parse typed YAML; None when it has errors, which are printed."""
        try:
            return read_scenario_text(typed.text, "typed", self._agent, self._symbols)
        except ReadError as error:
            self._console.print(Text(typed.explained(error), style="red"))
            return None

    def _print_hint(self, text: str) -> None:
        self._console.print(Text(f"{'':{_INDENT}}{text}", style="dim"))

    def _prompt(self, question: str) -> str | None:
        """Prompt for a line; None at the end of the input."""
        prompt = Text(f"{'?':>{_INDENT - 2}} {question} > ", style="bold")
        try:
            typed = self._console.input(prompt).strip()
        except EOFError:
            self._console.print()
            return None
        if not sys.stdin.isatty():
            # The terminal did not echo the input.
            self._console.print(typed, markup=False)
        return typed


def _message_example(node: NodeSpec) -> str:
    """Return an example of a typed message that a node waits for; empty if it waits for none."""
    topic, until = node.fields.get("topic"), node.fields.get("until")
    if not isinstance(topic, Literal):
        return ""
    names = until.names if isinstance(until, Expression) else ()
    field = next((name for name in names if name.startswith("msg.")), "")
    assignment = f" {field.removeprefix('msg.')}=true" if field else ""
    return f"8s {topic.value}{assignment}"
