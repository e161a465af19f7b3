# SPDX-License-Identifier: Apache-2.0
"""Strategies of a running market as its parameters have them, and checked changes of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.diagnostics.collection import did_you_mean

_OWN = ("strategy", "shadow_strategy")


@dataclass(frozen=True, kw_only=True)
class StrategyOption:
    """Option of a strategy with its current value and its range."""

    value: float
    minimum: float
    maximum: float
    description: str


@dataclass(frozen=True, kw_only=True)
class Strategies:
    """Strategies of a running market by name: the current one, and perhaps a shadow strategy."""

    descriptions: Mapping[str, str]
    options: Mapping[str, Mapping[str, StrategyOption]]
    current: str
    shadow: str


def parameter_names(infos: Iterable[Any]) -> list[str]:
    """Return the parameters of a market that are about its strategies.

    Args:
        infos: Its strategies, with the fields of ``StrategyInfo``.
    """
    return [*_OWN, *(f"{info.name}.{option}" for info in infos for option in info.options)]


def strategies_of(
    infos: Sequence[Any], descriptors: Sequence[Any], values: Sequence[Any]
) -> Strategies:
    """Return the strategies of a market from what it answers about their parameters.

    Args:
        infos: As in :func:`parameter_names`.
        descriptors: Descriptors of these parameters, in order.
        values: Values of these parameters, in order.

    Raises:
        Refused: ``NO_ANSWER``: the answer lacks a part.
    """
    names = parameter_names(infos)
    if not len(descriptors) == len(values) == len(names):
        raise _incomplete()
    described = dict(zip(names, zip(values, descriptors, strict=True), strict=True))
    return Strategies(
        descriptions={info.name: info.description for info in infos},
        options={
            info.name: {key: _option(*described[f"{info.name}.{key}"]) for key in info.options}
            for info in infos
        },
        current=str(values[0]),
        shadow=str(values[1]),
    )


def changed_parameters(
    found: Strategies, name: str, options: Iterable[tuple[str, float]], shadow: str | None = None
) -> dict[str, str | float]:
    """Return the parameters of the market to set, by name.

    Args:
        found: Its strategies.
        name: Name of the strategy to use from now on; empty for the one in force.
        options: Names and values of options of this strategy.
        shadow: The strategy that only scores from now on; empty for none, None for the one now.

    Raises:
        Refused: ``UNKNOWN_STRATEGY``, ``UNKNOWN_OPTION`` or ``OUT_OF_RANGE``.
    """
    changes: dict[str, str | float] = {}
    if name:
        changes["strategy"] = _known(name, found)
    if shadow is not None:
        changes["shadow_strategy"] = shadow and _known(shadow, found)
    about = name or found.current
    known = found.options.get(about, {})
    for option, value in options:
        if option not in known:
            hint = did_you_mean(option, sorted(known)) or "there are none"
            raise Refused(
                RefusalCode.UNKNOWN_OPTION,
                f"strategy '{about}' has no option '{option[:40]}'; {hint}",
            )
        least, most = known[option].minimum, known[option].maximum
        if not least <= value <= most:
            raise Refused(
                RefusalCode.OUT_OF_RANGE,
                f"{about}.{option}: {value:g}, expected {least:g} to {most:g}",
            )
        changes[f"{about}.{option}"] = value
    return changes


def _known(name: str, found: Strategies) -> str:
    if name not in found.descriptions:
        hint = did_you_mean(name, found.descriptions)
        raise Refused(RefusalCode.UNKNOWN_STRATEGY, f"no strategy '{name[:40]}'; {hint}")
    return name


def _option(value: Any, descriptor: Any) -> StrategyOption:
    spans = descriptor.floating_point_range
    numbers = (value, *((spans[0].from_value, spans[0].to_value) if spans else ()))
    if len(numbers) != 3 or not all(isinstance(n, float) and math.isfinite(n) for n in numbers):
        raise _incomplete()
    return StrategyOption(
        value=numbers[0],
        minimum=numbers[1],
        maximum=numbers[2],
        description=descriptor.description,
    )


def _incomplete() -> Refused:
    return Refused(
        RefusalCode.NO_ANSWER, "the marketplace does not describe all options of its strategies"
    )
