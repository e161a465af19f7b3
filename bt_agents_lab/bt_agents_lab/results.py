# SPDX-License-Identifier: Apache-2.0
"""Results of experiments and journals as one typed table: rounds, bids and feedback."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import finite_or_none
from marketplace_node.outcomes import AuctionOutcome

if TYPE_CHECKING:
    from feedback_node.learning.profiles import ProfileChange
    from marketplace_node.effects import PublishAuction

ResultRow = Mapping[str, object]
"""Row with the keys of :func:`result_columns`; missing cells are unknown."""


ResultColumns = Mapping[str, type]
"""Key of each column → ``str``, ``int``, ``float`` or ``bool``."""

_FIXED: ResultColumns = {
    "row": str,
    "epoch": str,
    "round": int,
    "time_s": float,
    "scene_id": str,
    "scene": str,
    "strategy": str,
    "outcome": str,
    "agent": str,
    "host": str,
    "margin": float,
    "rank": int,
    "distance": float,
    "bonus": float,
    "score": float,
    "runs": int,
    "kind": str,
    "source": str,
    "layer": str,
    "learning_rate": float,
    "weight": float,
    "wrong": bool,
    "false_rate": float,
    "reason": str,
}

_VECTORS = ("value", "before", "after", "target")
"""Vectors; each has a column for every scene parameter."""


def result_columns(parameters: Sequence[str]) -> ResultColumns:
    """Return the columns of results for these scene parameters."""
    vectors = (f"{of}_{name}" for of in _VECTORS for name in parameters)
    return {**_FIXED, **dict.fromkeys(vectors, float)}


def rows_of_decision(effect: PublishAuction) -> Iterator[ResultRow]:
    """Return the rows of a round: the round, its accepted bids and its refused bids."""
    decision = effect.decision
    winner = "" if decision.winner is None else decision.winner.agent
    return _rows_of_round(decision.terms, decision, winner, effect.reason, {})


def rows_of_auction(auction: Any) -> Iterator[ResultRow]:
    """Return the rows of :func:`rows_of_decision`, with times, for an ``Auction`` message."""
    times = {"time_s": _seconds(auction.header.stamp)}
    return _rows_of_round(auction, auction, auction.winner, auction.reason, times)


def _rows_of_round(
    terms: Any, decision: Any, winner: str, reason: str, times: ResultRow
) -> Iterator[ResultRow]:
    """Return the rows of a round; an ``Auction`` message has both its terms and its decision."""
    common = {
        **times,
        "epoch": terms.epoch,
        "round": terms.round,
        "scene_id": terms.scene.scene_id,
        "scene": terms.scene.label,
        "strategy": terms.strategy,
    }
    values = terms.scene.values
    names = [value.name for value in values]
    yield {
        **common,
        "row": "round",
        "outcome": AuctionOutcome(decision.outcome).name.lower(),
        "agent": winner or None,
        "margin": decision.margin,
        "reason": reason,
        **_vector("value", names, [value.value for value in values]),
    }
    for rank, bid in enumerate(decision.ranking, start=1):
        yield {
            **common,
            "row": "bid",
            "outcome": "won" if bid.agent == winner else "lost",
            "agent": bid.agent,
            "host": bid.host,
            "rank": rank,
            "distance": bid.distance,
            "bonus": bid.bonus,
            "score": bid.score,
            "runs": bid.runs,
            **_vector("value", names[: len(bid.vector)], bid.vector),
        }
    for one in decision.refused:
        yield {
            **common,
            "row": "bid",
            "outcome": one.code.lower(),
            "agent": one.agent or None,
            "host": one.host,
            "reason": one.reason,
        }


def row_of_change(
    change: ProfileChange, parameters: Sequence[str], wrong: bool | None
) -> ResultRow:
    """Return the row of a profile change by feedback that was wrong, right or unknown."""
    revision = change.revision
    row = _row_of_feedback(revision.cause, revision, change, parameters)
    return {**row, "learning_rate": revision.cause.rate, "wrong": wrong}


def row_of_feedback(feedback: Any, wrong: bool | None = None) -> ResultRow:
    """Return the row of :func:`row_of_change`, with its time, for a ``Feedback`` message."""
    row = _row_of_feedback(feedback, feedback, feedback, feedback.parameters)
    times = {"time_s": _seconds(feedback.header.stamp)}
    return {**row, **times, "learning_rate": feedback.learning_rate, "wrong": wrong}


def _row_of_feedback(
    cause: Any, revision: Any, change: Any, parameters: Sequence[str]
) -> ResultRow:
    """Return what the rows share; a ``Feedback`` message is cause, revision and change in one."""
    return {
        "row": "feedback",
        "epoch": cause.epoch or None,
        "round": cause.round or None,
        "agent": revision.agent,
        "kind": FeedbackKind(cause.kind).name.lower(),
        "source": cause.source,
        "layer": revision.layer,
        "weight": cause.weight,
        "false_rate": change.false_rate,
        "reason": cause.reason,
        **_vector("before", parameters, change.before),
        **_vector("after", parameters, change.after),
        **_vector("target", parameters, change.target),
    }


def _vector(of: str, names: Sequence[str], values: Sequence[float]) -> ResultRow:
    return {f"{of}_{name}": value for name, value in zip(names, values, strict=True)}


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9)


class ResultFile:
    """File of results, whose extension determines the format."""

    def __init__(self, path: Path) -> None:
        """Make the file first, so that no results are computed in vain.

        Raises:
            BtAgentsError: It is not writable, has no known format, or pyarrow is missing.
        """
        self.path = path
        write = {".csv": _write_csv, ".parquet": _write_parquet}.get(path.suffix)
        if write is None:
            raise BtAgentsError(f"{path} ends in '{path.suffix}', expected .csv or .parquet")
        self._write = write
        if write is _write_parquet:
            _import_pyarrow()
        try:
            path.open("a").close()
        except OSError as error:
            raise self._unwritten(error) from None

    def write(self, parameters: Sequence[str], rows: Iterable[ResultRow]) -> None:
        """Replace the content of the file.

        Raises:
            BtAgentsError: It is not writable.
        """
        columns = result_columns(parameters)
        try:
            self._write(self.path, columns, [_known(row, columns) for row in rows])
        except OSError as error:
            raise self._unwritten(error) from None

    def _unwritten(self, error: OSError) -> BtAgentsError:
        return BtAgentsError(
            f"{self.path} cannot be written: {error.strerror or error}; name another file"
        )


def _known(row: ResultRow, columns: ResultColumns) -> list[object]:
    """Return the cells of a row; None for unknown values, including NaN."""
    found = map(row.get, columns)
    return [finite_or_none(cell) if isinstance(cell, float) else cell for cell in found]


def _write_csv(path: Path, columns: ResultColumns, rows: Sequence[Sequence[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(
            [str(cell).lower() if isinstance(cell, bool) else cell for cell in row] for row in rows
        )


def _write_parquet(path: Path, columns: ResultColumns, rows: Sequence[Sequence[object]]) -> None:
    arrow, parquet = _import_pyarrow()
    types = {str: arrow.string(), int: arrow.int64(), float: arrow.float64(), bool: arrow.bool_()}
    schema = arrow.schema([(key, types[kind]) for key, kind in columns.items()])
    cells = [[row[place] for row in rows] for place in range(len(columns))]
    arrays = [arrow.array(c, type=f.type) for c, f in zip(cells, schema, strict=True)]
    parquet.write_table(arrow.table(arrays, schema=schema), path)


def _import_pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise BtAgentsError(
            f"Parquet needs the package {error.name}; install it with "
            "pip install 'bt-agents[lab]', or name a file that ends in .csv"
        ) from None
    return pyarrow, pyarrow.parquet
