# SPDX-License-Identifier: Apache-2.0
"""Time limit of calls that block: they end, and other calls are unaffected."""

from __future__ import annotations

import gc
import signal
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest

from bt_agents.engine.call_limit import bounded
from bt_agents_core.errors import Refused

LIMIT_S = 0.02
FAR_S = 60.0


def sleeps() -> None:
    time.sleep(FAR_S)


def loops() -> None:
    while True:
        pass


def catches_everything_once() -> None:
    with suppress(BaseException):
        time.sleep(FAR_S)
    time.sleep(FAR_S)


def swallows_and_returns() -> None:
    with suppress(BaseException):
        time.sleep(FAR_S)


def raises_something_else_instead() -> None:
    try:
        time.sleep(FAR_S)
    except BaseException:
        raise ValueError("interrupted") from None


class Faulty:
    def __del__(self) -> None:
        raise ValueError("its own")


@pytest.fixture(autouse=True)
def nothing_stays_behind() -> Iterator[None]:
    before = signal.getsignal(signal.SIGALRM)
    yield
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@pytest.mark.parametrize(
    "call",
    [sleeps, loops, catches_everything_once, swallows_and_returns, raises_something_else_instead],
)
def test_blocking_call_is_always_interrupted(call: Callable[[], None]) -> None:
    began = time.monotonic()
    with pytest.raises(Refused, match=r"blocked for more than 0\.02 s") as refused:
        bounded(call, LIMIT_S)
    assert refused.value.code == "BLOCKED"
    assert time.monotonic() - began < FAR_S / 2


def test_quick_call_returns_or_raises_unchanged() -> None:
    assert bounded(lambda: 7, LIMIT_S) == 7
    with pytest.raises(KeyError):
        bounded(lambda: {}["x"], LIMIT_S)
    with pytest.raises(SystemExit):
        bounded(lambda: exec("raise SystemExit"), LIMIT_S)


def test_slow_call_off_main_thread_is_refused_afterwards() -> None:
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(bounded, lambda: 7, 10.0).result() == 7
        with pytest.raises(Refused, match="BLOCKED"):
            pool.submit(bounded, lambda: time.sleep(0.03), LIMIT_S).result()


def test_foreign_alarm_still_fires_on_time() -> None:
    rang: list[float] = []
    before = signal.signal(signal.SIGALRM, lambda *_: rang.append(time.monotonic()))
    try:
        signal.setitimer(signal.ITIMER_REAL, FAR_S, 7.0)
        bounded(lambda: time.sleep(0.01), FAR_S)
        left, interval = signal.setitimer(signal.ITIMER_REAL, 0.0)
        assert FAR_S - 10.0 < left < FAR_S - 0.005
        assert interval == 7.0
        signal.setitimer(signal.ITIMER_REAL, 0.005)
        bounded(lambda: time.sleep(0.05), FAR_S)
        end = time.monotonic() + 10.0
        while not rang and time.monotonic() < end:
            time.sleep(0.001)
        assert len(rang) == 1
    finally:
        signal.signal(signal.SIGALRM, before)


def test_nested_bounded_calls_keep_both_limits() -> None:
    def outer() -> None:
        with suppress(Refused):
            bounded(sleeps, LIMIT_S)
        time.sleep(FAR_S)

    with pytest.raises(Refused, match=r"more than 0\.1 s"):
        bounded(outer, 0.1)


def test_dropped_interruption_raises_no_unraisable_error(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lost: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: lost.append(what.exc_type))

    class SlowToGo:
        def __del__(self) -> None:
            time.sleep(2 * LIMIT_S)

    def call() -> None:
        SlowToGo()
        gc.callbacks.append(slow)
        gc.collect()
        time.sleep(FAR_S)

    def slow(_phase: str, _info: object) -> None:
        time.sleep(2 * LIMIT_S)

    hook = sys.unraisablehook
    try:
        with pytest.raises(Refused, match="blocked"):
            bounded(call, LIMIT_S)
    finally:
        gc.callbacks.remove(slow)
    assert sys.unraisablehook is hook
    assert lost == []
    assert capsys.readouterr().err == ""

    def drops_errors() -> None:
        while True:
            Faulty()

    for _ in range(100):
        with pytest.raises(Refused, match="blocked"):
            bounded(drops_errors, 3e-4)
    assert set(lost) == {ValueError}
    assert capsys.readouterr().err == ""
