# SPDX-License-Identifier: Apache-2.0
"""Measures reading, checking and building of agent files against a YAML parser on the same text.

Every file is read as the first one of a process: no parsed condition is cached.
"""

from __future__ import annotations

import gc
import random
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import yaml
from py_trees.behaviour import Behaviour

from bt_agents.engine.context import RunContext
from bt_agents.engine.run import build
from bt_agents.engine.scope import RunScope
from bt_agents.engine.scripted_environment import ScriptedEnvironment
from bt_agents_core.scene import Scene, SceneValue
from bt_agents_language.fields import scope as names
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import read_symbols, read_trees, yaml_files
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tools.lint import cut_texts, lint
from bt_agents_language.yaml.source import Source
from measuring import Effort, Row, Way, in_turn

TREES = Path(__file__).parents[1] / "trees"
WHOLE, READ = "read, check, build", "read, check"
SAFE = "PyYAML SafeLoader"
SIZES = (20, 200, 2_000, 5_000)
SHORT_SIZES = (20, 200)
LARGE = 5_000
GOAL = 0.25
LEAST_S = 0.02
"""A measurement repeats shorter calls until it takes this long [s]."""

HEAD = """\
format: 1
agent: benchmark
title: Benchmark
profile: {age: 4.0, familiarity: 1.5, mood: 3.0}
tunables:
  voice_rate: {default: 0.9, min: 0.5, max: 1.5, step: 0.05, description: speed of speech}
  patience: {default: 8 s, min: 2 s, max: 30 s, description: how long to wait for an answer}
"""
TREE = "tree:\n  sequence:\n"
LEAF = "    - light: green\n"
STEP = """\
    - name: step {number}
      timeout: 90 s
      selector:
        - sequence:
            - check: scene.age >= 4 and live.mood > 2
            - say: {{text: "Step {number} of ${{scene.age}}.", rate: "${{voice_rate}}"}}
        - ask: {{text: "Shall we go on?", choices: ["yes", "no"], wait: "${{patience}}"}}
          retry: 2
          on_failure: {{show: {{text: Nobody has answered., duration: 3 s}}}}
"""
NODES_OF_STEP = 9
"""Nodes of a step: a selector, a sequence, four leaves and three decorators."""

VARIED_STEP = """\
    - name: {word} {number}
      timeout: {number}.5 s
      selector:
        - sequence:
            - check: scene.age >= {number} / 1000 and live.mood > {number} or scene.{parameter} < 3
            - say: {{text: "{word} {number}, ${{scene.age + {number}}} years.", rate: 0.{number}}}
        - ask: {{text: "{word} {number}?", choices: ["yes {number}", "no"], wait: {number} ms}}
          retry: {few}
          on_failure: {{show: {{text: {word} number {number}., duration: {number} s}}}}
"""
"""The same, with every text, number and condition different."""

SUBTREE = """\
  part_{number}:
    inputs: {{clip: text}}
    tree:
      sequence:
        - show: {{clip: "${{clip}}"}}
        - say: Part {number}.
          when: scene.mood > 2
"""
CALL = "    - {{subtree: part_{number}, with: {{clip: clip_{number}}}}}\n"
NODES_OF_CALL = 5


def measure(effort: Effort) -> Iterator[Row]:
    """Compare files of several kinds and sizes, and the folder of trees.

    Raises:
        RuntimeError: A file does not have its expected meaning.
    """
    symbols = read_symbols(TREES)
    for nodes in SHORT_SIZES if effort.is_short else SIZES:
        goal = GOAL if nodes == LARGE else None
        yield _compared(f"mixture, {nodes:,} nodes", mixture(nodes), nodes, goal, symbols, effort)
    nodes = SHORT_SIZES[-1] if effort.is_short else LARGE
    for what, text, note in (
        ("nothing twice", varied(nodes), "a quarter of it parses conditions, each another one"),
        ("subtrees", subtrees(nodes), ""),
    ):
        case = f"{what}, {nodes:,} nodes"
        yield _compared(case, text, nodes, GOAL, symbols, effort, note)
    yield _folder(effort)


