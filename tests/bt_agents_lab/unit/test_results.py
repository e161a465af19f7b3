# SPDX-License-Identifier: Apache-2.0
"""Results of experiments and journals as CSV and Parquet."""

from __future__ import annotations

import csv
import math
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from pyarrow import parquet

from bt_agents_core.errors import BtAgentsError
from bt_agents_interfaces.msg import Auction
from bt_agents_lab.cli.journal import journal
from bt_agents_lab.experiments.core import through_core
from bt_agents_lab.experiments.replicas import opened
from bt_agents_lab.results import ResultFile, result_columns, rows_of_auction, rows_of_decision
from bt_agents_ros.messages import to_time
from checkout import ROOT
from journal_fixture import JournaledSystem
from marketplace_node.effects import PublishAuction
from marketplace_node.node.messages import auction_to_msg
from ranked_rounds import bids, decided, terms

EXPERIMENT = ROOT / "experiments" / "recommended"


def played(rounds: int) -> list[dict[str, Any]]:
    folder, spec = opened(EXPERIMENT)
    rows: list[Any] = []
    through_core(folder, spec.shortened(rounds), on_result=rows.append)
    return rows


def rows_in(path: Path) -> list[dict[str, Any]]:
    if path.suffix == ".parquet":
        return parquet.read_table(path).to_pylist()
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_round_has_bids_margin_and_feedback() -> None:
    rows = played(20)
    for number in range(1, 21):
        (one,) = (r for r in rows if r["row"] == "round" and r["round"] == number)
        ranked = [r for r in rows if r["row"] == "bid" and r["round"] == number]
        (feedback,) = (r for r in rows if r["row"] == "feedback" and r["round"] == number)
        assert [r["rank"] for r in ranked] == [1, 2, 3]
        assert one["margin"] == ranked[1]["score"] - ranked[0]["score"]
        assert one["agent"] == ranked[0]["agent"] == feedback["agent"]
        assert [r["outcome"] for r in ranked] == ["won", "lost", "lost"]
        assert (feedback["kind"], feedback["source"]) == ("direct", "simulated")
        assert feedback["before_age"] == ranked[0]["value_age"]


def test_experiment_feedback_states_whether_it_was_wrong() -> None:
    _, spec = opened(EXPERIMENT)
    feedbacks = [row for row in played(60) if row["row"] == "feedback"]
    names = ("age", "profession", "emotion")
    for row in feedbacks:
        target = tuple(row[f"target_{name}"] for name in names)
        assert row["wrong"] == (target != spec.feedback.each[row["agent"]])
    assert {row["wrong"] for row in feedbacks} == {True, False}


def test_csv_and_parquet_hold_same_typed_data(tmp_path: Path) -> None:
    rows = played(12)
    names = ("age", "profession", "emotion")
    for ending in ("csv", "parquet"):
        ResultFile(tmp_path / f"r.{ending}").write(names, rows)
    texts, values = rows_in(tmp_path / "r.csv"), rows_in(tmp_path / "r.parquet")
    assert len(texts) == len(values) == len(rows)
    columns = result_columns(names)
    assert list(values[0]) == list(texts[0]) == list(columns)
    for text, value, row in zip(texts, values, rows, strict=True):
        for key, kind in columns.items():
            found, given = value[key], row.get(key)
            unknown = given is None or (isinstance(given, float) and math.isnan(given))
            assert found == (None if unknown else given)
            assert found is None or type(found) is kind
            shown = "" if found is None else str(found)
            assert text[key] == (shown.lower() if kind is bool else shown)


def test_decided_and_published_rounds_give_the_same_rows() -> None:
    decision = decided(terms(), bids({"a": (3.0, 3.0, 2.0), "b": (1.0, 1.0, 1.0)}))
    effect = PublishAuction(decision=decision)
    message = auction_to_msg(effect, to_time(12.5))
    here, there = list(rows_of_decision(effect)), list(rows_of_auction(message))
    assert all(row.pop("time_s") == 12.5 for row in there)
    assert here == there


def test_journal_exports_all_rows(journaled: JournaledSystem, tmp_path: Path) -> None:
    file, table = journaled.write(tmp_path / "a.mcap"), tmp_path / "a.parquet"
    result = CliRunner().invoke(journal, [str(file), "--out", str(table)])
    assert result.exit_code == 0, result.output
    rows = rows_in(table)
    auctions = [one.message for one in journaled.published if isinstance(one.message, Auction)]
    rounds = [(row["round"], row["agent"]) for row in rows if row["row"] == "round"]
    assert rounds == [(one.round, one.winner) for one in auctions]
    assert sum(row["row"] == "bid" for row in rows) == sum(len(one.ranking) for one in auctions)
    feedbacks = [(row["wrong"], row["source"]) for row in rows if row["row"] == "feedback"]
    assert feedbacks == [(None, "button")] * 4


def test_missing_pyarrow_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(BtAgentsError, match=r"'bt-agents\[lab\]', or name a file that ends in"):
        ResultFile(tmp_path / "r.parquet")
    ResultFile(tmp_path / "r.csv")


def test_every_column_is_documented_with_its_type() -> None:
    page = (ROOT / "docs" / "experiments.md").read_text(encoding="utf-8")
    page = page.partition("## Results as a table")[2].partition("\n## ")[0]
    words = {str: "text", int: "whole number", float: "number", bool: "true or false"}
    documented = re.findall(r"^\| `(\w+)` \| ([a-z ]+) \|", page, re.MULTILINE)
    columns = result_columns(["NAME"])
    assert documented == [(key, words[kind]) for key, kind in columns.items()]
