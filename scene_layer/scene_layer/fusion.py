# SPDX-License-Identifier: Apache-2.0
"""Fuses several uncertain readings into one, and smooths readings over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Reading of a parameter: value, certainty and validity.

    Attributes:
        value: The value; finite.
        at: Steady time of its arrival [s].
        stale_at: Steady time when it expires [s]; infinite for never.
        std: Standard deviation in the unit of the parameter; 0 if none is stated.
        confidence: Confidence above 0, up to 1; 1 if none is stated.
        source: Its origin, in words; may be empty.
    """

    value: float
    at: float
    stale_at: float = math.inf
    std: float = 0.0
    confidence: float = 1.0
    source: str = ""


def fused(readings: Sequence[Reading]) -> Reading:
    """Return the inverse-variance mean of one or more readings of the same quantity.

    The value is the mean weighted by ``w_i = c_i / s_i²``, its standard deviation ``1 / √Σ w_i``:
    the inverse-variance mean (see J. Hartung, G. Knapp, B. K. Sinha, "Statistical Meta-Analysis
    with Applications", 2008, chapter 4), in which the confidence ``c_i`` scales down the weight of
    a reading like a power prior (J. G. Ibrahim, M.-H. Chen, "Power Prior Distributions for
    Regression Models", 2000). So a single reading of confidence ``c`` has the standard deviation
    ``s / √c``. A reading without a standard deviation has the average weight of those with one,
    and does not reduce the resulting deviation; if none states one, the confidences alone are the
    weights. The result has the highest confidence and the latest times of all readings.
    """
    stated = [reading.std for reading in readings if reading.std > 0.0]
    # Relative to the smallest deviation, so that no square overflows.
    smallest = min(stated, default=1.0)
    counts = [(smallest / std) ** 2 for std in stated] or [1.0]
    mean_count = math.fsum(counts) / len(counts)
    weights = [
        reading.confidence * ((smallest / reading.std) ** 2 if reading.std > 0.0 else mean_count)
        for reading in readings
    ]
    values = [reading.value for reading in readings]
    mean = math.fsum(map(math.prod, zip(weights, values, strict=True))) / math.fsum(weights)
    known = math.fsum(w for w, r in zip(weights, readings, strict=True) if r.std > 0.0)
    return Reading(
        value=min(max(mean, min(values)), max(values)),
        at=max(reading.at for reading in readings),
        stale_at=max(reading.stale_at for reading in readings),
        std=smallest / math.sqrt(known) if stated else 0.0,
        confidence=max(reading.confidence for reading in readings),
        source=" and ".join(sorted({r.source for r in readings if r.source})),
    )


def smoothed(before: Reading, new: Reading, time_constant_s: float) -> Reading:
    """Return a new reading, smoothed by the previous one depending on the time between them.

    ``y += a·(x − y)`` with ``a = 1 − exp(−c·Δt / τ)``: exponential smoothing of readings at uneven
    times (A. Eckner, "Algorithms for Unevenly Spaced Time Series: Moving Averages and Other
    Rolling Operators", 2017), in which a lower confidence slows time. The standard deviation and
    the confidence move in the same way: errors of neighbouring readings are not independent, so
    their mean is not more certain than each of them. A stale previous reading is ignored, and a
    time constant of 0 disables smoothing.
    """
    if time_constant_s <= 0.0 or new.at > before.stale_at:
        return new
    elapsed_s = max(0.0, new.at - before.at)
    share = -math.expm1(-new.confidence * elapsed_s / time_constant_s)
    return replace(
        new,
        value=_between(before.value, new.value, share),
        std=_between(before.std, new.std, share) if before.std and new.std else new.std,
        confidence=_between(before.confidence, new.confidence, share),
    )


def _between(first: float, last: float, share: float) -> float:
    value = first + share * (last - first)
    return min(max(value, min(first, last)), max(first, last))
