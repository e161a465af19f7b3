# SPDX-License-Identifier: Apache-2.0
"""Asks an author at the terminal what the world does in a rehearsal."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from bt_agents.cli.scenario_words import happening_text, scenario_text
from bt_agents.errors import BtAgentsError, ReadError
from bt_agents.language.scenarios import GoalEnd, Happening, ScriptedAnswer
from bt_agents.language.specs import AgentSpec
from bt_agents.language.test_reader import read_scenario_text
from bt_agents.rehearsal import likely
from bt_agents.rehearsal.events import Use
from bt_agents.rehearsal.transcript import phrase, value_text
from bt_agents.scene import SceneSpace


class Typist:
    """Asks the author what the world does."""

    def __init__(self, console: Console, agent: AgentSpec, space: SceneSpace) -> None:
        self._console = console
        self._agent = agent
        self._space = space
        self._explained = False

    def answer(self, use: Use) -> ScriptedAnswer | None:
        """Ask how a skill ends; texts that are only said or shown are not asked for."""
        skill = use.node.skill
        if skill is None or (skill.main == "text" and not skill.outputs):
            return None
        likely_s = likely.duration_s(use.node, use.inputs, fails=False)
        if likely_s == 0.0 and not skill.outputs:
            return None
        if not self._explained:
            self._explained = True
            self._console.print(
                Text(
                    "Enter: as is likely · fail WHY · never · anything else is the answer",
                    style="dim",
                )
            )
        outputs = likely.outputs(use.node, use.inputs)
        usual = next(iter(outputs.values()), "done")
        typed = self._ask(f"{phrase(use.node, use.inputs)}  [{value_text(usual)}]")
        word, _, rest = (typed or "").partition(" ")
        if not word:
            return None
        if word == "fail":
            return ScriptedAnswer(end=GoalEnd.FAILS, reason=rest.strip() or "typed so")
        if typed == "never":
            return ScriptedAnswer(end=GoalEnd.NEVER)
        text = scenario_text(
            self._agent,
            scene=(),
            tunables=(),
            answers=(f"{use.node.path}={typed}",),
            happenings=(),
            seed=None,
        )
        try:
            read = read_scenario_text(text, "typed", self._agent, self._space)
        except ReadError as error:
            self._console.print(Text(error.report, style="red"), soft_wrap=True)
            return self.answer(use)
        return read.answers[0].answers[0]

    def happening(self, reason: str) -> Happening | None:
        """Ask what happens when the tree waits for something that nobody has announced."""
        self._console.print(Text(f"{reason}", style="yellow"), soft_wrap=True)
        typed = self._ask(
            "what happens? [nothing; or mood=1.5, buttons/confirm data=true, cancel]"
        )
        if not typed:
            return None
        try:
            text = f"format: 1\nduring:\n  - {happening_text(self._agent, typed)}\n"
            read = read_scenario_text(text, "typed", self._agent, self._space)
        except BtAgentsError as error:
            self._console.print(Text(str(error), style="red"), soft_wrap=True)
            return self.happening(reason)
        return read.during[0]

    def _ask(self, question: str) -> str | None:
        """Return what is typed; None at the end of the input."""
        try:
            return self._console.input(Text(f"{'?':>12} {question} > ", style="bold")).strip()
        except EOFError:
            self._console.print()
            return None
