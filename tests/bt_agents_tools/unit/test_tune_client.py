# SPDX-License-Identifier: Apache-2.0
"""Changes of profiles by `bt-agents tune`: names of values, and the effect of an undo."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_tools.cli.commands.tune import _profiles
from bt_agents_tools.client.tuning import tuned_at, tuned_profile


def row(revision: int, source: str = "", **more: Any) -> dict[str, Any]:
    return {"revision": revision, "stamp": 10.0 * revision, "source": source} | more


class Feedback:
    """Answers of a feedback node to ``HISTORY``."""

    def __init__(self, **revisions: list[dict[str, Any]]) -> None:
        self.asked: list[str] = []
        self._revisions = revisions

    def ask(self, service: str, *, action: str, find_s: float, agent: str = "") -> Any:
        assert (service, action, find_s) == ("feedback/manage", "HISTORY", 3.0)
        self.asked.append(agent)
        profiles = [
            {"agent": name, "layer": layer, "stamp": rows[-1]["stamp"]}
            for name, rows in self._revisions.items()
            for layer in ("", "person/anna")
        ]
        told = {"profiles": profiles, "revisions": self._revisions.get(agent, [])}
        return SimpleNamespace(accepted=True, document=json.dumps(told))


@pytest.mark.parametrize(
    ("rows", "stamp"),
    [
        ([], 0.0),
        ([row(1)], 0.0),
        ([row(1), row(2, "tuning")], 20.0),
        ([row(1), row(2, "tuning"), row(3, "mood rule")], 0.0),
        ([row(1), row(2, "tuning"), row(3, "tuning"), row(4, restores=2)], 20.0),
        ([row(1), row(2, "tuning"), row(3, restores=1)], 0.0),
        ([row(5, restores=2)], 0.0),
    ],
)
def test_tuned_time_comes_from_last_or_restored_revision(
    rows: list[dict[str, Any]], stamp: float
) -> None:
    assert tuned_at(rows) == stamp


def test_undo_reverts_newest_tuning_of_all_profiles() -> None:
    feedback: Any = Feedback(
        a=[row(1), row(3, "tuning")],
        b=[row(1), row(2, "tuning"), row(5, restores=2)],
        c=[row(1), row(4, "mood rule")],
        d=[row(1)],
    )
    assert tuned_profile(feedback, "", 0.0) == "a"
    assert feedback.asked == ["", "b", "c", "a"]
    assert tuned_profile(feedback, "b", 0.0) == "b"
    assert tuned_profile(feedback, "", 30.0) == ""
    assert tuned_profile(feedback, "c", 0.0) == ""


def test_missing_response_undoes_nothing() -> None:
    observer: Any = SimpleNamespace(ask=lambda *_, **__: None)
    assert tuned_profile(observer, "", 0.0) == ""


def test_profile_values_are_found_by_agent() -> None:
    named = [("a.profile.age", "4.5"), ("a.patience", "3 s"), ("b.profile.mood", "2")]
    assert _profiles(named) == {"a": {"age": 4.5}, "b": {"mood": 2.0}}


@pytest.mark.parametrize(
    ("named", "code"),
    [
        ([("a.profile.age", "old")], "NOT_A_VALUE: a.profile.age: "),
        ([("a.profile.age", "nan")], "NOT_A_VALUE: a.profile.age: "),
        ([("a.profile.age", "1"), ("a.profile.age", "1")], "DUPLICATE: a.profile.age stands"),
    ],
)
def test_non_numeric_profile_value_is_refused(named: list[tuple[str, str]], code: str) -> None:
    with pytest.raises(Refused, match=code):
        _profiles(named)
