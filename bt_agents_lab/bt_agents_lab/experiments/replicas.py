# SPDX-License-Identifier: Apache-2.0
"""Runs of one experiment that differ only in their seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.experiments.random_streams import RandomStreams, draw
from bt_agents_lab.experiments.simulated_world import Arm, SimulatedWorld
from bt_agents_lab.experiments.simulation import Course, simulate
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_language.model.experiment import ExperimentSpec, FeedbackErrors


@dataclass(frozen=True, kw_only=True, eq=False)
class Replicas:
    """Runs of one experiment, with their world and randomness."""

    world: SimulatedWorld
    streams: RandomStreams
    course: Course


def opened(path: Path) -> tuple[Trees, ExperimentSpec]:
    """Read the agents and the experiment of a folder.

    Raises:
        BtAgentsError: A file cannot be read; the message lists the problems. Or an agent with
            feedback does not exist.
    """
    folder = read_trees(path)
    if folder.broken:
        raise BtAgentsError(folder.broken[0].error.report)
    file = path / "experiment.yaml"
    spec = read_experiment(file, folder.scene.space)
    names = [agent.name for agent in folder.agents]
    for name in (*spec.feedback.each, *spec.feedback.sequences):
        if name not in names:
            raise BtAgentsError(
                f"{file}: there is feedback for '{name}', which is no agent of it; "
                f"{did_you_mean(name, names)}"
            )
    return folder, spec


def world_of(folder: Trees, spec: ExperimentSpec) -> SimulatedWorld:
    """Return the world of an experiment.

    Raises:
        BtAgentsError: It has an agent without its own feedback under ``each``.
    """
    agents = sorted(folder.agents, key=lambda agent: agent.name)
    without = [agent.name for agent in agents if agent.name not in spec.feedback.each]
    if without:
        raise BtAgentsError(
            f"{spec.title}: 'each' has no feedback for {', '.join(without)}; sweeps and figures "
            "need one for each agent"
        )
    space = folder.scene.space.profiles
    return SimulatedWorld(
        space=space,
        agents=tuple(agent.name for agent in agents),
        starts=np.array([agent.profile for agent in agents], np.float64),
        best=np.array([spec.feedback.each[agent.name] for agent in agents], np.float64),
        scenes=np.array(list(dict.fromkeys(one[: len(space)] for one in spec.scenes)), np.float64),
        rates=np.array([agent.learning_rate for agent in agents]),
    )


def streams_of(world: SimulatedWorld, spec: ExperimentSpec, seeds: Sequence[int]) -> RandomStreams:
    """Return the randomness of some runs, as the experiment draws it with each seed."""
    streams = draw(world, seeds, spec.rounds)
    places = {tuple(scene): index for index, scene in enumerate(world.scenes.tolist())}
    streams.error_draw[:] = 1.0
    for row, seed in enumerate(seeds):
        seeded = with_seed(spec, seed)
        streams.scene[row] = [places[scene[: len(world.space)]] for scene in seeded.order()]
        if seeded.feedback.errors is None:
            continue
        for index in range(spec.rounds):
            wrong = seeded.feedback.errors.instead(index)
            if wrong is not None:
                streams.error_draw[row, index], streams.wrong[row, index] = 0.0, wrong
    return streams


def with_seed(spec: ExperimentSpec, seed: int) -> ExperimentSpec:
    """Return an experiment with another seed."""
    errors = spec.feedback.errors
    return with_errors(
        replace(spec, seed=seed), None if errors is None else replace(errors, seed=seed)
    )


def with_errors(spec: ExperimentSpec, errors: FeedbackErrors | None) -> ExperimentSpec:
    """Return an experiment with other wrong feedback."""
    return replace(spec, feedback=replace(spec.feedback, errors=errors))


def replicas(
    world: SimulatedWorld, spec: ExperimentSpec, seeds: Sequence[int], arm: Arm | None = None
) -> Replicas:
    """Play an experiment once for each seed, in its world or a variant of it.

    Without an arm, agents are selected and learn as in the paper.
    """
    streams = streams_of(world, spec, seeds)
    # Feedback is wrong where the draw is 0, right where it is 1.
    return Replicas(
        world=world, streams=streams, course=simulate(world, arm or Arm(), streams, 0.5)
    )
