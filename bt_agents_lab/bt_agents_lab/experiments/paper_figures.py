# SPDX-License-Identifier: Apache-2.0
"""Figures 5 to 9 of the paper, drawn from the runs of many seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bt_agents_lab.experiments.claims import RATES, Paper
from bt_agents_lab.experiments.drawing import COLOURS, band, below, share_band, sheet, smooth
from bt_agents_lab.experiments.measures import right
from bt_agents_lab.experiments.replicas import Replicas, replicas, with_errors, world_of
from bt_agents_lab.experiments.verdicts import figure_name, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SMOOTHED = 5
"""Rounds over which the share of right selections is averaged."""


def first(folder: Path, experiment: Paper) -> None:
    """Draw Figure 5."""
    world = world_of(experiment.folder, experiment.spec)
    run = replicas(world, experiment.spec, [experiment.spec.seed])
    with sheet(folder, figure_name(5), (6.4, 3.4)) as (_, (axes,)):
        _profile(axes, run, run)
        axes.set_title(
            f"Experiment 1: {experiment.spec.rounds} cycles of the same feedback, "
            f"rate {world.rates[0]:g}"
        )


def second(folder: Path, arms: Mapping[str, Paper], seeds: Sequence[int]) -> None:
    """Draw Figures 6 (conservative), 7 (conservative against aggressive) and 8 (moderate)."""
    for number, name in ((6, "conservative"), (8, "moderate")):
        one = arms[name]
        world = world_of(one.folder, one.spec)
        with sheet(folder, figure_name(number), (6.4, 3.6)) as (_, (axes,)):
            _profile(
                axes, replicas(world, one.spec, [one.spec.seed]), replicas(world, one.spec, seeds)
            )
            errors = one.spec.feedback.errors
            assert errors is not None
            axes.set_title(
                f"Experiment 2, {name}: rate {world.rates[0]:g}, {percent(errors.share)} of the "
                f"feedback wrong"
            )
    one = arms["aggressive"]
    errors = one.spec.feedback.errors
    assert errors is not None
    random_errors = with_errors(one.spec, replace(errors, every=0, share=1 / errors.every))
    with sheet(folder, figure_name(7), (6.4, 6.2), rows=2) as (figure, axes_of):
        for axes, name in zip(axes_of, ("conservative", "aggressive"), strict=True):
            world = replace(world_of(one.folder, one.spec), rates=np.array([RATES[name]]))
            _profile(axes, replicas(world, one.spec, [0]), replicas(world, random_errors, seeds))
            axes.set_title(f"{name}: rate {RATES[name]:g}")
        figure.suptitle(
            f"Experiment 2 under disturbance: each {errors.every}rd feedback is [5, 5, 5]; "
            f"bands: one of {errors.every} by chance",
            fontsize=10,
        )


def third(folder: Path, many: Replicas, rounds: int) -> None:
    """Draw Figure 9, and the share of right selections over many runs of Experiment 3."""
    world = many.world
    # Use the first run where every agent runs, else the first of all.
    shown = int(np.argmax(many.course.all_ran))
    with sheet(folder, figure_name(9), (6.6, 7.4), rows=3) as (figure, (top, middle, bottom)):
        _three(top, many, shown, rounds)
        _selections(middle, many, shown, rounds)
        correct = right(world, many.streams, many.course)[:, :rounds]
        whole = many.course.all_ran
        all_run, one_not = percent(float(whole.mean())), percent(float((~whole).mean()))
        for runs, colour, label in (
            (correct, COLOURS[0], "all runs"),
            (correct[whole], COLOURS[2], f"runs where all agents run ({all_run})"),
            (correct[~whole], COLOURS[1], f"runs where one never runs ({one_not})"),
        ):
            if len(runs):
                share_band(bottom, smooth(runs.astype(np.float64), SMOOTHED), colour, label)
        bottom.set_ylim(0.0, 1.03)
        for axes in (top, middle, bottom):
            axes.set_xlim(0, rounds)
        bottom.set_xlabel("round")
        bottom.set_ylabel("right selections (share)")
        bottom.set_title(
            f"Share of right selections over {len(correct)} runs (mean of {SMOOTHED} rounds, "
            "95 % interval)"
        )
        bottom.legend(loc="lower right")
        figure.suptitle(
            f"Experiment 3: three agents that start alike, rate {world.rates[0]:g}, ties by "
            "chance",
            fontsize=10,
        )


def _profile(axes: Axes, shown: Replicas, many: Replicas) -> None:
    """Draw the profile of the only agent: one run, and a band of many."""
    world = shown.world
    for index, name in enumerate(world.space.names):
        colour = COLOURS[index]
        start = np.full((1, 1), world.starts[0, index])
        line = np.concatenate([start, shown.course.profiles[:, :, 0, index]], axis=1)[0]
        spread = many.course.profiles[:, :, 0, index]
        band(axes, spread, colour)
        axes.plot(np.arange(len(line)), line, color=colour, label=name)
        axes.axhline(world.best[0, index], color=colour, linestyle=":", linewidth=1.0)
    axes.set_ylim(world.low.min() - 0.15, world.high.max() + 0.15)
    axes.set_xlim(0, shown.course.awarded.shape[1])
    axes.set_xlabel("feedback cycle")
    axes.set_ylabel("profile (scale 1 to 5)")
    note = "dotted: goal"
    if len(many.course.profiles) > 1:
        note += f"; bands: 90 % of {len(many.course.profiles)} runs"
    below(axes, note)


def _three(axes: Axes, many: Replicas, shown: int, rounds: int) -> None:
    for index, name in enumerate(many.world.agents):
        colour = COLOURS[index]
        # All three parameters are equal in this experiment, so their mean shows each of them.
        values = many.course.profiles[:, :rounds, index].mean(axis=-1)
        start = many.world.starts[index].mean()
        band(axes, values[many.course.all_ran], colour)
        axes.plot(np.concatenate([[start], values[shown]]), color=colour, label=name)
        axes.axhline(many.world.best[index].mean(), color=colour, linestyle=":", linewidth=1.0)
    axes.set_ylim(0.85, 5.15)
    axes.set_ylabel("profile (scale 1 to 5)")
    axes.set_title("Each parameter of the profiles in one run")
    below(axes, "dotted: made for; bands: 90 % of the runs in which all agents run")


def _selections(axes: Axes, many: Replicas, shown: int, rounds: int) -> None:
    scenes = many.streams.scene[shown]
    for index, name in enumerate(many.world.agents):
        won = np.flatnonzero(many.course.awarded[shown, :rounds] == index)
        wrong = many.world.misfit_in(0)[scenes[won]].argmin(axis=-1) != index
        axes.plot(won + 1, scenes[won], "|", markersize=9, color=COLOURS[index], label=name)
        at = won[wrong]
        axes.plot(at + 1, scenes[at], "o", markersize=8, markerfacecolor="none", color="black")
    names = [f"[{', '.join(f'{value:g}' for value in scene)}]" for scene in many.world.scenes]
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(-0.5, len(names) - 0.5)
    axes.set_ylabel("scene")
    axes.set_title("Who gets which scene in this run; circles: not the one that is made for it")
