# SPDX-License-Identifier: Apache-2.0
"""Helpers of clients: the next scene, open questions, and undone changes of profiles."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Scene, SceneValue
from bt_agents_tools.cli.commands.tune import _profiles
from bt_agents_tools.client.market import next_scene
from bt_agents_tools.client.open_questions import asked_by
from bt_agents_tools.client.tuning import tuned_at, tuned_profile


def scene(scene_id: str, pain: float, origin: int) -> Scene:
    return Scene(scene_id=scene_id, values=[SceneValue(name="pain", value=pain, origin=origin)])


LAST = scene("s1", 2.0, SceneValue.GIVEN)


def test_running_interaction_uses_live_scene():
    live = scene("s1", 5.0, SceneValue.MEASURED)
    assert next_scene(LAST, live) is live


def test_told_values_still_count_after_run():
    told = next_scene(LAST, scene("", 8.0, SceneValue.TOLD))
    assert (told.scene_id, told.values[0].value) == ("s1", 8.0)
    assert LAST.values[0].value == 2.0


def test_measured_values_and_other_interactions_are_ignored():
    assert next_scene(LAST, scene("", 8.0, SceneValue.MEASURED)) == LAST
    assert next_scene(LAST, scene("s2", 8.0, SceneValue.TOLD)) is LAST
    assert next_scene(LAST, None) is LAST
    assert next_scene(None, scene("", 8.0, SceneValue.TOLD)) is None


GO = SimpleNamespace(text="Shall we go?", choices=("Yes", "No"))
NAME = SimpleNamespace(text="What is your name?", choices=())


def test_answer_goes_to_first_question_accepting_it() -> None:
    assert asked_by([GO, NAME], " yes ") == (GO, "Yes")
    assert asked_by([GO, NAME], "Ada") == (NAME, "Ada")


@pytest.mark.parametrize(
    ("questions", "words", "code"),
    [
        ([], "yes", "NO_QUESTION"),
        ([GO], "perhaps", "NOT_A_CHOICE"),
        ([GO], "", "NOT_A_CHOICE"),
        ([NAME], " ", "NOT_A_CHOICE"),
    ],
)
def test_answer_matching_no_question_is_refused(
    questions: list[SimpleNamespace], words: str, code: str
) -> None:
    with pytest.raises(Refused, match=rf"^{code}: "):
        asked_by(questions, words)


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
        ([row(1), row(2, "tuning")], 20.0),
        ([row(1), row(2, "tuning"), row(3, "mood rule")], 0.0),
        ([row(1), row(2, "tuning"), row(3, "tuning"), row(4, restores=2)], 20.0),
        ([row(1), row(2, "tuning"), row(3, restores=1)], 0.0),
        ([row(5, restores=2)], 0.0),
    ],
)
def test_tuned_time_follows_restored_revision(rows: list[dict[str, Any]], stamp: float) -> None:
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
    asked = (("b", 0.0), ("", 30.0), ("c", 0.0))
    assert [tuned_profile(feedback, *one) for one in asked] == ["b", "", ""]


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
        ([("a.profile.age", "4,2")], "found '4,2'; use a point: 4.2"),
        ([("a.profile.age", "nan")], "NOT_A_VALUE: a.profile.age: "),
        ([("a.profile.age", "1"), ("a.profile.age", "1")], "DUPLICATE: a.profile.age stands"),
    ],
)
def test_non_numeric_profile_value_is_refused(named: list[tuple[str, str]], code: str) -> None:
    with pytest.raises(Refused, match=code):
        _profiles(named)
