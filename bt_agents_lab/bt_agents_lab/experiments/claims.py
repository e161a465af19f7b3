# SPDX-License-Identifier: Apache-2.0
"""Claims of the paper about its experiments, judged by many runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import yaml

from bt_agents_lab.experiments.measures import converged, right
from bt_agents_lab.experiments.replicas import Replicas, replicas, with_errors, world_of
from bt_agents_lab.experiments.simulated_world import Arm, Bools, Floats
from bt_agents_lab.experiments.verdicts import Claim, ClaimVerdict, judged, percent
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.experiment import ExperimentSpec, FeedbackErrors

RATES = {"conservative": 0.05, "moderate": 0.2, "aggressive": 0.5}
REACHED = 0.05
"""A profile has arrived within this Manhattan distance, in the units of the parameters."""

LATE = 100
"""A profile should be stable for this number of rounds at the end of a run."""

JUDGED = 300
"""Minimum number of rounds for judging Experiment 3."""

NEAR = 0.25
"""Distance within which a value counts as near its target: a sixteenth of the range."""

JUMP = 1.0
"""Change of a parameter that counts as abrupt: a quarter of its range."""


@dataclass(frozen=True, kw_only=True)
class Paper:
    """One experiment of the paper: its agents and its specification."""

    folder: Trees
    spec: ExperimentSpec


def first(experiment: Paper) -> list[ClaimVerdict]:
    """Judge the claims about Experiment 1."""
    world = world_of(experiment.folder, experiment.spec)
    runs = {
        name: replicas(replace(world, rates=np.array([rate])), experiment.spec, [0])
        for name, rate in {"as in the file": float(world.rates[0]), **RATES}.items()
    }
    ends = {name: float(_distance(one)[0, -1]) for name, one in runs.items()}
    cycles = {name: _arrival(_distance(one)[0]) for name, one in runs.items()}
    own = "as in the file"
    arrived = f"below {REACHED:g} from cycle {cycles[own]:g} on"
    return [
        _judged(
            "Convergence",
            [ends[own] < REACHED],
            f"distance {ends[own]:.2g} after {experiment.spec.rounds} cycles at rate "
            f"{world.rates[0]:g}, "
            f"{f'never below {REACHED:g}' if math.isinf(cycles[own]) else arrived}; every round "
            "equals the closed form p = f + (p0 - f)(1 - rate)^n. Without wrong feedback nothing "
            "is left to chance.",
        ),
        _judged(
            "Speed follows the rate",
            [cycles["conservative"] > cycles["moderate"] > cycles["aggressive"]],
            ", ".join(f"{_counted(cycles[n])} at rate {rate:g}" for n, rate in RATES.items()),
        ),
    ]


def second(arms: Mapping[str, Paper], seeds: Sequence[int]) -> list[ClaimVerdict]:
    """Judge the claims about Experiment 2, with three scenarios named as in :data:`RATES`."""
    any_arm = arms["moderate"]
    few = any_arm.spec.feedback.errors
    third = arms["aggressive"].spec.feedback.errors
    assert few is not None
    assert third is not None
    random_errors = replace(third, every=0, share=1 / third.every)
    rare = {name: _played(any_arm, rate, few, seeds) for name, rate in RATES.items()}
    often = {name: _played(any_arm, rate, random_errors, seeds) for name, rate in RATES.items()}
    regular = {name: _played(any_arm, rate, third, seeds[:1]) for name, rate in RATES.items()}
    return [
        _conservative(
            rare["conservative"], _played(any_arm, RATES["conservative"], None, seeds[:1])
        ),
        _aggressive(often, regular),
        _abrupt(often["aggressive"], random_errors),
        _moderate(rare["moderate"]),
        _balance(rare),
        _robust(often, regular),
        _stability(rare),
    ]


def played_third(experiment: Paper, seeds: Sequence[int]) -> Replicas:
    """Play Experiment 3 with random ties; the paper leaves open which of equal bids wins."""
    spec = experiment.spec.shortened(max(experiment.spec.rounds, JUDGED))
    return replicas(world_of(experiment.folder, spec), spec, seeds, Arm(tie_break="random"))


def third(runs: Replicas) -> list[ClaimVerdict]:
    """Judge the claims about Experiment 3."""
    world = runs.world
    correct = right(world, runs.streams, runs.course)
    start = np.abs(world.starts - world.best).sum(axis=-1)
    end = np.abs(runs.course.profiles[:, -1] - world.best).sum(axis=-1)
    adjusted = (end < start).all(axis=1)
    early, late = correct[:, :20].mean(axis=1), correct[:, -LATE:].mean(axis=1)
    starved = ~runs.course.all_ran
    settled = converged(correct)
    starvation = (
        f"in {percent(float(starved.mean()))} of runs an agent never runs: when agents 1 and 3 "
        "have run before agent 5, agent 3 is nearer to [5, 5, 5] than an agent that still stands "
        "at [2.5, 2.5, 2.5], and stays so for ever. With random ties agent 5 is the last of the "
        "three in exactly one of three runs, whatever the order of the scenes; with a fixed order "
        "of the agents two of the six orders do that in every run, also the default of the market"
    )
    return [
        _judged(
            "Agents move to what they are made for",
            adjusted,
            f"mean distance {end.mean():.2g} at the end, {start.mean():.2g} at the start",
            starvation,
            rounds=correct.shape[1],
        ),
        _judged(
            "Selection becomes targeted",
            (late >= 0.99) & (late >= early),
            f"right selections: {percent(float(early.mean()))} of the first 20 scenes, "
            f"{percent(float(late.mean()))} of the last {LATE}; median of {np.median(settled):g} "
            "rounds until it stays right",
            starvation,
        ),
    ]


def _conservative(runs: Replicas, quiet: Replicas) -> ClaimVerdict:
    late = _gap(runs)[:, -LATE:]
    slow = _arrival(_distance(quiet)[0])
    return _judged(
        "A low rate is slow but stable",
        np.abs(late).max(axis=(1, 2)) <= 0.5,
        f"largest distance of a parameter in the last {LATE} cycles: median "
        f"{np.median(np.abs(late).max(axis=(1, 2))):.2f}; without noise {_counted(slow)} to a "
        f"Manhattan distance below {REACHED:g}",
    )


def _aggressive(often: Mapping[str, Replicas], regular: Mapping[str, Replicas]) -> ClaimVerdict:
    swing = {name: _swing(runs) for name, runs in often.items()}
    own = {name: float(_swing(runs)[0]) for name, runs in regular.items()}
    return _judged(
        "A high rate fluctuates",
        (swing["aggressive"] > JUMP) & (swing["aggressive"] > swing["conservative"]),
        f"median swing {np.median(swing['aggressive']):.2f} at rate {RATES['aggressive']:g}, "
        f"{np.median(swing['conservative']):.2f} at rate {RATES['conservative']:g}; when exactly "
        f"each third is 5: {own['aggressive']:.2f} and {own['conservative']:.2f}",
    )


def _abrupt(runs: Replicas, errors: FeedbackErrors) -> ClaimVerdict:
    wrong = runs.streams.error_draw[:, :, 0] == 0.0
    twice = wrong[:, :-1] & wrong[:, 1:]
    values = np.concatenate(
        [np.repeat(runs.world.starts[None, None], len(wrong), 0), runs.course.profiles], axis=1
    )[:, :, 0]
    rises = (values[:, 2:] - values[:, :-2]).max(axis=-1)
    # Start from a settled profile: the first ten cycles rise anyway.
    settled = np.arange(twice.shape[1]) >= 10
    events = twice & settled & (values[:, :-2, -1] < 2.0)
    jumps = rises[events]
    return _judged(
        "Two wrong feedbacks in a row shift it abruptly",
        jumps >= JUMP,
        f"{len(jumps)} such pairs, median rise {np.median(jumps):.2f}. With exactly each third "
        "feedback wrong there are no two in a row; so 'every third' has to mean one of three by "
        f"chance ({percent(errors.share)})",
        unit="pairs",
    )


def _moderate(runs: Replicas) -> ClaimVerdict:
    late = np.abs(_gap(runs)[:, -LATE:].mean(axis=1)).max(axis=-1)
    outer = np.abs(_gap(runs)[:, -LATE:]).max(axis=(1, 2))
    return _judged(
        "A moderate rate converges near the truth",
        late <= NEAR,
        f"largest deviation of such a mean: median {np.median(late):.2f}; but single values are "
        f"up to {np.median(outer):.2f} away in the median run, so 'stable' holds on average only",
    )


def _balance(rare: Mapping[str, Replicas]) -> ClaimVerdict:
    squared = {n: (_gap(runs) ** 2).sum(axis=-1).mean(axis=1) for n, runs in rare.items()}
    plain = {n: _distance(runs).mean() for n, runs in rare.items()}
    best = (squared["moderate"] < squared["conservative"]) & (
        squared["moderate"] < squared["aggressive"]
    )
    return _judged(
        "A moderate rate is the best balance",
        best,
        "mean squared distance "
        + ", ".join(f"{squared[n].mean():.2f} at rate {rate:g}" for n, rate in RATES.items())
        + ". By the mean Manhattan distance the high rate is best: "
        + ", ".join(f"{plain[n]:.2f} at rate {rate:g}" for n, rate in RATES.items()),
    )


def _robust(often: Mapping[str, Replicas], regular: Mapping[str, Replicas]) -> ClaimVerdict:
    means = {n: runs.course.profiles[:, -LATE:, 0].mean(axis=1) for n, runs in often.items()}
    off = {n: np.abs(means[n] - often[n].world.best[0]).max(axis=-1) for n in RATES}
    exact = regular["moderate"].course.profiles[0, -99:, 0].mean(axis=0)
    goal = ", ".join(f"{value:g}" for value in regular["moderate"].world.best[0])
    return _judged(
        "A moderate rate stays robust under noise",
        off["moderate"] <= NEAR,
        f"the mean goes to [{', '.join(f'{value:.2f}' for value in exact)}], not [{goal}]; median "
        "deviation of a parameter "
        + ", ".join(f"{np.median(off[n]):.2f} at rate {rate:g}" for n, rate in RATES.items()),
    )


def _stability(rare: Mapping[str, Replicas]) -> ClaimVerdict:
    spread = {
        n: runs.course.profiles[:, -LATE:, 0].std(axis=1).mean(axis=-1) for n, runs in rare.items()
    }
    ordered = (spread["conservative"] < spread["moderate"]) & (
        spread["moderate"] < spread["aggressive"]
    )
    return _judged(
        "The rate sets the stability under noise",
        ordered,
        "mean standard deviation "
        + ", ".join(f"{spread[n].mean():.3f} at rate {rate:g}" for n, rate in RATES.items())
        + "; theory: it goes with the root of rate / (2 - rate)",
    )


@cache
def _claims() -> Mapping[str, Mapping[str, Any]]:
    text = files("bt_agents_lab").joinpath("experiments/claims.yaml").read_text(encoding="utf-8")
    claims: Mapping[str, Mapping[str, Any]] = yaml.load(text, Loader=yaml.CSafeLoader)
    return claims


def _judged(
    name: str,
    held: Bools | Sequence[bool],
    found: str,
    reason: str = "",
    *,
    rounds: int = 0,
    unit: str = "runs",
) -> ClaimVerdict:
    """Return the verdict on a claim of ``claims.yaml``; a given reason replaces the one there."""
    texts = _claims()[name]
    criterion = texts["criterion"].format(
        reached=REACHED,
        late=LATE,
        near=NEAR,
        jump=JUMP,
        high_rate=RATES["aggressive"],
        rounds=rounds,
    )
    claim = Claim(
        name=name,
        section=texts["section"],
        quote=texts["quote"],
        criterion=criterion,
        figures=tuple(texts["figures"]),
    )
    return judged(claim, held, found, reason or texts.get("reason", ""), unit)


def _played(
    experiment: Paper, rate: float, errors: FeedbackErrors | None, seeds: Sequence[int]
) -> Replicas:
    world = replace(world_of(experiment.folder, experiment.spec), rates=np.array([rate]))
    return replicas(world, with_errors(experiment.spec, errors), seeds)


def _gap(runs: Replicas) -> Floats:
    """Return profile minus goal of the only agent, [R, T, n]."""
    return np.asarray(runs.course.profiles[:, :, 0] - runs.world.best[0])


def _distance(runs: Replicas) -> Floats:
    """Return the Manhattan distance of the only agent to its goal, [R, T]."""
    return np.asarray(np.abs(_gap(runs)).sum(axis=-1))


def _swing(runs: Replicas) -> Floats:
    """Return the largest range that a parameter passes through in the last cycles, [R]."""
    late = runs.course.profiles[:, -LATE:, 0]
    return np.asarray((late.max(axis=1) - late.min(axis=1)).max(axis=-1))


def _arrival(distance: Floats) -> float:
    """Return the number of cycles after which a falling distance is small; infinite for never."""
    reached = distance < REACHED
    return float(np.argmax(reached)) + 1.0 if reached.any() else math.inf


def _counted(cycles: float) -> str:
    """Return a number of cycles as text."""
    return "never" if math.isinf(cycles) else f"{cycles:g} cycles"
