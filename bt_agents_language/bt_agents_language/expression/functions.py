# SPDX-License-Identifier: Apache-2.0
"""Functions of expressions for numbers, texts and missing values."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Context, Decimal
from itertools import islice

from bt_agents_core.scene import nearest_label
from bt_agents_core.text import ellipsize, folded
from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import (
    EvaluationError,
    Evaluator,
    Lookup,
    NoValue,
    Part,
    ValueKind,
    a_number,
    bounded,
    described,
)

MAX_DIGITS = 15
"""Maximum number of decimal places for ``round``; no number has more."""

_WHOLE_FROM = 2.0**53
"""Numbers from here on have no fraction."""

_EXACT = Context(prec=60)

_IN_DIGITS = re.compile(r"(?:(?<!\w)-)?(?:(?<![\w.,])[.,])?\d+(?:[.,]\d+)*")
_MAYBE_THOUSANDS = re.compile(r"-?[^\D0]\d{0,2}[.,]\d{3}|.*[.,].*[.,].*")


class NoNumber(EvaluationError, NoValue):
    """Text that does not contain exactly one clear number."""


@dataclass(frozen=True, kw_only=True)
class Function:
    """Function with at least one argument.

    Attributes:
        usage: Its syntax, for messages.
        means: Its result, for the reference.
        check_kinds: Refuses arguments of wrong kinds.
        compile: (arguments, column) → evaluator.
        least: Minimum number of arguments.
        most: Maximum number of arguments.
        gives: Kind of its result.
        asks_for_missing: Whether its arguments may be without a value.
        words: Returns the only possible texts of its result; none for any.
    """

    name: str
    usage: str
    means: str
    check_kinds: Callable[[Sequence[Part]], None]
    compile: Callable[[Sequence[Part], int], Evaluator]
    least: int = 1
    most: float = 1
    gives: ValueKind = ValueKind.NUMBER
    asks_for_missing: bool = False
    words: Callable[[Sequence[Part]], tuple[str, ...]] = lambda arguments: ()

    def check(self, arguments: Sequence[Part], column: int) -> None:
        """Refuse arguments of a wrong number or wrong kinds."""
        if not self.least <= len(arguments) <= self.most:
            count = {0: "nothing", 1: "one value"}.get(len(arguments), f"{len(arguments)} values")
            message = f"'{self.name}' is given {count} in its parentheses"
            raise ExpressionError(message, column, f"write {self.usage}", len(self.name))
        self.check_kinds(arguments)


def _extreme(name: str, means: str, pick: Callable[[Iterable[float]], float]) -> Function:
    usage = f"{name}(a, b) or {name}([a, b, …])"

    def check(arguments: Sequence[Part]) -> None:
        if len(arguments) > 1:
            for argument in arguments:
                argument.must_be(ValueKind.NUMBER, f"'{name}' needs numbers")
            return
        (only,) = arguments
        only.must_be(
            ValueKind.LIST, f"'{name}' needs two numbers or more, or one list", f"write {usage}"
        )
        if only.items not in (None, ValueKind.NUMBER):
            raise only.error(f"'{name}' needs numbers, found a list of {only.items.many}")

    def compile_(arguments: Sequence[Part], column: int) -> Evaluator:
        runs = [argument.run for argument in arguments]
        if len(runs) > 1:
            return lambda lookup: _picked(pick, [run(lookup) for run in runs], name, column)
        (only,) = runs

        def run(lookup: Lookup) -> float:
            items = only(lookup)
            if not isinstance(items, (list, tuple)):
                raise EvaluationError(
                    f"'{name}' needs two numbers or more, or one list, found {described(items)}",
                    column,
                )
            return _picked(pick, items, name, column)

        return run

    return Function(
        name=name, usage=usage, means=means, check_kinds=check, compile=compile_, most=math.inf
    )


def _picked(
    pick: Callable[[Iterable[float]], float], items: Iterable[object], name: str, column: int
) -> float:
    # Infinity is a valid reading of a range sensor; with NaN the order would decide.
    numbers = [_sound(a_number(item, name, column), name, column) for item in items]
    if not numbers:
        raise EvaluationError(f"'{name}' of an empty list", column)
    return bounded(pick(numbers), name, column)


def _sound(value: float, name: str, column: int) -> float:
    if value != value:
        raise EvaluationError(f"'{name}' needs numbers, found one that is not a number", column)
    return value


def _of_one(apply: Callable[[object, int], object]) -> Callable[[Sequence[Part], int], Evaluator]:
    """Return the compiler of a function of one value; ``apply`` gets the value and the column."""

    def compile_(arguments: Sequence[Part], column: int) -> Evaluator:
        of = arguments[0].run
        return lambda lookup: apply(of(lookup), column)

    return compile_


def _check_abs(arguments: Sequence[Part]) -> None:
    arguments[0].must_be(ValueKind.NUMBER, "'abs' needs a number")


def _abs(value: object, column: int) -> float:
    return bounded(abs(a_number(value, "abs", column)), "abs", column)


def _check_round(arguments: Sequence[Part]) -> None:
    for argument in arguments:
        argument.must_be(ValueKind.NUMBER, "'round' needs numbers")
    if len(arguments) == 2 and arguments[1].constant is not None:
        problem = _digits_problem(arguments[1].constant)
        if problem:
            raise arguments[1].error(problem)


def _compile_round(arguments: Sequence[Part], column: int) -> Evaluator:
    value_of = arguments[0].run
    if len(arguments) == 1:
        return lambda lookup: rounded(_finite(value_of(lookup), column), 0)
    digits_of = arguments[1].run

    def run(lookup: Lookup) -> float:
        value = _finite(value_of(lookup), column)
        digits = a_number(digits_of(lookup), "round", column)
        problem = _digits_problem(digits)
        if problem:
            raise EvaluationError(problem, column)
        return rounded(value, int(digits))

    return run


def _finite(value: object, column: int) -> float:
    return bounded(a_number(value, "round", column), "round", column)


def rounded(value: float, digits: int) -> float:
    """Return a finite number rounded half away from zero, 2.5 to 3.

    It rounds the decimal notation, so that 2.675 gives 2.68; 0 digits give an integer.
    """
    if isinstance(value, int):
        return value
    if abs(value) >= _WHOLE_FROM:
        return value if digits else int(value)
    nearest = Decimal(repr(value)).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP, _EXACT)
    # Adding zero removes the sign of -0.0.
    return float(nearest) + 0.0 if digits else int(nearest)


def _digits_problem(digits: object) -> str:
    whole = isinstance(digits, (int, float)) and digits == digits // 1
    if whole and 0 <= digits <= MAX_DIGITS:  # type: ignore[operator]
        return ""
    return f"'round' keeps 0 to {MAX_DIGITS} digits, found {described(digits)}"


def _check_len(arguments: Sequence[Part]) -> None:
    (only,) = arguments
    if only.kind in (ValueKind.NUMBER, ValueKind.BOOLEAN):
        raise only.error(f"'len' needs a text or a list, found {only.kind.one}")


def _len(value: object, column: int) -> int:
    if not isinstance(value, (str, list, tuple)):
        raise EvaluationError(f"'len' needs a text or a list, found {described(value)}", column)
    return len(value)


def _check_number(arguments: Sequence[Part]) -> None:
    (only,) = arguments
    is_number = only.kind is ValueKind.NUMBER
    hint = "it is a number already, leave 'number' out" if is_number else ""
    only.must_be(ValueKind.TEXT, "'number' needs a text", hint)


def _number(value: object, column: int) -> float:
    if isinstance(value, str):
        return bounded(_number_in(value, column), "number", column)
    return bounded(a_number(value, "number", column), "number", column)


def _number_in(text: str, column: int) -> float:
    """Return the only number in a text; its decimal point may be a comma."""
    found = [match[0] for match in islice(_IN_DIGITS.finditer(text), 2)]
    problem = ""
    if len(found) != 1:
        problem = "several" if found else "none in digits"
    elif _MAYBE_THOUSANDS.fullmatch(found[0]):
        problem = f"'{ellipsize(found[0])}', which may be read in two ways,"
    if problem:
        message = f"'number' needs one number, found {problem} in {described(text)}"
        raise NoNumber(message, column)
    number = float(found[0].replace(",", "."))
    return int(number) if abs(number) < _WHOLE_FROM and number.is_integer() else number


def _check_known(arguments: Sequence[Part]) -> None:
    (only,) = arguments
    if only.constant is not None:
        raise only.error("'known' asks about a name", "write one, such as known(scene.age)")


def _compile_known(arguments: Sequence[Part], _: int) -> Evaluator:
    of = arguments[0].run

    def run(lookup: Lookup) -> bool:
        try:
            of(lookup)
        except NoValue:
            return False
        return True

    return run


def _check_lower(arguments: Sequence[Part]) -> None:
    arguments[0].must_be(ValueKind.TEXT, "'lower' needs a text")


def _lower(value: object, column: int) -> str:
    return _a_text(value, "lower", column).lower()


def _check_contains(arguments: Sequence[Part]) -> None:
    where, *wanted = arguments
    hint = "look for a value in a list with 'in': 'word' in the_list"
    is_list = where.kind is ValueKind.LIST
    where.must_be(ValueKind.TEXT, "'contains' looks into a text", hint if is_list else "")
    for one in wanted:
        one.must_be(ValueKind.TEXT, "'contains' looks for texts", "put it in quotation marks")
        if one.constant == "":
            raise one.error("every text contains the empty text", "write what to look for")


def _stands_in(words: str, text: str) -> bool:
    """Return whether words occur in a text as whole words, in upper or lower case."""
    return re.search(rf"(?<!\w){re.escape(folded(words))}(?!\w)", folded(text)) is not None


def _compile_contains(arguments: Sequence[Part], column: int) -> Evaluator:
    where_of, *wanted = (argument.run for argument in arguments)

    def run(lookup: Lookup) -> bool:
        where = _a_text(where_of(lookup), "contains", column)
        return any(_stands_in(_a_text(one(lookup), "contains", column), where) for one in wanted)

    return run


def _check_label(arguments: Sequence[Part]) -> None:
    (only,) = arguments
    if only.labels is None:
        raise only.error(
            "'label' needs the name of a scene parameter", "write one, such as label(live.mood)"
        )
    if not only.labels:
        raise only.error(
            "this scene parameter has no labels", "add 'labels: {1: …, 5: …}' to it in scene.yaml"
        )


def _compile_label(arguments: Sequence[Part], column: int) -> Evaluator:
    (only,) = arguments
    of, labels = only.run, only.labels or ()
    return lambda lookup: nearest_label(labels, a_number(of(lookup), "label", column))


def _labels(arguments: Sequence[Part]) -> tuple[str, ...]:
    return tuple(word for part in arguments for _, word in part.labels or () if word)


def _a_text(value: object, word: str, column: int) -> str:
    if not isinstance(value, str):
        raise EvaluationError(f"'{word}' needs texts, found {described(value)}", column)
    return value


FUNCTIONS: dict[str, Function] = {
    function.name: function
    for function in (
        _extreme("min", "the smallest number", min),
        _extreme("max", "the largest number", max),
        Function(
            name="abs",
            usage="abs(x)",
            means="a number without its sign",
            check_kinds=_check_abs,
            compile=_of_one(_abs),
        ),
        Function(
            name="round",
            usage="round(x) or round(x, 2) for two digits after the point",
            means="the nearest whole number, or number with that many digits",
            check_kinds=_check_round,
            compile=_compile_round,
            most=2,
        ),
        Function(
            name="len",
            usage="len(x)",
            means="the number of letters or values",
            check_kinds=_check_len,
            compile=_of_one(_len),
        ),
        Function(
            name="number",
            usage="number(text)",
            means="the number in a text, in digits: 4 in 'about 4'; fails when there is none, or "
            "several",
            check_kinds=_check_number,
            compile=_of_one(_number),
        ),
        Function(
            name="known",
            usage="known(x)",
            means="true if x has a value, false if it is missing",
            check_kinds=_check_known,
            compile=_compile_known,
            gives=ValueKind.BOOLEAN,
            asks_for_missing=True,
        ),
        Function(
            name="lower",
            usage="lower(text)",
            means="the text in small letters",
            check_kinds=_check_lower,
            compile=_of_one(_lower),
            gives=ValueKind.TEXT,
        ),
        Function(
            name="contains",
            usage="contains(text, 'a', 'b')",
            means="true if the first text contains one of the others, as whole words",
            check_kinds=_check_contains,
            compile=_compile_contains,
            least=2,
            most=math.inf,
            gives=ValueKind.BOOLEAN,
        ),
        Function(
            name="label",
            usage="label(live.mood)",
            means="the word that scene.yaml has for the nearest value of a scene parameter",
            check_kinds=_check_label,
            compile=_compile_label,
            gives=ValueKind.TEXT,
            words=_labels,
        ),
    )
}
"""Every function by name."""
