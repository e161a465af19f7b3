# SPDX-License-Identifier: Apache-2.0
"""Time limit for calls into third-party code, where the platform can interrupt them."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable
from traceback import walk_stack
from types import FrameType
from typing import TypeVar

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

T = TypeVar("T")

_SOON_S = 1e-4
"""Time after which an overdue alarm rings [s]; zero would cancel it."""


class Blocked(BaseException):
    """Raised inside a call that blocks; no ``except Exception`` catches it."""


def bounded(call: Callable[[], T], limit_s: float) -> T:
    """Return the result of a call, unless it exceeds the limit on the steady clock.

    In the main thread, on platforms with ``SIGALRM``, the call is interrupted: this ends sleeps,
    waits for input and endless Python loops, but not a call into C that never returns to Python.
    Elsewhere nothing can be interrupted, and a call that took too long is refused afterwards.
    An alarm that other code has set is preserved. Where Python drops exceptions (in ``__del__``
    and in callbacks of the garbage collector), an interruption is silently lost, and the next one
    ends the call.

    Raises:
        Refused: ``BLOCKED``. Exceptions of the call are passed on.
    """
    if threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer"):
        return _interrupted(call, limit_s)
    began = time.monotonic()
    result = call()
    if time.monotonic() - began > limit_s:
        raise _refusal(limit_s)
    return result


def _interrupted(call: Callable[[], T], limit_s: float) -> T:
    guarding, rang = True, False

    def ring(_signal: int, frame: FrameType | None) -> None:
        nonlocal rang
        is_reporting = any(one.f_code is report_others.__code__ for one, _ in walk_stack(frame))
        if guarding and not is_reporting:
            rang = True
            raise Blocked

    hook = sys.unraisablehook

    def report_others(lost: sys.UnraisableHookArgs) -> None:
        if lost.exc_type is not Blocked:
            hook(lost)

    began = time.monotonic()
    sys.unraisablehook = report_others
    handler = signal.signal(signal.SIGALRM, ring)
    left, interval = 0.0, 0.0
    try:
        # It rings repeatedly, for code that catches everything and continues.
        left, interval = signal.setitimer(signal.ITIMER_REAL, limit_s, limit_s)
        try:
            result = call()
        finally:
            guarding = False
    except (Blocked, Exception):
        guarding = False
        if rang:
            raise _refusal(limit_s) from None
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL if handler is None else handler)
        sys.unraisablehook = hook
        if left:
            left = max(left - (time.monotonic() - began), _SOON_S)
            signal.setitimer(signal.ITIMER_REAL, left, interval)
    if rang:
        raise _refusal(limit_s)
    return result


def _refusal(limit_s: float) -> Refused:
    return Refused(RefusalCode.BLOCKED, f"blocked for more than {limit_s:g} s")
