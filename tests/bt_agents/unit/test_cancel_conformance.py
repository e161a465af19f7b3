# SPDX-License-Identifier: Apache-2.0
"""Every shipped agent, cancelled at any tick, ends once and leaves no goal running."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from random import Random

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.run import Run, RunLimits, RunResult, TreeOutcome
from bt_agents.engine.scripted_environment import ScriptedEnvironment, ScriptedReply
from bt_agents_core.scene import Scene
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.model.specs import CLEAN_UP_S, AgentSpec, iter_nodes
from tree_harness import SPACE, TREES, scene

AGENTS = read_trees(TREES).agents
SEEDS = range(3)
LIMITS = RunLimits(settle_s=2.0)
STEP_S = 5.0
MOST_TICKS = 120
EPSILON_S = 0.01
WORDS = ["yes", "no", "good", "bad", "room 12", ""]

Server = Callable[[Random], ScriptedReply]


def _ends(random: Random) -> GoalState:
    return random.choices([GoalState.SUCCEEDED, GoalState.ABORTED], [7, 1])[0]


def quick(random: Random) -> ScriptedReply:
    return ScriptedReply(state=_ends(random), after_s=random.choice([0.0, 0.3, 2.0, 40.0]))


def late(random: Random) -> ScriptedReply:
    """Server that takes its time to accept, to end and to stop."""
    accept_s = random.choice([0.2, 1.0, 1.9])
    return ScriptedReply(
        state=_ends(random),
        accept_s=accept_s,
        after_s=accept_s + random.choice([0.3, 40.0]),
        cancel_s=random.choice([0.0, 0.05]),
    )


def rejecting(random: Random) -> ScriptedReply:
    if random.random() < 0.2:
        delay_s = random.choice([0.0, 0.5])
        return ScriptedReply(state=GoalState.REJECTED, accept_s=delay_s, after_s=delay_s)
    return quick(random)


def stubborn(random: Random) -> ScriptedReply:
    """Server that ignores cancels and often runs for ever."""
    return ScriptedReply(after_s=random.choice([0.5, math.inf]), cancel_s=math.inf)


SERVERS = [quick, late, rejecting, stubborn]


class World(ScriptedEnvironment):
    """Random answers, the same for the same seed."""

    def __init__(self, server: Server, seed: int) -> None:
        super().__init__()
        self.random = Random(seed)
        self._server = server

    def _answer(self, name: str) -> ScriptedReply:
        random = self.random
        result = {"message": "", "answer": random.choice(WORDS), "accepted": True}
        # Every agent begins with the light; most runs should get further.
        easy = name == "set_light" and random.random() < 0.9
        return replace(ScriptedReply() if easy else self._server(random), result=result)


def scene_of(random: Random) -> Scene:
    values = {one.name: random.uniform(one.minimum, one.maximum) for one in SPACE.parameters}
    return scene("s", random.random() < 0.9, **values)


class Performance:
    """A run whose clock jumps from one relevant moment to the next."""

    def __init__(self, agent: AgentSpec, server: Server, seed: int) -> None:
        self.server = server
        self.random = Random(seed)
        self.environment = World(server, seed)
        self.scene = self.live = scene_of(self.random)
        self.visited: set[str] = set()
        self.run = Run(
            agent,
            space=SPACE,
            scene=self.scene,
            profile=agent.profile,
            live=lambda: self.live,
            tunables={tunable.name: tunable.default for tunable in agent.tunables},
            environment=self.environment,
            steady=self.environment.clock,
            limits=LIMITS,
            random=Random(seed),
            on_visit=lambda node, _status: self.visited.add(node.spec.path),
        )

    @property
    def over(self) -> bool:
        return self.run.result is not None

    def move_on(self) -> None:
        """Advance the time until something changes, and let people act."""
        now = self.environment.clock.now
        moments = [goal.next_change for goal in self.environment.goals]
        moments += [at for at in self.run.deadlines.values() if at > now]
        moments += [self.run.deadline, now + STEP_S]
        self.environment.clock.now = max(min(moments), now + 0.001)
        if self.random.random() < 0.3:
            self.live = scene_of(self.random)
        if self.random.random() < 0.3:
            self.environment.arrive("buttons/confirm", {"data": self.random.random() < 0.5})

    def until(self, ticks: int) -> None:
        """Continue until a number of ticks, or until it has ended."""
        while self.run.ticks < ticks and not self.over:
            if self.run.ticks:
                self.move_on()
            self.run.tick()

    def wind_up(self) -> float:
        """Continue until it has ended; return how long that took [s]."""
        began = self.environment.clock.now
        while not self.over:
            self.move_on()
            self.run.tick()
        return self.environment.clock.now - began


def check_end(performance: Performance, took_s: float) -> RunResult:
    run, environment = performance.run, performance.environment
    result = run.result
    assert result is not None
    running = sorted(g.goal.sender for g in environment.goals if not g.confirmed)
    assert sorted(result.orphans) == running
    if performance.server is not stubborn:
        assert running == []
    assert took_s <= CLEAN_UP_S + LIMITS.settle_s + EPSILON_S
    cleaned = Counter(
        g.goal.sender for g in environment.goals if g.goal.sender.startswith("on_cancel")
    )
    assert all(times == 1 for times in cleaned.values())
    asked = len(environment.goals)
    run.cancel("again")
    for _ in range(3):
        environment.clock.advance(1.0)
        assert run.tick() == []
    assert run.result is result
    assert len(environment.goals) == asked
    return result


@pytest.mark.parametrize("server", SERVERS, ids=lambda server: server.__name__)
@pytest.mark.parametrize("agent", AGENTS, ids=lambda agent: agent.name)
def test_cancel_at_any_tick_ends_run_cleanly(agent: AgentSpec, server: Server) -> None:
    for seed in SEEDS:
        whole = Performance(agent, server, seed)
        whole.until(MOST_TICKS)
        for ticks in range(whole.run.ticks + 1):
            cut = Performance(agent, server, seed)
            cut.until(ticks)
            ended_before = cut.over
            before = cut.run.tip if ticks else ""
            cut.run.cancel("enough")
            result = check_end(cut, cut.wind_up())
            if not ended_before and result.outcome is TreeOutcome.CANCELLED:
                assert result.message == "enough"
                assert result.tip == before


def test_cancels_cover_most_tree_branches() -> None:
    missed = []
    nodes = 0
    for agent in AGENTS:
        paths = {spec.path for spec in iter_nodes(agent.tree)}
        nodes += len(paths)
        for server, seed in product(SERVERS, SEEDS):
            whole = Performance(agent, server, seed)
            whole.until(MOST_TICKS)
            paths -= whole.visited
        missed += [f"{agent.name}: {path}" for path in sorted(paths)]
    assert len(missed) <= nodes * 0.1, missed
