# SPDX-License-Identifier: Apache-2.0
"""Strategies of other packages, found by their entry points."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from bt_agents_core.errors import BtAgentsError
from marketplace_node.strategies.catalogue import STRATEGIES, add
from marketplace_node.strategies.strategy import Option, StrategySpec

GROUP = "bt_agents.strategies"
"""Entry point group; an entry point has the strategy's name and loads a ``StrategySpec``."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")


class StrategyPluginProblem(BtAgentsError):
    """A strategy of a package cannot be used."""


@cache
def add_installed() -> tuple[str, ...]:
    """Add the strategies of all installed packages to ``STRATEGIES``, once per process.

    Returns:
        The reasons why others cannot be used, in words.
    """
    specs, problems = read_plugins(entry_points(group=GROUP), STRATEGIES)
    for spec in specs.values():
        add(spec)
    return problems


def read_plugins(
    points: Iterable[EntryPoint], taken: Iterable[str] = ()
) -> tuple[Mapping[str, StrategySpec], tuple[str, ...]]:
    """Return the strategies of entry points by name, and the problems of the others.

    An invalid strategy, or one whose name is ``taken``, does not affect others. Its scores are
    checked in every round.
    """
    found: dict[str, StrategySpec] = {}
    problems: list[str] = []
    names = set(taken)
    for point in sorted(points, key=lambda one: (one.name, one.value)):
        try:
            if point.name in names:
                raise StrategyPluginProblem(
                    f"{_whose(point)}: there is a strategy of this name already"
                )
            found[point.name] = _spec(point)
            names.add(point.name)
        except StrategyPluginProblem as problem:
            problems.append(str(problem))
    return found, tuple(problems)


def _spec(point: EntryPoint) -> StrategySpec:
    whose = _whose(point)
    if not _NAME.fullmatch(point.name):
        raise StrategyPluginProblem(
            f"{whose}: '{point.name}' cannot be the name of a strategy; expected small letters, "
            "digits and '_'"
        )
    try:
        # Some packages print when they are imported; standard output may be for programs.
        with redirect_stdout(sys.stderr):
            spec: StrategySpec = point.load()
    except (Exception, SystemExit) as error:
        raise StrategyPluginProblem(
            f"{whose} cannot be loaded: {type(error).__name__}: {' '.join(str(error).split())}"
        ) from error
    if problem := _problem(point.name, spec):
        raise StrategyPluginProblem(f"{whose}{problem}")
    return spec


def _problem(name: str, spec: object) -> str:
    """Return the problem of the object of an entry point, as the rest of a sentence."""
    if not isinstance(spec, StrategySpec):
        return f" is a {type(spec).__name__}, expected a marketplace_node.strategies.StrategySpec"
    if spec.name != name:
        return f" calls itself '{spec.name}'; both names must be the same"
    if not isinstance(spec.description, str):
        return ": 'description' is not a text"
    if not callable(spec.score):
        return ": 'score' is not a function"
    if not isinstance(spec.options, tuple) or not all(_is_option(one) for one in spec.options):
        return (
            ": 'options' must be a tuple of Option with name and description as texts, "
            "and whose default lies between minimum and maximum"
        )
    if len({option.name for option in spec.options}) < len(spec.options):
        return ": two options have the same name"
    return ""


def _is_option(option: object) -> bool:
    return (
        isinstance(option, Option)
        and isinstance(option.name, str)
        and isinstance(option.description, str)
        and _NAME.fullmatch(option.name) is not None
        and all(_is_number(v) for v in (option.minimum, option.default, option.maximum))
        and option.minimum <= option.default <= option.maximum
    )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _whose(point: EntryPoint) -> str:
    package = point.dist.name if point.dist is not None else "a package"
    return f"strategy '{point.name}' of {package} ({point.value})"
