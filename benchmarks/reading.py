# SPDX-License-Identifier: Apache-2.0
"""How long agent files take to read and check, beside the bare YAML parser in the same run.

``python benchmarks/reading.py`` prints the table, with ``--profile`` also where the time goes.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml

from bt_agents.language.agent_reader import read_agent_text
from bt_agents.language.folder_reader import read_vocabulary
from bt_agents.language.linting.lint import lint
from bt_agents.language.scene_reader import read_scene
from bt_agents.language.specs import AgentSpec, NodeSpec
from bt_agents.language.vocabulary import Vocabulary

TREES = Path(__file__).parents[1] / "trees"
REPETITIONS = 9
HEAD = """\
format: 1
agent: benchmark
title: Benchmark
profile: {age: 4.0, familiarity: 1.5, mood: 3.0}
tunables:
  voice_rate: {default: 0.9, min: 0.5, max: 1.5, step: 0.05, description: speed of speech}
  patience: {default: 8 s, min: 2 s, max: 30 s, description: how long to wait for an answer}
tree:
  sequence:
"""
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
"""A selector, a sequence, four leaves and three modifiers."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A file that is read.

    Attributes:
        nodes: Nodes of its tree, modifiers counted.
        goal_s: It should not take longer [s].
        text: Its content.
    """

    nodes: int
    goal_s: float
    text: str


def case(nodes: int, goal_s: float) -> Case:
    """Return a file with so many nodes."""
    steps, rest = divmod(nodes - 1, NODES_OF_STEP)
    text = HEAD + "".join(STEP.format(number=number) for number in range(steps))
    return Case(nodes=nodes, goal_s=goal_s, text=text + "    - light: green\n" * rest)


def count(spec: NodeSpec) -> int:
    """Return the number of nodes of a tree."""
    return 1 + sum(count(child) for child in spec.children)


def read(text: str, vocabulary: Vocabulary) -> AgentSpec:
    """Read and check a file as ``bt-agents check`` does."""
    agent = read_agent_text(text, "benchmark.yaml", vocabulary)
    lint(agent)
    return agent


def parse(text: str) -> None:
    """Take every event of the YAML parser, nothing more."""
    for _ in yaml.parse(text, Loader=yaml.CSafeLoader):
        pass


def seconds(call: Callable[[], object]) -> float:
    """Return how long one call takes [s]."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def spread(times: list[float]) -> str:
    """Return median and range of times, in milliseconds."""
    milli = [t * 1e3 for t in times]
    return f"{statistics.median(milli):9.2f}  [{min(milli):.2f} … {max(milli):.2f}]"


def measure(one: Case, vocabulary: Vocabulary) -> None:
    """Measure one case and print it; both are taken in turn, so that a busy machine slows both."""
    read(one.text, vocabulary)
    parse(one.text)
    ours: list[float] = []
    bare: list[float] = []
    for _ in range(REPETITIONS):
        ours.append(seconds(lambda: read(one.text, vocabulary)))
        bare.append(seconds(lambda: parse(one.text)))
    ratio = statistics.median(ours) / statistics.median(bare)
    met = "met" if statistics.median(ours) <= one.goal_s else "MISSED"
    print(
        f"{one.nodes:6,}{len(one.text) / 1024:8.1f}   {spread(ours):30}   {spread(bare):28}"
        f"{ratio:7.1f}   {one.goal_s * 1e3:6.0f}  {met}"
    )


def main() -> None:
    """Measure and print every case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--profile", action="store_true", help="also show where the time goes")
    chosen = parser.parse_args()
    vocabulary = read_vocabulary(TREES, read_scene(TREES / "scene.yaml"))
    cases = (case(20, 0.010), case(200, 0.100), case(2_000, 1.0))
    for one in cases:
        nodes = count(read(one.text, vocabulary).tree)
        if nodes != one.nodes:
            raise SystemExit(f"the file for {one.nodes} nodes has {nodes}")
    print(f"{REPETITIONS} times each, median [fastest … slowest]")
    print(
        f"{'nodes':>6}{'KiB':>8}   {'read and checked, ms':30}   {'YAML parser alone, ms':28}"
        f"{'ratio':>7}   {'goal':>6}"
    )
    for one in cases:
        measure(one, vocabulary)
    if chosen.profile:
        with cProfile.Profile() as profile:
            read(cases[-1].text, vocabulary)
        pstats.Stats(profile).sort_stats("tottime").print_stats(20)


if __name__ == "__main__":
    main()
