# SPDX-License-Identifier: Apache-2.0
"""Parser and compiler of expressions such as ``scene.age >= 4``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import ParamSpec, TypeVar

from bt_agents_core.scene import Labels
from bt_agents_core.text import ellipsize
from bt_agents_language.expression import conditions, expression_hints, ranges
from bt_agents_language.expression.conditions import Condition, Domain
from bt_agents_language.expression.expression_tokens import (
    ExpressionError,
    Token,
    TokenKind,
    tokenize,
)
from bt_agents_language.expression.expression_values import (
    ANY_LABELS,
    EvaluationError,
    Evaluator,
    Lookup,
    NoValue,
    Part,
    Undecided,
    ValueKind,
    common_kind,
    common_unit,
    described,
    unit_of_call,
    unit_of_pair,
)
from bt_agents_language.expression.functions import FUNCTIONS
from bt_agents_language.expression.operators import (
    BINARY,
    COMPARISON,
    PREFIXES,
    check_between,
    compile_between,
)
from bt_agents_language.expression.ranges import Range
from bt_agents_language.expression.units import Dimension

P = ParamSpec("P")
T = TypeVar("T")

MAX_LENGTH = 1000
"""Longest expression in characters."""

MAX_DEPTH = 32
"""Maximum nesting of brackets, ``not`` and minus signs."""

_LONGEST_TOLD = 200


class MisfitError(ExpressionError):
    """Values in an expression do not fit their operators.

    Attributes:
        errors: All errors, perhaps with the word that ended the reading; this one comes first.
        mentions: Names in the expression; none if reading ended early.
    """

    def __init__(self, errors: Sequence[ExpressionError], mentions: Iterable[Mention]) -> None:
        first = errors[0]
        super().__init__(first.message, first.column, first.hint, first.width)
        self.errors = tuple(errors)
        self.mentions = tuple(mentions)


class MissingValue(NoValue):
    """Current lack of a value for a name; a lookup raises it and an evaluation passes it on."""

    def __init__(self, name: str) -> None:
        super().__init__(f"'{name}' has no value")
        self.name = name


class StaleValue(MissingValue):
    """Name of the live scene whose last value is too old to be current."""

    def __init__(self, name: str, silent_s: float) -> None:
        super().__init__(name)
        self.args = (f"'{name}' is stale: the scene layer has been silent for {silent_s:.1f} s",)


@dataclass(frozen=True, kw_only=True, slots=True)
class Mention:
    """A name in an expression and the column where it starts, from 1.

    Its value may be missing where ``known`` tests or ``else`` replaces it.
    """

    name: str
    column: int
    may_miss: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Foregone:
    """A condition with the same result for all possible values of its names.

    Attributes:
        always: Whether it is always true; otherwise it is never true.
        joint: The ``and`` or ``or`` with this result; empty for a single comparison.
    """

    column: int
    width: int
    names: tuple[str, ...]
    always: bool
    joint: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Expression:
    """Parsed expression; two are equal if their texts and the texts that they name are equal.

    Attributes:
        text: As written, without spaces around it.
        mentions: Every name in it with its place in the parsed text.
        kind: Kind of its value, if known before a run.
        unit: Dimension of its value; None for a plain number, or no number.
        range: Range of its value, as far as the ranges of the names determine it.
        foregone: Conditions in it that the ranges and texts of the names decide.
        texts: Names in it that always have the same text, with that text.
    """

    text: str
    mentions: tuple[Mention, ...] = field(compare=False)
    names: frozenset[str] = field(compare=False, repr=False)
    kind: ValueKind | None = field(compare=False)
    unit: Dimension | None = field(compare=False)
    range: Range | None = field(compare=False)
    foregone: tuple[Foregone, ...] = field(compare=False)
    _run: Evaluator = field(compare=False, repr=False)
    _conjuncts: tuple[tuple[str, Evaluator], ...] = field(compare=False, repr=False)
    texts: tuple[tuple[str, str], ...] = ()

    def evaluate(self, lookup: Lookup) -> object:
        """Return its value.

        Raises:
            EvaluationError: Values do not fit the operators, or it divides by zero.
            MissingValue: Passed on from ``lookup``.
        """
        return self._run(lookup)

    def is_true(self, lookup: Lookup) -> bool:
        """Return whether it is true as a condition.

        Raises:
            Undecided: It cannot be evaluated, or its value is neither true nor false.
            MissingValue: Passed on from ``lookup``.
        """
        try:
            value = self._run(lookup)
        except EvaluationError as error:
            raise self._undecided(error.message, error.column) from None
        if value is True or value is False:
            return value
        raise self._undecided(f"it is {described(value)}, expected true or false", 1)

    def unmet(self, lookup: Lookup) -> str:
        """Return the first false one of the conditions joined by ``and``; else the whole text.

        Use it for a condition that is false according to :meth:`is_true`.
        """
        for text, run in self._conjuncts:
            with suppress(NoValue, EvaluationError):
                if run(lookup) is False:
                    return text
        return self.text

    def _undecided(self, why: str, column: int) -> Undecided:
        told = ellipsize(self.text, _LONGEST_TOLD)
        return Undecided(f"cannot be decided: {told} ({why})", column)


def _nothing_known(_: str) -> None:
    """Return what is known of a name: nothing."""


def parse_expression(
    text: str,
    kind_of: Callable[[str], ValueKind | None] = _nothing_known,
    unit_of: Callable[[str], Dimension | None] = _nothing_known,
    words_of: Mapping[str, tuple[str, ...]] | None = None,
    range_of: Callable[[str], Range | None] = _nothing_known,
    labels_of: Callable[[str], Labels | None] = _nothing_known,
    texts: Mapping[str, str] | None = None,
    choices_of: Callable[[str], Sequence[str]] = lambda _: (),
) -> Expression:
    """Return the expression in a text.

    From weak to strong: ``or``, ``and``, ``not``, one of ``== != < <= > >= in, not in,
    between … and …``, ``+ -``, ``* / %``, the minus sign, ``else``. Operands are numbers, quoted
    texts, ``true``, ``false``, dotted names, lists such as ``[1, 2]`` and the functions of
    :mod:`~bt_agents_language.expression.functions`.

    Args:
        text: At most 1,000 characters.
        kind_of: Kind of a name's value, None if known only at run time.
        unit_of: Dimension of a name's value, None for a plain number or no number.
        words_of: Name → the only texts that it can be.
        range_of: Range of a name's value, None if unknown.
        labels_of: Words for the values of a scene parameter, None for other names.
        texts: Name → the text that it always has.
        choices_of: Possible texts of a name, as far as the file determines them; empty for any.

    Raises:
        ExpressionError: The text is not an expression.
        MisfitError: Values in it do not fit.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(
            f"the expression has {len(text)} characters, at most {MAX_LENGTH} are possible",
            1,
            "split it over several nodes",
        )
    try:
        tokens = tokenize(text)
    except ExpressionError as error:
        raise expression_hints.with_phrase(error, text, range_of) from None
    parser = _Parser(
        tokens, kind_of, unit_of, words_of or {}, range_of, labels_of, texts or {}, choices_of
    )
    try:
        whole = parser.whole()
    except ExpressionError as error:
        told = expression_hints.with_phrase(error, text, range_of)
        if parser.misfits:
            raise MisfitError([*parser.misfits, told], ()) from None
        raise told from None
    if parser.misfits:
        raise MisfitError(parser.misfits, parser.mentions)
    return Expression(
        text=text.strip(),
        mentions=tuple(parser.mentions),
        names=frozenset(mention.name for mention in parser.mentions),
        kind=whole.kind,
        unit=whole.unit,
        range=whole.range,
        foregone=tuple(parser.foregone),
        texts=tuple(parser.texts.items()),
        _run=whole.run,
        _conjuncts=tuple((text[start:end].strip(), run) for start, end, run in parser.conjuncts),
    )


