# SPDX-License-Identifier: Apache-2.0
"""How long expressions take, beside plain Python lambdas in the same run; prints a table."""

from __future__ import annotations

import timeit
from collections.abc import Callable

from bt_agents.language.expression.expressions import Expression, parse_expression

VALUES: dict[str, object] = {
    "scene.age": 4.0, "scene.familiarity": 2.0, "scene.person": True,
    "live.mood": 2.5, "attempts": 3, "answer": "to the gate",
}  # fmt: skip

Lookup = Callable[[str], object]
CASES: tuple[tuple[str, Callable[[Lookup], object]], ...] = (
    ("scene.age >= 4", lambda of: of("scene.age") >= 4),
    ("attempts < 5", lambda of: of("attempts") < 5),
    ("answer == 'to the gate'", lambda of: of("answer") == "to the gate"),
    ("scene.age between 2 and 4", lambda of: 2 <= of("scene.age") <= 4),
    ("answer in ['no', 'to the gate']", lambda of: of("answer") in ("no", "to the gate")),
    ("'gate' in answer", lambda of: "gate" in of("answer")),
    ("max(live.mood, 1) * 2 > 4", lambda of: max(of("live.mood"), 1) * 2 > 4),
    (
        "scene.person and scene.age >= 4 and not live.mood < 2",
        lambda of: of("scene.person") and of("scene.age") >= 4 and not of("live.mood") < 2,
    ),
)
NUMBER = 100_000
REPEAT = 5


def seconds_each(call: Callable[[Lookup], object]) -> float:
    """Return how long a call with a lookup takes, the fastest of several measurements [s]."""
    timer = timeit.Timer("call(of)", globals={"call": call, "of": VALUES.__getitem__})
    return min(timer.repeat(repeat=REPEAT, number=NUMBER)) / NUMBER


def reading(text: str) -> float:
    """Return how long it takes to parse an expression [s]."""
    timer = timeit.Timer("parse(text)", globals={"parse": parse_expression, "text": text})
    return min(timer.repeat(repeat=REPEAT, number=NUMBER // 100)) / (NUMBER // 100)


def main() -> None:
    """Measure and print every case."""
    print(f"{'expression':56}{'µs':>8}{'lambda µs':>12}{'ratio':>8}{'parse µs':>11}")
    for text, plain in CASES:
        expression: Expression = parse_expression(text)
        if expression.evaluate(VALUES.__getitem__) != plain(VALUES.__getitem__):
            raise SystemExit(f"'{text}' means something else than its lambda")
        ours, theirs = seconds_each(expression.evaluate), seconds_each(plain)
        print(
            f"{text:56}{ours * 1e6:8.2f}{theirs * 1e6:12.2f}{ours / theirs:8.1f}"
            f"{reading(text) * 1e6:11.0f}"
        )


if __name__ == "__main__":
    main()
