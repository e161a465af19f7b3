# SPDX-License-Identifier: Apache-2.0
"""One run of a simulated world by the code of the nodes: slow, but certain."""

from __future__ import annotations

from dataclasses import dataclass, field

from bt_agents_core.feedback import MOOD_RULE, FeedbackKind
from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_lab.experiments.random_streams import RandomStreams, round_seed
from bt_agents_lab.experiments.simulated_world import Arm, Person, SimulatedWorld
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from bt_agents_language.model.mood_rule import MoodAction, MoodRule
from feedback_node.learning import learning_step
from feedback_node.rules import Watch
from marketplace_node.round.ranking import decide
from ranked_rounds import bids, terms
from scene_spaces import scene_of


@dataclass
class Lived:
    """Results of one run, round by round."""

    awarded: list[int] = field(default_factory=list)
    cancelled: list[int] = field(default_factory=list)
    profiles: list[tuple[Vector, ...]] = field(default_factory=list)


def live(
    world: SimulatedWorld, arm: Arm, luck: RandomStreams, row: int, wrong_share: float
) -> Lived:
    """Play one of the runs of ``luck``."""
    space = world.space
    profiles: dict[str, Vector] = dict(
        zip(world.agents, (tuple(start) for start in world.starts.tolist()), strict=True)
    )
    authored = dict(profiles)
    recent: dict[str, list[Vector]] = {agent: [] for agent in world.agents}
    changes = dict.fromkeys(world.agents, 0)
    runs: dict[str, int] = {}
    last_run: dict[str, int] = {}
    lived = Lived()

    def learn(agent: str, kind: FeedbackKind, target: Vector, weight: float) -> None:
        step = learning_step.step(
            kind,
            profiles[agent],
            target,
            rate=float(world.rates[world.agents.index(agent)]),
            space=space,
            rule=arm.rule,
            weight=weight,
            recent=tuple(recent[agent][-arm.rule.window :]),
            changes=changes[agent],
            authored=authored[agent],
        )
        recent[agent].append(step.requested)
        changes[agent] += 1
        profiles[agent] = step.after

    for index in range(luck.scene.shape[1]):
        place = int(luck.scene[row, index])
        vector = tuple(world.scenes[place].tolist())
        tried: dict[str, str] = {}
        cancelled = 0
        best, misfit = world.best_in(index), world.misfit_in(index)
        for attempt in range(world.attempts):
            bidders = [
                agent
                for agent in world.agents
                if agent not in tried and world.absent.get(agent, 0) <= index
            ]
            if not bidders:
                break
            of_round = terms(
                scene_of(space, vector),
                round=index + 1,
                strategy=arm.strategy,
                tie_break=arm.tie_break,
                last_run=dict(last_run),
                runs=dict(runs),
                rounds_run=sum(runs.values()),
                options=arm.options,
                seed=round_seed(luck.seeds[row], index, attempt),
            )
            accepted = bids({agent: profiles[agent] for agent in bidders})
            winner = decide(space, of_round, accepted).bids[0].agent
            chosen = world.agents.index(winner)
            if attempt == 0:
                lived.awarded.append(chosen)
            runs[winner] = runs.get(winner, 0) + 1
            last_run[winner] = sum(runs.values())
            tried[winner] = "was stopped"
            wrong = luck.error_draw[row, index, attempt] < wrong_share
            if world.person is None:
                told = luck.wrong[row, index] if wrong else best[chosen]
                learn(winner, FeedbackKind.DIRECT, tuple(told.tolist()), 1.0)
                break
            fit = 1.0 - float(misfit[place, chosen]) / world.person.tolerance
            fit = min(max(fit, -1.0), 1.0)
            if wrong:
                fit = float(luck.wrong_fit[row, index, attempt])
            noise = [float(value) for value in luck.mood_noise[row, index, attempt]]
            fired, mood = react(world.person, space, vector, fit, noise)
            for kind in fired:
                learn(winner, kind, vector, arm.rule.weight(MOOD_RULE))
            if FeedbackKind.NEGATIVE not in fired:
                break
            cancelled += 1
            assert space.mood is not None
            at = space.names.index(space.mood)
            vector = (*vector[:at], mood, *vector[at + 1 :])
        lived.cancelled.append(cancelled)
        lived.profiles.append(tuple(profiles[agent] for agent in world.agents))
    return lived


def react(
    person: Person, space: SceneSpace, vector: Vector, fit: float, noise: list[float]
) -> tuple[list[FeedbackKind], float]:
    """Let the mood rules watch a person; return their feedback and the last mood."""
    now = 0.0
    watch = Watch(rules(person, space), scene_of(space, vector), space, lambda: now)
    assert space.mood is not None
    at = space.names.index(space.mood)
    limits = space.parameters[at]
    mood, given = vector[at], []
    for other in noise:
        now += 1.0
        change = person.drift * fit + other * person.noise
        mood = min(max(mood + change, limits.minimum), limits.maximum)
        fired = watch.receive(scene_of(space, (*vector[:at], mood, *vector[at + 1 :])))
        given += [one.rule.give for one in fired]
        stops = [one for one in fired if one.rule.action is MoodAction.CANCEL]
        if stops:
            return given, stops[0].live.vector[at]
    return given, mood


def rules(person: Person, space: SceneSpace) -> list[MoodRule]:
    """Return the mood rules of every agent."""
    better, worse = f"mood.change >= {person.better}", f"mood.change <= -{person.worse}"
    return [
        restore_mood_rule(space, when=better, hold_s=person.hold_s, give=FeedbackKind.POSITIVE),
        restore_mood_rule(
            space,
            when=worse,
            hold_s=person.hold_s,
            give=FeedbackKind.NEGATIVE,
            action=MoodAction.CANCEL,
        ),
    ]
