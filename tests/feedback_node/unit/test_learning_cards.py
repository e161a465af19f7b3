# SPDX-License-Identifier: Apache-2.0
"""Learning settings in a host's card: checked before anything is learned."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import LearningRule, Update
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from bt_agents_language.model.mood_rule import MoodAction
from feedback_node.learning import cards as cards_module
from feedback_node.learning.cards import (
    AgentEntry,
    LearningCard,
    LearningEntry,
    read_card,
    read_learning,
)
from scene_spaces import AGE_AND_MOOD as SPACE

NAN = math.nan
PLAIN = LearningEntry(update="plain", window=5, rates=(NAN, NAN))


def test_card_without_learning_means_paper_formula():
    assert read_learning(LearningEntry(), SPACE, what="a") == LearningRule()
    assert read_learning(PLAIN, SPACE, what="a") == LearningRule()


def test_card_learning_accepts_all_its_fields():
    entry = LearningEntry(
        update="huber",
        rates=(0.1, NAN),
        width=(NAN, 0.5),
        window=7,
        anneal=0.1,
        drift=(1.0, NAN),
        retreat=(NAN, 5.0),
        sources=("button", "mood rule"),
        weights=(1.0, 0.5),
        layers=("person",),
        general=0.25,
    )
    assert read_learning(entry, SPACE, what="a") == LearningRule(
        update=Update.HUBER,
        rates={"age": 0.1},
        width={"mood": 0.5},
        window=7,
        anneal=0.1,
        drift={"age": 1.0},
        retreat={"mood": 5.0},
        weights={"button": 1.0, "mood rule": 0.5},
        layers=("person",),
        general=0.25,
    )


@pytest.mark.parametrize(
    "entry",
    [
        replace(PLAIN, update="medium"),
        replace(PLAIN, rates=(0.1,)),
        replace(PLAIN, rates=(0.1, 1.1)),
        replace(PLAIN, rates=(0.1, math.inf)),
        replace(PLAIN, width=(-1.0, NAN)),
        replace(PLAIN, update="median", window=0),
        replace(PLAIN, update="median", window=1000),
        replace(PLAIN, anneal=NAN),
        replace(PLAIN, anneal=-1.0),
        replace(PLAIN, drift=(4.5, NAN)),
        replace(PLAIN, retreat=(0.5, NAN)),
        replace(PLAIN, retreat=(5.5, NAN)),
        replace(PLAIN, retreat=(math.inf, NAN)),
        replace(PLAIN, retreat=(3.0,)),
        replace(PLAIN, sources=("button",)),
        replace(PLAIN, sources=("button",), weights=(NAN,)),
        replace(PLAIN, sources=("button",), weights=(1e9,)),
        replace(PLAIN, layers=("persons",)),
        replace(PLAIN, general=1.5),
    ],
)
def test_invalid_learning_entry_does_not_affect_other_agents(entry):
    with pytest.raises(Refused, match="BAD_LEARNING"):
        read_learning(entry, SPACE, what="a")
    good = AgentEntry(name="good", profile=(3.0, 3.0), revision=0, learning_rate=0.2)
    bad = replace(good, name="bad", learning=entry)
    card = LearningCard(host="/agents", instance="i", parameters=SPACE.names, agents=(bad, good))
    agents, problems = read_card(card, SPACE)
    assert [agent.name for agent in agents] == ["good"]
    assert [
        problem.startswith("BAD_LEARNING: card of /agents: agent 'bad'") for problem in problems
    ]


def test_card_mood_rule_keeps_all_its_values():
    rule = restore_mood_rule(
        SPACE,
        when="mood.change > 1",
        hold_s=1.0,
        give=1,
        action=MoodAction.NONE,
        baseline_s=2.0,
        release="mood.change < 0",
        cooldown_s=3.0,
        confidence=0.5,
    )
    entry = AgentEntry(name="a", profile=(3.0, 3.0), revision=0, learning_rate=0.2, rules=(rule,))
    card = LearningCard(host="/agents", instance="i", parameters=SPACE.names, agents=(entry,))
    ((agent,), problems) = read_card(card, SPACE)
    assert problems == ()
    (read,) = agent.entry.rules
    assert read.release is not None
    assert (read.baseline_s, read.release.text, read.cooldown_s, read.confidence) == (
        2.0,
        "mood.change < 0",
        3.0,
        0.5,
    )


def test_unchanged_agent_of_card_is_not_parsed_again(monkeypatch):
    rule = restore_mood_rule(SPACE, when="mood.change > 1", hold_s=1.0, give=1)
    entry = AgentEntry(
        name="a",
        profile=(3.0, 3.0),
        revision=0,
        learning_rate=0.2,
        learning=replace(PLAIN, rates=(math.nan, math.nan)),
        rules=(rule,),
    )

    def read(entry, known=(), host="/agents"):
        card = LearningCard(host=host, instance="i", parameters=SPACE.names, agents=(entry,))
        (agent,), problems = read_card(card, SPACE, {one.name: one for one in known})
        assert problems == ()
        return agent

    first = read(entry)
    asked = []
    monkeypatch.setattr(
        cards_module,
        "read_learning",
        lambda *args, **more: asked.append(1) or read_learning(*args, **more),
    )
    again = replace(PLAIN, rates=(float("nan"), float("nan")))
    later = read(replace(entry, revision=7, learning=again), [first])
    assert (later.entry.revision, later.entry.rules, asked) == (7, first.entry.rules, [])
    others = (
        replace(entry, rules=(replace(rule, hold_s=2.0),)),
        replace(entry, learning=replace(PLAIN, anneal=0.5)),
        replace(entry, learning_rate=0.3),
        replace(entry, profile=(3.0, 4.0)),
    )
    for number, other in enumerate(others, start=1):
        assert read(other, [first]) == read(other)
        assert len(asked) == 2 * number
    assert read(entry, [first], host="/other").host == "/other"


def test_unreadable_rule_is_reported_with_every_card():
    bad = Refused("BAD_RULE", "rule 'moood > 1': there is no name 'moood' here")
    entry = AgentEntry(
        name="a", profile=(3.0, 3.0), revision=0, learning_rate=0.2, invalid_rules=(bad,)
    )
    card = LearningCard(host="/agents", instance="i", parameters=SPACE.names, agents=(entry,))
    (agent,), problems = read_card(card, SPACE)
    assert problems == (
        "BAD_RULE: card of /agents: agent 'a': rule 'moood > 1': there is no name 'moood' here; "
        "the rule is skipped",
    )
    assert read_card(card, SPACE, {"a": agent})[1] == problems
