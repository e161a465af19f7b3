# SPDX-License-Identifier: Apache-2.0
"""How long expressions take to evaluate, beside plain Python lambdas."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import thread_time

from bt_agents_language.expression.expressions import parse_expression
from measuring import Effort, Row, in_turn, timed

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
EVALUATIONS = 20_000
READINGS = 200
OURS = "bt-agents"
LAMBDA = "lambda"
READ = "parse"


def measure(effort: Effort) -> Iterator[Row]:
    """Compare each expression with its lambda; its reading stands beside.

    Raises:
        RuntimeError: An expression means something else than its lambda.
    """
    of, number = VALUES.__getitem__, effort.times(EVALUATIONS)
    for text, plain in CASES:
        expression = parse_expression(text)
        if expression.evaluate(of) != plain(of):
            raise RuntimeError(f"'{text}' means something else than its lambda")
        ways = {
            OURS: timed(partial(expression.evaluate, of), number, thread_time),
            LAMBDA: timed(partial(plain, of), number, thread_time),
            READ: timed(partial(parse_expression, text), effort.times(READINGS), thread_time),
        }
        found = in_turn(ways, effort)
        yield Row(
            case=text,
            side="evaluated",
            values=found[OURS],
            floor=LAMBDA,
            floor_values=found[LAMBDA],
        )
        yield Row(case=text, side="read and checked", values=found[READ])
