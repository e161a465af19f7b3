# SPDX-License-Identifier: Apache-2.0
"""Harness for trees: an agent written in a test, a scripted environment, a manual clock."""

from __future__ import annotations

import math
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.environment import GoalState
from bt_agents.engine.run import Run, RunLimits, RunResult, StatusChange
from bt_agents.engine.scripted_environment import ScriptedEnvironment, ScriptedReply
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import Origin, Scene, SceneSpace
from bt_agents_language.files.folder_reader import read_symbols
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.model.specs import AgentSpec, NodeSpec
from bt_agents_language.nodes.symbols import SymbolTable
from file_texts import read_agent_text
from scene_spaces import scene_of

TREES = Path(__file__).parents[2] / "trees"
SPACE: SceneSpace = read_scene(TREES / "scene.yaml").space
SYMBOLS: SymbolTable = read_symbols(TREES)

VOICE = """
format: 1
skills:
  say:
    description: Speak a text.
    main: text
    inputs: {text: {type: text, description: what to say}}
    action: {name: say, type: bt_agents_interfaces/action/Say, goal: {text: "${text}"}}
"""
"""Skills of a robot that can only speak."""

LONG = [ScriptedReply(after_s=100.0)]
FAILS = [ScriptedReply(state=GoalState.ABORTED, message="motor off")]


def scene(scene_id: str = "s1", person: bool = True, **values: float) -> Scene:
    """Return a scene; parameters without a value are missing."""
    vector = [values.get(name, math.nan) for name in SPACE.names]
    return scene_of(SPACE, vector, scene_id, origin=Origin.MEASURED, person=person)


def agent_text(
    name: str, tree: str, more: str = "", profile: tuple[float, float, float] = (3, 3, 3)
) -> str:
    """Return the file of an agent, with more lines at its end."""
    age, familiarity, mood = profile
    return (
        f"format: 1\nagent: {name}\ntitle: {name}\ndescription: {name}\n"
        f"profile: {{age: {age}, familiarity: {familiarity}, mood: {mood}}}\n"
        f"tree:\n  {tree}\n{more}\n"
    )


def trees_folder(folder: Path, agents: Mapping[str, str], skills: str = "") -> Path:
    """Make a trees folder with these files of agents and the shipped scene; return it.

    Args:
        folder: Created by this function.
        agents: Name of a file → its text.
        skills: Text of its skills instead of the shipped ones.
    """
    (folder / "agents").mkdir(parents=True)
    shutil.copy(TREES / "scene.yaml", folder)
    if skills:
        (folder / "skills").mkdir()
        (folder / "skills" / "voice.yaml").write_text(skills)
    else:
        shutil.copytree(TREES / "skills", folder / "skills")
    for name, text in agents.items():
        (folder / "agents" / f"{name}.yaml").write_text(text)
    return folder


def agent(tree: str, head: str = "") -> AgentSpec:
    """Return the agent of a tree; ``head`` adds top-level keys to its file."""
    text = (
        "format: 1\nagent: a\ntitle: A\ndescription: d\n"
        "profile: {age: 3, familiarity: 3, mood: 3}\n"
        + textwrap.dedent(head)
        + "\ntree:\n"
        + textwrap.indent(textwrap.dedent(tree), "  ")
    )
    return read_agent_text(text, "a.yaml", SYMBOLS)


