# SPDX-License-Identifier: Apache-2.0
"""Cached recent feedback of a profile: the same as in the ledger."""

from __future__ import annotations

from random import Random

from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import SceneParameter, SceneSpace
from feedback_node.learning import profiles as profiles_module
from feedback_node.learning.cards import AgentEntry, LearningCard, LearningEntry
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger

SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "mood")
    )
)


def card(window: int = 5) -> LearningCard:
    guide = AgentEntry(
        name="guide",
        profile=(3.0, 3.0),
        revision=0,
        learning_rate=0.5,
        learning=LearningEntry(update="median", window=window),
    )
    return LearningCard(host="/agents", instance="i1", parameters=SPACE.names, agents=(guide,))


def known(ledger: Ledger, window: int = 5) -> Profiles:
    profiles = Profiles(SPACE, ledger)
    assert profiles.register_card(card(window))[1] == ()
    return profiles


def give(profiles: Profiles, number: int, random: Random) -> None:
    kinds = (FeedbackKind.DIRECT, FeedbackKind.POSITIVE, FeedbackKind.NEGATIVE, FeedbackKind.SET)
    profiles.apply(
        "guide",
        random.choice(kinds),
        (random.uniform(1.0, 5.0), random.uniform(1.0, 5.0)),
        feedback_id=f"f{number}",
        source="me",
        reason="",
        run=None,
    )


def test_cached_and_reread_feedback_teach_the_same():
    histories = []
    for forgets in (False, True):
        random, ledger = Random(3), Ledger(":memory:")
        profiles = known(ledger)
        for number in range(60):
            if forgets:
                profiles = known(ledger)
            if number % 17 == 16:
                profiles.on_recorded([ledger.undo("guide")])
            if number == 40:
                assert profiles.register_card(card(window=9))[1] == ()
            elif number > 40 and forgets:
                profiles = known(ledger, window=9)
            give(profiles, number, random)
        histories.append([(row.profile, row.cause) for row in ledger.history("guide")])
    assert histories[0] == histories[1]


def test_feedback_reads_no_earlier_feedback(monkeypatch):
    ledger = Ledger(":memory:")
    profiles = known(ledger)
    read = []
    taught = profiles_module.taught
    monkeypatch.setattr(
        profiles_module, "taught", lambda *args: read.append(args) or taught(*args)
    )
    random = Random(1)
    for number in range(5):
        give(profiles, number, random)
    assert len(read) == 1
    profiles.on_recorded([ledger.undo("guide")])
    read.clear()
    for number in (8, 9):
        give(profiles, number, random)
    assert len(read) == 1
