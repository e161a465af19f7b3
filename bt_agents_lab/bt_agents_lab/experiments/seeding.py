# SPDX-License-Identifier: Apache-2.0
"""Seeds many sources of chance at once, each as ``strategies.chance`` seeds one.

NumPy seeds a ``PCG64`` in two steps: its ``SeedSequence`` mixes the seed, 32 bits at a time, and
what comes out becomes state and increment of the generator (O'Neill, "PCG: A Family of Simple Fast
Space-Efficient Statistically Good Algorithms for Random Number Generation", 2014). NumPy promises
to keep both as they are.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

Words = npt.NDArray[np.uint32]

_POOL = 4
_OUT = 8
_MASK = 2**128 - 1
_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
_HASH_IN = (0x43B0D7E5, 0x931E8875)
_HASH_OUT = (0x8B51F9DD, 0x58F38DED)
_MIX_LEFT = np.uint32(0xCA01F9DD)
_MIX_RIGHT = np.uint32(0x4973F715)
_HALF = np.uint32(16)


def sources(seeds: Iterable[str]) -> Iterator[np.random.Generator]:
    """Return for each seed the generator of ``strategies.chance``.

    It is one and the same object: what it draws is to be taken before the next is asked for.
    """
    digests = b"".join(hashlib.sha256(seed.encode()).digest()[::-1] for seed in seeds)
    words = np.frombuffer(digests, dtype="<u4").astype(np.uint32).reshape((-1, 8)).T
    states = np.ascontiguousarray(_out(_pool(words)).T).tolist()
    source = np.random.PCG64(0)
    state = source.state
    generator = np.random.Generator(source)
    for a, b, c, d, e, f, g, h in states:
        start = b << 96 | a << 64 | d << 32 | c
        increment = (f << 97 | e << 65 | h << 33 | g << 1 | 1) & _MASK
        inner = ((increment + start) * _MULTIPLIER + increment) & _MASK
        state["state"] = {"state": inner, "inc": increment}
        source.state = state
        yield generator


class _Hash:
    """Hashes words, each with another constant."""

    def __init__(self, constants: tuple[int, int]) -> None:
        self._constant, self._factor = constants

    def __call__(self, values: Words) -> Words:
        values = values ^ np.uint32(self._constant)
        self._constant = self._constant * self._factor & 0xFFFFFFFF
        values = values * np.uint32(self._constant)
        return values ^ (values >> _HALF)


def _pool(words: Words) -> list[Words]:
    """Mix the words of each seed, [8, seeds], from the lowest on."""
    hashed = _Hash(_HASH_IN)
    pool = [hashed(word) for word in words[:_POOL]]
    for source in range(_POOL):
        for target in range(_POOL):
            if source != target:
                pool[target] = _mixed(pool[target], hashed(pool[source]))
    for word in words[_POOL:]:
        for target in range(_POOL):
            pool[target] = _mixed(pool[target], hashed(word))
    return pool


def _mixed(one: Words, other: Words) -> Words:
    values: Words = _MIX_LEFT * one - _MIX_RIGHT * other
    return values ^ (values >> _HALF)


def _out(pool: list[Words]) -> Words:
    hashed = _Hash(_HASH_OUT)
    return np.stack([hashed(pool[index % _POOL]) for index in range(_OUT)])
