# SPDX-License-Identifier: Apache-2.0
"""Assertions of a test about the result of a rehearsal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar
from unicodedata import normalize

from bt_agents.engine.run import TreeOutcome
from bt_agents_core.diagnostic import Position
from bt_agents_core.field_types import Plain
from bt_agents_core.text import folded
from bt_agents_language.files.testing.path_patterns import matches
from bt_agents_language.files.testing.scenarios import (
    AgentTestCase,
    Because,
    CancelledBy,
    Does,
    DoesNot,
    Ends,
    Expectation,
    ExpectedBids,
    Remembers,
    Says,
    SkillUse,
    Teaches,
    Tells,
    Visits,
    Within,
)
from bt_agents_language.nodes.node_type import Mark
from bt_agents_tools.rehearsal.events import Rehearsed, Use
from bt_agents_tools.rehearsal.transcript import phrase, time_text, value_text

Row = tuple[str, str, bool]
"""Texts of the expected and the found value, and whether they match."""

E = TypeVar("E")
F = TypeVar("F")

_NOTHING = "–"
_TOLERANCE_S = 1e-6


@dataclass(frozen=True, kw_only=True)
class AssertionFailure:
    """Unfulfilled expectation; lists have rows of expected and found entries."""

    position: Position
    message: str
    rows: tuple[Row, ...] = ()


def failed_assertions(case: AgentTestCase, rehearsed: Rehearsed) -> tuple[AssertionFailure, ...]:
    """Return the unfulfilled expectations of a case."""
    wanted = {type(one) for one in case.expectations}
    found: list[AssertionFailure] = []
    if rehearsed.declined and ExpectedBids not in wanted:
        message = (
            f"the agent does not bid for this scene, it {rehearsed.declined}; change the scene, "
            "or expect 'bids: false'"
        )
        return (AssertionFailure(position=case.position, message=message),)
    if rehearsed.outcome is None and not rehearsed.declined and Ends not in wanted:
        message = f"the run did not end: {rehearsed.message}"
        found.append(AssertionFailure(position=case.position, message=message))
    told = [folded(one.words) for one in case.expectations if isinstance(one, Because)]
    for reason in rehearsed.undecided:
        if not any(words in folded(reason) for words in told):
            message = f"{reason}; fix it, or expect 'because: cannot be decided'"
            found.append(AssertionFailure(position=case.position, message=message))
    for one in case.expectations:
        failure = _check(one, rehearsed)
        if failure is not None:
            found.append(failure)
    return tuple(found)


def _values(
    wanted: Expectation, what: str, expected: Mapping[str, Plain], found: Mapping[str, Plain]
) -> AssertionFailure | None:
    """Compare expected values; if none is expected, none may exist."""

    def entry(name: str, values: Mapping[str, Plain]) -> str:
        return f"{name} {value_text(values[name])}" if name in values else _NOTHING

    rows = [
        (
            entry(name, expected),
            entry(name, found),
            name in expected and name in found and expected[name] == found[name],
        )
        for name in expected or found
    ]
    if all(same for _, _, same in rows):
        return None
    return _failure(wanted, f"{what}: other values than expected", rows)


def _check(wanted: Expectation, rehearsed: Rehearsed) -> AssertionFailure | None:
    match wanted:
        case ExpectedBids():
            if wanted.wanted == (not rehearsed.declined):
                return None
            if wanted.wanted:
                return _failure(wanted, f"bids: expected a bid, but it {rehearsed.declined}")
            return _failure(wanted, "bids: expected no bid, but nothing speaks against one")
        case Says():
            texts = [value_text(use.main) for use in rehearsed.uses if use.spoken]
            pairs = aligned(wanted.texts, texts, _same_words, exact=wanted.exact)
            return _compared(wanted, "says", pairs, wanted.exact)
        case Does():
            uses = aligned(wanted.uses, rehearsed.uses, _fits, exact=wanted.exact)
            shown = [
                (
                    None if expected is None else _use_text(expected),
                    None if found is None else phrase(found.node, found.inputs),
                )
                for expected, found in uses
            ]
            return _compared(wanted, "does", shown, wanted.exact)
        case DoesNot():
            return _does_not(wanted, rehearsed.uses)
        case Visits():
            return _visits(wanted, rehearsed)
        case Ends():
            outcome = rehearsed.outcome.value if rehearsed.outcome is not None else "no end"
            if outcome == wanted.outcome:
                return None
            message = f"ends: expected {wanted.outcome}, found {outcome}"
            if rehearsed.outcome is not TreeOutcome.SUCCEEDED:
                message += f" ({rehearsed.message})"
            return _failure(wanted, message)
        case Tells():
            return _values(wanted, "told", wanted.values, rehearsed.told)
        case Remembers():
            return _values(wanted, "remembered", wanted.values, rehearsed.remembered)
        case Because():
            if folded(wanted.words) in folded(rehearsed.message):
                return None
            found = f"found '{rehearsed.message}'"
            if rehearsed.outcome is TreeOutcome.SUCCEEDED:
                found = "but the tree succeeded"
            return _failure(wanted, f"because: expected a reason with '{wanted.words}', {found}")
        case Within():
            if rehearsed.duration_s <= wanted.seconds + _TOLERANCE_S:
                return None
            took, limit = time_text(rehearsed.duration_s), time_text(wanted.seconds)
            return _failure(wanted, f"within: expected at most {limit}, found {took}")
        case Teaches():
            if wanted.kinds == rehearsed.feedback:
                return None
            expected, found = (
                ", ".join(kind.name.lower() for kind in kinds) or "none"
                for kinds in (wanted.kinds, rehearsed.feedback)
            )
            return _failure(wanted, f"feedback: expected {expected}, found {found}")
        case CancelledBy():
            cause = rehearsed.cancelled_by
            if wanted.cause == cause:
                return None
            message = f"cancelled_by: expected '{wanted.cause}', found {cause or 'nothing'}"
            return _failure(wanted, message)


def _failure(wanted: Expectation, message: str, rows: Sequence[Row] = ()) -> AssertionFailure:
    return AssertionFailure(position=wanted.position, message=message, rows=tuple(rows))


def _visits(wanted: Visits, rehearsed: Rehearsed) -> AssertionFailure | None:
    ticked = sorted(
        path
        for path, marks in rehearsed.marks.items()
        if Mark.TICKED in marks and matches(wanted.pattern, path)
    )
    if bool(ticked) == wanted.wanted:
        return None
    if wanted.wanted:
        return _failure(wanted, f"visited: {wanted.pattern} was never ticked")
    return _failure(wanted, f"not_visited: {ticked[0]} was ticked")


def _does_not(wanted: DoesNot, uses: Sequence[Use]) -> AssertionFailure | None:
    for one in wanted.uses:
        found = next((use for use in uses if _fits(one, use)), None)
        if found is not None:
            use_text = phrase(found.node, found.inputs)
            return _failure(wanted, f"does_not: expected no {_use_text(one)}, found {use_text}")
    return None


def _compared(
    wanted: Expectation, key: str, pairs: list[tuple[str | None, str | None]], exact: bool
) -> AssertionFailure | None:
    rows = _side_by_side(
        (expected or _NOTHING, found or _NOTHING, None not in (expected, found))
        for expected, found in pairs
    )
    different = [row for row in rows if not row[2]]
    if not different:
        return None
    missing = sum(row[0] != _NOTHING for row in different)
    extra = sum(row[1] != _NOTHING for row in different)
    counts = [f"{missing} missing"] * bool(missing) + [f"{extra} not expected"] * bool(extra)
    order = "in this order, these and no others" if exact else "in this order, among others"
    return _failure(wanted, f"{key}: {', '.join(counts)} ({order})", rows)


def _side_by_side(rows: Iterable[Row]) -> list[Row]:
    """Return the rows with each missing entry joined to the unexpected one in its place."""
    joined: list[Row] = []
    pending: list[int] = []
    for expected, found, same in rows:
        if same:
            pending = []
        elif pending and expected == _NOTHING:
            place = pending.pop(0)
            joined[place] = (joined[place][0], found, False)
            continue
        elif expected != _NOTHING:
            pending.append(len(joined))
        joined.append((expected, found, same))
    return joined


def aligned(
    expected: Sequence[E], found: Sequence[F], same: Callable[[E, F], bool], *, exact: bool
) -> list[tuple[E | None, F | None]]:
    """Return the longest common subsequence as pairs of expected and found, None for a gap.

    Unexpected entries are left out unless ``exact``.
    """
    rows, columns = len(expected), len(found)
    longest = [[0] * (columns + 1) for _ in range(rows + 1)]
    for i in reversed(range(rows)):
        for j in reversed(range(columns)):
            longest[i][j] = (
                1 + longest[i + 1][j + 1]
                if same(expected[i], found[j])
                else max(longest[i + 1][j], longest[i][j + 1])
            )
    pairs: list[tuple[E | None, F | None]] = []
    i = j = 0
    while i < rows or j < columns:
        if i < rows and j < columns and same(expected[i], found[j]):
            pairs.append((expected[i], found[j]))
            i, j = i + 1, j + 1
        elif j == columns or (i < rows and longest[i + 1][j] >= longest[i][j + 1]):
            pairs.append((expected[i], None))
            i += 1
        else:
            if exact:
                pairs.append((None, found[j]))
            j += 1
    return pairs


def _same_words(expected: str, found: str) -> bool:
    return normalize("NFC", expected).split() == normalize("NFC", found).split()


def _fits(wanted: SkillUse, use: Use) -> bool:
    return wanted.skill == use.skill and all(
        name in use.inputs and value_text(use.inputs[name]) == value_text(value)
        for name, value in wanted.inputs.items()
    )


def _use_text(use: SkillUse) -> str:
    """Return an expected use in the display form of uses."""
    main = use.inputs.get(use.main) if use.main is not None else None
    first = f'"{value_text(main)}"' if use.main == "text" and main else value_text(main)
    others = (
        f"{name} {value_text(value)}" for name, value in use.inputs.items() if name != use.main
    )
    return f"{use.skill} {', '.join(filter(None, (first, *others)))}".rstrip()