def parse_parts(text: str) -> Part:
    """Return a sound expression with all of its parts, whatever its names are.

    Raises:
        ExpressionError: The text is not an expression.
    """
    nothing = _nothing_known
    return _Parser(
        tokenize(text), nothing, nothing, {}, nothing, lambda _: ANY_LABELS, {}, lambda _: ()
    ).whole()


class _Parser:
    """Pratt parser for the tokens of one expression."""

    def __init__(
        self,
        tokens: list[Token],
        kind_of: Callable[[str], ValueKind | None],
        unit_of: Callable[[str], Dimension | None],
        words_of: Mapping[str, tuple[str, ...]],
        range_of: Callable[[str], Range | None],
        labels_of: Callable[[str], Labels | None],
        texts: Mapping[str, str],
        choices_of: Callable[[str], Sequence[str]],
    ) -> None:
        self.mentions: list[Mention] = []
        self.foregone: list[Foregone] = []
        self.misfits: list[ExpressionError] = []
        self.texts: dict[str, str] = {}
        self.conjuncts: list[tuple[int, int, Evaluator]] = []
        self._tokens = tokens
        self._kind_of = kind_of
        self._unit_of = unit_of
        self._words_of = words_of
        self._range_of = range_of
        self._labels_of = labels_of
        self._texts = texts
        self._choices_of = choices_of
        self._token = tokens[0]
        self._next = 0
        self._depth = 0

    def whole(self) -> Part:
        if self._at_end():
            raise ExpressionError(
                "there is no expression", 1, "write one, for example scene.age >= 4"
            )
        part = self._expression(0)
        if not self._at_end():
            raise self._unexpected()
        return part

    def _at_end(self) -> bool:
        return self._token.kind is TokenKind.END

    def _take(self) -> Token:
        token = self._token
        if token.kind is not TokenKind.END:
            self._next += 1
            self._token = self._tokens[self._next]
        return token

    def _unexpected(self) -> ExpressionError:
        before = self._tokens[self._next - 1] if self._next else None
        after = None if self._at_end() else self._tokens[self._next + 1]
        labels = self._labels_of(before.text) if before is not None else None
        labels = None if labels is ANY_LABELS else labels
        return expression_hints.unexpected(self._token, before, after, labels)

    def _expression(self, weakest: int) -> Part:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._token.error(
                f"the expression is nested more than {MAX_DEPTH} deep",
                "split it over several nodes",
            )
        first, foregone = len(self.mentions), len(self.foregone)
        left = self._operand()
        while True:
            token = self._token
            if token.kind is not TokenKind.OPERATOR:
                break
            if token.text == "between" and weakest < COMPARISON:
                self._take()
                left = self._between(left, token)
                self._note_foregone(left, first, foregone)
                self._refuse_chain()
                continue
            operator = BINARY.get(token.text)
            if operator is None or operator.strength <= weakest:
                break
            self._take()
            if operator.replaces_missing:
                self._let_miss(first)
            beginning = self._token.column - 1
            end = token.column - 1
            right = self._expression(operator.strength)
            if self._depth == 1:
                self._note_conjuncts(operator.word, left, right, end, beginning)
            self._attempt(operator.check, left, right)
            operands = left, right
            left = Part(
                run=operator.compile(left, right, token.column),
                kind=operator.gives or common_kind(left, right),
                column=left.column,
                width=left.width,
                unit=self._attempt(unit_of_pair, operator.word, left, right),
                range=ranges.of_pair(operator.word, left.range, right.range),
                operator=operator.word,
                operands=operands,
            )
            if not operator.chains:
                left = self._compared(left, *operands)
                self._note_foregone(left, first, foregone)
                self._refuse_chain()
            elif operator.gives is ValueKind.BOOLEAN:
                left = self._joined(operator.word, left, *operands)
                self._note_foregone(left, first, foregone, operator.word)
        self._depth -= 1
        return left

    def _note_conjuncts(
        self, word: str, left: Part, right: Part, end: int, beginning: int
    ) -> None:
        """Note the operands of an ``and`` at the top level.

        Args:
            word: The operator just read.
            left: Operand before it.
            right: Operand after it.
            end: Offset of the end of the operand before it.
            beginning: Offset of the beginning of the operand after it.
        """
        if word != "and":
            self.conjuncts.clear()
            return
        if not self.conjuncts:
            self.conjuncts.append((self._tokens[0].column - 1, end, left.run))
        last = self._tokens[self._next - 1]
        self.conjuncts.append((beginning, last.column - 1 + len(last.text), right.run))

    def _let_miss(self, first: int) -> None:
        """Mark the names from an index on as those that may be without a value."""
        mentions = self.mentions[first:]
        self.mentions[first:] = [replace(mention, may_miss=True) for mention in mentions]

    def _between(self, value: Part, token: Token) -> Part:
        opening = self._token
        second = self._tokens[min(self._next + 2, len(self._tokens) - 1)]
        # As in ``between [2, 4]`` and ``between (2, 4)``.
        if opening.text == "[" or (opening.text == "(" and second.text == ","):
            raise expression_hints.bad_between(opening)
        low = self._expression(COMPARISON)
        joint = self._token
        if joint.text != "and":
            raise expression_hints.bad_between(joint)
        self._take()
        high = self._expression(COMPARISON)
        self._attempt(check_between, value, low, high)
        self._attempt(common_unit, "between", (value, low, high))
        between = Part(
            run=compile_between(value, low, high, token.column),
            kind=ValueKind.BOOLEAN,
            column=value.column,
            width=value.width,
            range=ranges.of_between(value.range, low.range, high.range),
            operator="between",
            operands=(value, low, high),
        )
        return self._compared(between, value, low, high)

    def _compared(self, comparison: Part, *operands: Part) -> Part:
        """Return a comparison with its condition, if constants determine that."""
        names = [one.name for one in operands if one.name]
        others = [one for part in operands if not part.name for one in (part.members or (part,))]
        constants = [one.constant for one in others if one.constant is not None]
        if len(names) != 1 or len(constants) < len(others):
            return comparison
        condition = conditions.of_comparison(comparison.run, names[0], constants)
        return replace(comparison, condition=condition)

    def _joined(self, word: str, whole: Part, left: Part, right: Part) -> Part:
        """Return two conditions joined by ``and`` or ``or``, with their joint condition."""
        one, other = _condition_of(left), _condition_of(right)
        return replace(whole, condition=conditions.joined(word, one, other))

    def _always(self, whole: Part) -> bool | None:
        """Return the constant result of a condition; None if both are possible."""
        if whole.range is not None and whole.range.settled:
            return whole.range == ranges.TRUE
        if whole.condition is None:
            return None
        try:
            return conditions.verdict(whole.condition, self._domain)
        except EvaluationError:
            return None

    def _domain(self, name: str) -> Domain:
        return Domain(
            range=self._range_of(name), texts=self._words_of.get(name) or self._choices_of(name)
        )

    def _attempt(self, check: Callable[P, T], *values: P.args, **named: P.kwargs) -> T | None:
        """Return the result of a check; note its error, if any, and continue."""
        try:
            return check(*values, **named)
        except ExpressionError as error:
            self.misfits.append(error)
            return None

    def _note_foregone(self, whole: Part, before: int, noted: int, joint: str = "") -> None:
        """Note a condition just read that has a constant result.

        Args:
            whole: The condition.
            before: Number of names before it.
            noted: Number of conditions noted before it; ones noted within it are enough.
            joint: The word that joins its parts.
        """
        names = tuple(dict.fromkeys(mention.name for mention in self.mentions[before:]))
        if not names or len(self.foregone) > noted:
            return
        always = self._always(whole)
        if always is not None:
            last = self._tokens[self._next - 1]
            self.foregone.append(
                Foregone(
                    column=whole.column,
                    width=last.column + len(last.text) - whole.column,
                    names=names,
                    always=always,
                    joint=joint,
                )
            )

    def _refuse_chain(self) -> None:
        token = self._token
        following = BINARY.get(token.text) if token.kind is TokenKind.OPERATOR else None
        if token.text == "between" or (following is not None and not following.chains):
            raise token.error(
                f"two comparisons in a row: '{token.text}' follows another one",
                "join them with and: 2 <= x and x <= 4; or write x between 2 and 4",
            )

    def _operand(self) -> Part:
        token = self._take()
        kind = token.kind
        if kind is TokenKind.NAME:
            if token.text in FUNCTIONS or self._token.text == "(":
                return self._call(token)
            return self._name(token)
        if kind is TokenKind.OPERATOR:
            if token.text in PREFIXES:
                return self._prefixed(token)
            if token.text == "(":
                return self._parentheses(token)
            if token.text == "[":
                return self._list(token)
        elif kind is not TokenKind.END:
            value = token.value
            return Part(
                run=lambda _: value,
                kind=ValueKind.of(value),
                column=token.column,
                width=len(token.text),
                constant=value,
                range=ranges.of_constant(value),
            )
        raise expression_hints.no_operand(token)

    def _prefixed(self, token: Token) -> Part:
        prefix = PREFIXES[token.text]
        operand = self._expression(prefix.strength)
        self._attempt(prefix.check, operand)
        constant = operand.constant
        negative = -constant if isinstance(constant, (int, float)) else None
        return Part(
            run=prefix.compile(operand, token.column),
            kind=prefix.gives,
            column=token.column,
            width=len(token.text),
            constant=negative if token.text == "-" else None,
            unit=operand.unit,
            range=ranges.of_prefix(token.text, operand.range),
            condition=(
                conditions.negated(_condition_of(operand)) if token.text == "not" else None
            ),
            operator=token.text,
            operands=(operand,),
        )

    def _name(self, token: Token) -> Part:
        name = token.text
        if name in expression_hints.NO_VALUES:
            raise expression_hints.no_value(token)
        self.mentions.append(Mention(name=name, column=token.column))
        if name in self._texts:
            text = self.texts[name] = self._texts[name]
            return Part(
                run=lambda _: text,
                kind=ValueKind.TEXT,
                column=token.column,
                width=len(name),
                constant=text,
            )
        return Part(
            run=lambda lookup: lookup(name),
            kind=self._kind_of(name),
            column=token.column,
            width=len(name),
            unit=self._unit_of(name),
            words=self._words_of.get(name, ()),
            range=self._range_of(name),
            labels=self._labels_of(name),
            name=name,
        )

    def _parentheses(self, opening: Token) -> Part:
        inner = self._expression(0)
        if self._token.text == ",":
            raise opening.error("a list needs square brackets, not parentheses", "write [ … ]")
        self._close(opening, ")")
        return inner

    def _list(self, opening: Token) -> Part:
        items = self._items(opening, "]")
        if not items:
            raise opening.error("this list is empty", "write at least one value in it")
        kinds = [item.kind for item in items if item.kind is not None]
        for item in items:
            if item.kind is ValueKind.LIST:
                raise item.error("a list cannot stand in a list", "write one list")
            if item.kind is not None and item.kind is not kinds[0]:
                raise item.error(
                    f"this list holds {kinds[0].many}, found {item.kind.one}",
                    "write values of one kind",
                )
        runs = [item.run for item in items]
        constants = tuple(item.constant for item in items)
        return Part(
            run=(
                (lambda lookup: tuple(run(lookup) for run in runs))
                if None in constants
                else (lambda _: constants)
            ),
            kind=ValueKind.LIST,
            column=opening.column,
            width=1,
            items=kinds[0] if kinds else None,
            members=items,
            range=ranges.of_list([item.range for item in items]),
            operator=opening.text,
            operands=tuple(items),
        )

    def _call(self, token: Token) -> Part:
        function = FUNCTIONS.get(token.text)
        if function is None:
            raise expression_hints.unknown_function(token, FUNCTIONS)
        opening = self._token
        if opening.text != "(":
            raise token.error(
                f"'{token.text}' is a function, its values stand in parentheses",
                f"write {function.usage}",
            )
        self._take()
        first = len(self.mentions)
        arguments = self._items(opening, ")")
        if function.asks_for_missing:
            self._let_miss(first)
        function.check(arguments, token.column)
        return Part(
            run=function.compile(arguments, token.column),
            kind=function.gives,
            column=token.column,
            width=len(token.text),
            unit=unit_of_call(token.text, arguments),
            words=function.words(arguments),
            range=ranges.of_call(token.text, [argument.range for argument in arguments]),
            operator=token.text,
            operands=tuple(arguments),
        )

    def _items(self, opening: Token, closing: str) -> list[Part]:
        """Read the expressions up to and including a closing bracket."""
        items: list[Part] = []
        if self._token.text == closing:
            self._take()
            return items
        items.append(self._expression(0))
        while self._token.text == ",":
            self._take()
            items.append(self._expression(0))
        self._close(opening, closing)
        return items

    def _close(self, opening: Token, closing: str) -> None:
        if self._token.text == closing:
            self._take()
            return
        if self._at_end():
            raise opening.error(f"this '{opening.text}' is not closed", f"add a '{closing}'")
        raise self._unexpected()


def _condition_of(part: Part) -> Condition:
    """Return the condition of a part; an unknown one may be true or false."""
    return part.condition or conditions.of_truth(part.name or f"at {part.column}")
