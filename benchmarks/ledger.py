# SPDX-License-Identifier: Apache-2.0
"""How long a ledger of 100,000 revisions takes to be opened, asked and written; prints a table."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from feedback_node.ledger import Entry, Ledger
from feedback_node.ledger_rows import LAYER, Cause
from feedback_node.recovery import inspect

REVISIONS = 100_000
AGENTS = 20
BATCH = 1000
PROFILE = {"age": 1.0, "familiarity": 2.0, "mood": 3.0}


def fill(ledger: Ledger) -> None:
    """Write the revisions, a batch in each transaction."""
    ledger.enter({f"agent{number}": PROFILE for number in range(AGENTS)})
    for first in range(0, REVISIONS - 2 * AGENTS, BATCH):
        numbers = range(first, min(first + BATCH, REVISIONS - 2 * AGENTS))
        ledger.record([entry(number) for number in numbers])
    for number in range(AGENTS):
        cause = Cause(cause=LAYER)
        ledger.append(f"agent{number}", PROFILE, cause, layer="person/anna")


def entry(number: int) -> Entry:
    """Return what one feedback has taught."""
    agent = f"agent{number % AGENTS}"
    return Entry(
        agent=agent,
        profile={name: value + number / REVISIONS for name, value in PROFILE.items()},
        cause=Cause(
            kind=1,
            source="mood rule",
            reason="mood.change >= 0.5 held 2 s: mood 3 → 4",
            feedback_id=f"rule/0123456789ab/{number}/{agent}/0",
            epoch="0123456789ab",
            round=number,
            rate=0.2,
            weight=0.5,
            target=PROFILE,
            scene_id=f"scene-{number}",
        ),
    )


@contextmanager
def timed(what: str, times: int = 1) -> Iterator[None]:
    """Print how long something takes."""
    began = time.perf_counter()
    yield
    print(f"{what:44}{(time.perf_counter() - began) / times * 1e3:10.2f} ms")


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if sys.argv[1:] else None) as folder:
        path = Path(folder) / "ledger.sqlite"
        with Ledger(path) as ledger:
            fill(ledger)
        with timed("open, which checks all of it"):
            ledger = Ledger(path)
        print(f"{'size':44}{path.stat().st_size / 1e6:10.1f} MB")
        with ledger:
            with timed("check while it is in use"):
                assert inspect(path).good == REVISIONS
            with timed("current profile", 1000):
                for number in range(1000):
                    ledger.current(f"agent{number % AGENTS}")
            with timed("last 30 feedbacks of an agent", 100):
                for number in range(100):
                    ledger.taught(f"agent{number % AGENTS}", newest=30)
            with timed("record one feedback, durably", 200):
                for number in range(200):
                    ledger.record([entry(REVISIONS + number)])
            with timed("forget a person, without a trace"):
                ledger.forget([(f"agent{number}", "person/anna") for number in range(AGENTS)])


if __name__ == "__main__":
    main()
