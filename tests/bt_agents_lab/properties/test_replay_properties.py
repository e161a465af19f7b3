# SPDX-License-Identifier: Apache-2.0
"""Laws of replay: recorded messages reproduce every decision and learning step."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents.host.host_card import learning_to_msg
from bt_agents_core.feedback import BUTTON, MOOD_RULE, FeedbackKind, LearningRule, Update
from bt_agents_interfaces.msg import AgentCard, HostCard
from bt_agents_lab.replay.decisions import replay_decisions
from bt_agents_lab.replay.findings import ReplayVerdict
from bt_agents_lab.replay.recording_index import RecordedFeedback, Round
from bt_agents_lab.replay.replay_learning import replay_feedback
from bt_agents_language.files.market_reader import read_market
from bt_agents_language.yaml.source import Source
from bt_agents_ros.messages import to_time
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger
from feedback_node.node.messages import card_from_msg, feedback_to_msg
from marketplace_node.effects import PublishAuction
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import reason_of
from marketplace_node.node.messages import auction_to_msg
from marketplace_node.round.decision import External
from marketplace_node.strategies import STRATEGIES
from ranked_rounds import bids, decided, terms
from tree_harness import SPACE, scene

NAN = float("nan")
RULES = read_market(
    Source(
        "market.yaml",
        "format: 1\nrules:\n  - {when: scene.age > 4, agents: [carl, anna]}\n"
        "  - {when: scene.mood < 2, agents: [bert]}\n",
    ),
    SPACE,
)
NAMES = ("anna", "bert", "carl")

values = st.floats(1.0, 5.0) | st.sampled_from([1.0, 2.0, 3.0, 5.0])
vectors = st.tuples(values, values, values)
opinions = st.tuples(values | st.just(NAN), values | st.just(NAN), values)
scenes = st.fixed_dictionaries({}, optional=dict.fromkeys(SPACE.names, values))
learning_rates = st.just(0.0) | st.floats(1e-9, 1.0)  # the smallest floats may round to 0
rules = st.builds(
    LearningRule,
    rates=st.dictionaries(st.sampled_from(SPACE.names), learning_rates, max_size=2),
    update=st.sampled_from(Update),
    width=st.dictionaries(st.sampled_from(SPACE.names), st.floats(0.1, 2.0), max_size=2),
    window=st.integers(1, 7),
    anneal=st.sampled_from([0.0, 0.01, 0.5]),
    drift=st.dictionaries(st.sampled_from(SPACE.names), st.floats(0.1, 2.0), max_size=2),
    retreat=st.dictionaries(st.sampled_from(SPACE.names), values, max_size=3),
    weights=st.dictionaries(st.sampled_from([BUTTON, "test"]), st.floats(0.0, 2.0), max_size=2),
    layers=st.sampled_from([(), ("person",), ("person", "place")]),
    general=st.sampled_from([0.0, 0.5, 1.0]),
)
feedbacks = st.lists(
    st.tuples(
        st.sampled_from(
            [FeedbackKind.DIRECT, FeedbackKind.POSITIVE, FeedbackKind.NEGATIVE, FeedbackKind.SET]
        ),
        opinions,
        st.sampled_from([BUTTON, MOOD_RULE, "test"]),
        st.sampled_from(["", "anna", "otto"]),
    ),
    min_size=1,
    max_size=12,
)


@settings(max_examples=80, deadline=None, derandomize=True)
@given(vectors, learning_rates, rules, feedbacks)
def test_replay_repeats_all_learning(
    authored: tuple[float, ...],
    rate: float,
    rule: LearningRule,
    taught: list[tuple[FeedbackKind, tuple[float, ...], str, str]],
) -> None:
    guide = AgentCard(name="guide", profile=authored, current=authored, learning_rate=rate)
    guide.learning = learning_to_msg(rule, SPACE)
    card = HostCard(host="/agents", host_instance="i1", parameters=SPACE.names, agents=[guide])
    known = Profiles(SPACE, Ledger(":memory:"))
    _, problems = known.register_card(card_from_msg(card, SPACE))
    assert problems == ()
    kept = []
    for number, (kind, target, source, person) in enumerate(taught):
        where = replace(scene(age=3.0), person_id=person, place="lobby")
        run = AnnouncedRun(epoch="e", round=number, agent="guide", scene=where) if person else None
        change = known.apply(
            "guide", kind, target, feedback_id=f"f{number}", source=source, reason="", run=run
        )
        kept += [feedback_to_msg(one, SPACE) for one in change.all]
    found = replay_feedback(
        RecordedFeedback(feedback=one, card=guide, parameters=SPACE.names, space=SPACE)
        for one in kept
    )
    for finding in found:
        assert finding.verdict is ReplayVerdict.EQUAL, finding.text


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.sampled_from(sorted(STRATEGIES)),
    st.sampled_from(["", *sorted(STRATEGIES)]),
    scenes,
    st.lists(vectors, min_size=1, max_size=3),
    st.integers(0, 5),
    st.sampled_from([(), ("carl",), ("bert", "anna")]),
    st.booleans(),
)
def test_replay_repeats_all_decisions(
    strategy: str,
    shadow: str,
    person: dict[str, float],
    vectors: list[tuple[float, ...]],
    runs: int,
    outside: tuple[str, ...],
    weighted: bool,
) -> None:
    bidders = NAMES[: len(vectors)]
    ranking = tuple(name for name in outside if name in bidders)
    held = terms(
        scene("s", **person),
        strategy=strategy,
        runs={"anna": runs, "bert": 1},
        last_run={"anna": runs, "bert": 1} if runs else {},
        rounds_run=runs + 1,
        earlier_runs=runs // 2,
        options={option.name: option.default for option in STRATEGIES[strategy].options},
        shadow=shadow if shadow != strategy else "",
        shadow_options={"temperature": 0.7} if shadow == "softmax" != strategy else {},
        rules=RULES,
    )
    external = External(ranking=ranking) if ranking else External(failure="it is silent")
    weights = {name: (2.0, 1.0, 0.5) for name in bidders if weighted}
    decision = decided(
        held,
        bids(dict(zip(bidders, vectors, strict=True)), **weights),
        space=SPACE,
        external=external if strategy == "external" else None,
    )
    published = PublishAuction(
        decision=decision,
        reason_fn=partial(reason_of, decision),
        explanation_fn=partial(explanation, decision, SPACE),
    )
    recorded = Round(
        auction=auction_to_msg(published, to_time(1.0)),
        runs=runs + 1 - runs // 2,
        space=SPACE,
        possible_rules=((), RULES),
        excluded=(),
    )
    [finding] = replay_decisions([recorded])
    assert finding.verdict is ReplayVerdict.EQUAL, finding.text
