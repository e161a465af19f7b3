# SPDX-License-Identifier: Apache-2.0
"""Pause of the cyclic garbage collector during short, bounded work."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_paused() -> Iterator[None]:
    """Keep the garbage collector from looking through everything again and again.

    Only for work that ends soon and whose size is bounded. It stays off where it was off.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