def mixture(nodes: int) -> str:
    """Return a file with a number of nodes, similar to an author's."""
    steps, rest = divmod(nodes - 1, NODES_OF_STEP)
    text = "".join(STEP.format(number=number) for number in range(steps))
    return HEAD + TREE + text + LEAF * rest


def varied(nodes: int) -> str:
    """Return a file with a number of nodes that has hardly any repetition."""
    steps, rest = divmod(nodes - 1, NODES_OF_STEP)
    source = random.Random(1)
    text = "".join(
        VARIED_STEP.format(
            number=number + 10,
            few=number % 9 + 1,
            word="".join(source.choices("aeioulmnrst", k=9)),
            parameter=("age", "familiarity", "mood")[number % 3],
        )
        for number in range(steps)
    )
    return HEAD + TREE + text + LEAF * rest


def subtrees(nodes: int) -> str:
    """Return a file with a number of nodes, most of them in subtrees that are called once."""
    calls, rest = divmod(nodes - 1, NODES_OF_CALL)
    called = "".join(CALL.format(number=number) for number in range(calls))
    parts = "".join(SUBTREE.format(number=number) for number in range(calls))
    return HEAD + TREE + called + LEAF * rest + "subtrees:\n" + parts


def _way(call: Callable[[], object]) -> Way:
    """Return a way that repeats a call often enough to measure it."""

    def way() -> float:
        gc.collect()
        times = 0
        began = time.thread_time()
        while True:
            call()
            times += 1
            took = time.thread_time() - began
            if took >= LEAST_S:
                return took / times

    return way


def _compared(
    case: str,
    text: str,
    nodes: int,
    goal: float | None,
    symbols: SymbolTable,
    effort: Effort,
    note: str = "",
) -> Row:
    whole = partial(_whole, text, symbols)
    found = sum(1 for _ in whole().iterate())
    if found != nodes:
        raise RuntimeError(f"{case}: the tree has {found} nodes")
    parse = partial(yaml.load, text, Loader=yaml.SafeLoader)
    values = in_turn({WHOLE: _way(whole), SAFE: _way(parse)}, effort)
    return Row.beside(values, WHOLE, SAFE, case=case, goal=goal, note=note)


def _whole(text: str, symbols: SymbolTable) -> Behaviour:
    """Read and check a file as ``bt-agents check`` does, and build its tree as a run does."""
    _forget()
    agent = read_agent(Source("benchmark.yaml", text), symbols)
    lint(agent)
    tuple(cut_texts(Source(agent.file, text)))
    values = tuple(SceneValue.missing(name) for name in symbols.space.names)
    scene = Scene(scene_id="benchmark", label="", person=True, values=values)
    scope = RunScope(
        space=symbols.space,
        scene=scene,
        live=lambda: scene,
        profile=agent.profile,
        tunables={one.name: one.default for one in agent.tunables},
    )
    return build(agent.tree, RunContext(ScriptedEnvironment(), scope, random.Random(1)))


def _forget() -> None:
    """Clear the cache of parsed conditions."""
    names._parsed.cache_clear()


def _folder(effort: Effort) -> Row:
    """Compare the folder, read as a host reads it at its start."""
    agents = [path for path in yaml_files(TREES / "agents") if ".test." not in path.name]
    libraries = [*(TREES / "skills").glob("*.yaml"), *(TREES / "libraries").glob("*.yaml")]
    files = [TREES / "scene.yaml", *libraries, *agents]
    if len(read_trees(TREES).agents) != len(agents):
        raise RuntimeError("an agent of the folder cannot be read")

    def parse() -> None:
        for path in files:
            yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)

    def read() -> None:
        _forget()
        read_trees(TREES)

    values = in_turn({READ: _way(read), SAFE: _way(parse)}, effort)
    return Row.beside(values, READ, SAFE, case=f"trees/, {len(files)} files")
