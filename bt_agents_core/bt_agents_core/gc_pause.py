# SPDX-License-Identifier: Apache-2.0
"""Pause of the cyclic garbage collector during short, bounded work."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pause the garbage collector within this block.

    Use it only for short work of bounded size. A collector that was off stays off.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