class TreeHarness:
    """One run of a tree that a test ticks step by step.

    Args:
        tree: YAML text, or the tree that the reader would make of it.
        head: Additional top-level keys of the agent's file.
        answers: See :class:`ScriptedEnvironment`.
        awarded: The scene; None for an ordinary one.
        limits: See :class:`Run`.
        random: See :class:`Run`.
    """

    def __init__(
        self,
        tree: str | NodeSpec,
        *,
        head: str = "",
        answers: Mapping[str, Sequence[ScriptedReply]] | None = None,
        awarded: Scene | None = None,
        limits: RunLimits | None = None,
        random: Random | None = None,
    ) -> None:
        if isinstance(tree, NodeSpec):
            self.spec = replace(agent("wait: 0 s", head), tree=tree)
        else:
            self.spec = agent(tree, head)
        self.environment = ScriptedEnvironment(
            answers, result={"message": "", "answer": "yes", "accepted": True}
        )
        self.scene = awarded or scene(age=3, familiarity=3, mood=3)
        self.live = self.scene
        self.tunables: dict[str, Plain] = {t.name: t.default for t in self.spec.tunables}
        self.run = Run(
            self.spec,
            space=SPACE,
            scene=self.scene,
            profile=self.spec.profile,
            live=lambda: self.live,
            tunables=self.tunables,
            environment=self.environment,
            steady=self.environment.clock,
            limits=limits,
            random=random,
            on_visit=lambda node, status: self.ticked.append((node, status)),
            host="/agents",
        )
        self.ticked: list[tuple[Behaviour, Status]] = []
        self.changes: list[StatusChange] = []

    def tick(self, times: int = 1, step_s: float = 0.0) -> str:
        """Tick, advancing the clock before each tick but the first; return the status."""
        for number in range(times):
            if number:
                self.environment.clock.advance(step_s)
            self.ticked.clear()
            self.changes += self.run.tick()
        return self.outcome

    def after(self, seconds: float) -> str:
        """Advance the clock and tick once."""
        self.environment.clock.advance(seconds)
        return self.tick()

    def outcomes(self, *waits: float) -> str:
        """Tick after each of these times [s]; return the outcomes' letters, as in ``RRS``."""
        return "".join(self.after(wait)[0].upper() for wait in waits)

    def set_mood(self, mood: float) -> None:
        """Change the live mood."""
        self.set_live("mood", mood)

    def set_live(self, name: str, value: float) -> None:
        """Change a value of the live scene."""
        values = tuple(
            replace(v, value=value, origin=Origin.MEASURED) if v.name == name else v
            for v in self.live.values
        )
        self.live = replace(self.live, values=values)

    def interrupt(self) -> None:
        """Interrupt the tree from above; the next tick restarts it."""
        self.run.changes = []
        self.run._ticker(self.root).halt()
        self.changes += self.run.changes

    @property
    def root(self) -> Behaviour:
        """The outermost node."""
        return self.run.root

    def status(self, path: str) -> str:
        """Return the status of the node with this path, or with a path that ends so."""
        [found] = [
            node.status.name
            for node in self.root.iterate()
            if node.spec.path == path or node.spec.path.endswith(f"/{path}")
        ]
        return found

    def reports(self, path: str) -> list[tuple[str, str]]:
        """Return status and message of all changes of a node so far."""
        return [(c.status.name, c.message) for c in self.changes if c.path == path]

    @property
    def result(self) -> RunResult:
        """The result of the run, which has ended."""
        assert self.run.result is not None
        return self.run.result

    @property
    def message(self) -> str:
        """The reason for the run's outcome."""
        return self.result.message

    @property
    def outcome(self) -> str:
        """``running``, or the outcome of the run."""
        return self.run.result.outcome.value if self.run.result else "running"

    @property
    def said(self) -> list[Plain]:
        """Texts of all ``say`` goals so far, in order."""
        return [g.goal.fields["text"] for g in self.environment.goals if g.goal.name == "say"]

    @property
    def asked(self) -> list[str]:
        """Names of all goals and requests so far, in order."""
        return [g.goal.name for g in self.environment.goals]


def started(tree: str | NodeSpec, **how: Any) -> TreeHarness:
    """Return the run of a tree after its first tick; see :class:`TreeHarness`."""
    harness = TreeHarness(tree, **how)
    harness.tick()
    return harness


def failure(tree: str | NodeSpec, **how: Any) -> str:
    """Return why a tree fails at its first tick; see :class:`TreeHarness`."""
    harness = started(tree, **how)
    assert harness.outcome == "failed"
    return harness.message
