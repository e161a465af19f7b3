# SPDX-License-Identifier: Apache-2.0
"""What would have been decided and learned with another strategy, learning or other agents."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from bt_agents.host.agent_registry import unmet
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.profile_layers import EVERYBODY, layers_of
from bt_agents_core.scene import Scene, SceneSpace, Vector
from bt_agents_lab.replay.recording_index import NO_MAKING, RecordedFeedback, RecordingIndex, Round
from bt_agents_lab.replay.replay_learning import rule_of
from bt_agents_lab.replay.run_counts import ReplayedRunCounts
from bt_agents_lab.replay.scenes import bids_of, external_of, named, scene_of, terms_of
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.yaml.diagnostics import did_you_mean
from feedback_node.learning.learning_step import Evidence, requested, step
from marketplace_node.round.decision import AcceptedBid, AuctionOutcome, ClosedBy, Terms
from marketplace_node.round.ranking import decide
from marketplace_node.settings import EXTERNAL
from marketplace_node.strategies import STRATEGIES

ASSUMED = (
    "The same scenes come in the same order, also those that follow a stopped run.",
    "Whoever is chosen runs; how people react to another agent is not known.",
    "Feedback about a run is given only where the same agent runs; all other feedback is.",
)
"""What is assumed, in words."""

OTHERS_ASSUMED = (
    "Every agent of the folder bids in each round, also one that the host was told to leave out "
    "by its tags; --tags leaves it out here, too."
)
"""What is assumed besides when other agents bid, in words."""

_Key = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Changes:
    """What would be different.

    Attributes:
        strategy: By which is ranked; empty keeps that of each round.
        options: What is set about it.
        rate: Learning rate of every agent; None keeps its own.
        update: How profiles follow feedback; None keeps that of each agent.
        agents: Who bids, with the profile, learning and requirement of its file; None keeps those
            who bid.
    """

    strategy: str = ""
    options: Mapping[str, float] = field(default_factory=dict)
    rate: float | None = None
    update: Update | None = None
    agents: tuple[AgentSpec, ...] | None = None

    def check(self) -> None:
        """Check the strategy and its options.

        Raises:
            BtAgentsError: There is no such strategy or option, or a value is out of range.
        """
        if not self.strategy:
            if self.options:
                raise BtAgentsError("an option belongs to a strategy; name it with --strategy")
            return
        if self.strategy == EXTERNAL:
            raise BtAgentsError("what a program outside would have answered is not known")
        if self.strategy not in STRATEGIES:
            hint = did_you_mean(self.strategy, sorted(STRATEGIES))
            raise BtAgentsError(f"no strategy '{self.strategy}'; {hint}")
        known = {option.name: option for option in STRATEGIES[self.strategy].options}
        for name, value in self.options.items():
            if name not in known:
                hint = did_you_mean(name, sorted(known)) or "it has none"
                raise BtAgentsError(f"strategy '{self.strategy}' has no option '{name}'; {hint}")
            option = known[name]
            if not option.minimum <= value <= option.maximum:
                raise BtAgentsError(
                    f"option '{name}' is {value:g}, expected {option.minimum:g} to "
                    f"{option.maximum:g}"
                )


@dataclass(frozen=True, kw_only=True)
class WhatIfCase:
    """One round, as it was and as it would have been.

    Attributes:
        epoch: The market.
        round: Its number.
        label: Words for the scene.
        was: Who won; empty for nobody.
        now: Who would have won.
        margin_was: Score of the runner-up minus that of the winner; NaN without a runner-up.
        margin_now: The same as it would have been.
        words: Why it could not be decided; empty when it could.
    """

    epoch: str
    round: int
    label: str
    was: str
    now: str
    margin_was: float
    margin_now: float
    words: str = ""


@dataclass(kw_only=True)
class Outlook:
    """What would have been.

    Attributes:
        cases: Round by round.
        bidders: Agents that bid at least once.
        given: How many feedbacks would have been given.
        withheld: How many would not, as another agent would have run.
        profiles: Profile of each agent at the end, for everybody.
    """

    cases: list[WhatIfCase] = field(default_factory=list)
    bidders: set[str] = field(default_factory=set)
    given: int = 0
    withheld: int = 0
    profiles: dict[str, Vector] = field(default_factory=dict)

    @property
    def chosen(self) -> Counter[str]:
        """Agent → rounds that it would have won."""
        return Counter(case.now for case in self.cases if case.now)

    @property
    def never(self) -> tuple[str, ...]:
        """Agents that bid and would never have been chosen."""
        return tuple(sorted(self.bidders - self.chosen.keys()))

    @property
    def other(self) -> int:
        """How many rounds would have had another winner."""
        return sum(case.was != case.now for case in self.cases if not case.words)


def what_if(story: RecordingIndex, changes: Changes) -> Outlook:
    """Decide and learn what a journal holds with some changes.

    Args:
        story: What it holds.
        changes: What is different; without any everything is as it was.
    """
    changes.check()
    return _Retold(changes).tell(story)


class _Retold:
    def __init__(self, changes: Changes) -> None:
        self._changes = changes
        self._specs = {spec.name: spec for spec in changes.agents or ()}
        self._outlook = Outlook()
        self._was: dict[_Key, Vector] = {}
        self._now: dict[_Key, Vector] = {}
        self._asked: dict[_Key, list[Vector]] = {}
        self._counts = ReplayedRunCounts()
        self._winners: dict[tuple[str, int], str] = {}

    def tell(self, story: RecordingIndex) -> Outlook:
        for event in _in_order(story):
            if isinstance(event, Round):
                self._decide(event)
            else:
                self._learn(event)
        self._outlook.profiles = {
            agent: profile for (agent, layer), profile in self._now.items() if not layer
        }
        return self._outlook

    def _decide(self, one: Round) -> None:
        auction = one.auction
        now, margin, words = "", math.nan, ""
        if one.making is None:
            words = NO_MAKING
        else:
            try:
                now, margin = self._winner(one, one.making.space)
            except BtAgentsError as error:
                words = error.reason if isinstance(error, Refused) else str(error)
        self._outlook.cases.append(
            WhatIfCase(
                epoch=auction.epoch,
                round=auction.round,
                label=named(auction.scene),
                was=auction.winner,
                now=now,
                margin_was=auction.margin,
                margin_now=margin,
                words=words,
            )
        )
        if auction.outcome == AuctionOutcome.AWARDED:
            self._counts.note(auction.epoch, auction.winner, now)
            if now:
                self._winners[auction.epoch, auction.round] = now

    def _winner(self, one: Round, space: SceneSpace) -> tuple[str, float]:
        auction = one.auction
        if auction.closed_by == ClosedBy.STOPPED:
            return "", math.nan
        scene = scene_of(auction.scene, space)
        bids = self._bids(one, scene, space)
        self._outlook.bidders |= {bid.agent for bid in bids}
        terms = self._terms(one, scene)
        outside = external_of(auction) if terms.strategy == EXTERNAL else None
        ranked = decide(space, terms, bids, external=outside).bids
        if not ranked:
            return "", math.nan
        margin = ranked[1].score - ranked[0].score if len(ranked) > 1 else math.nan
        return ranked[0].agent, margin

    def _terms(self, one: Round, scene: Scene) -> Terms:
        auction, epoch = one.auction, one.auction.epoch
        self._counts.hear(one)
        runs, last_run, total = self._counts.of(epoch)
        terms = terms_of(one, scene, total)
        terms = replace(
            terms,
            runs=runs,
            last_run=last_run,
            rounds_run=total,
            seed=auction.seed or f"{epoch}/{auction.round}",
            shadow="",
        )
        if self._changes.strategy:
            terms = replace(
                terms, strategy=self._changes.strategy, options=dict(self._changes.options)
            )
        return terms

    def _bids(self, one: Round, scene: Scene, space: SceneSpace) -> list[AcceptedBid]:
        auction = one.auction
        bids = {bid.agent: bid for bid in bids_of(auction.ranking)}
        if self._changes.agents is None:
            return [replace(bid, vector=self._vector(bid, scene)) for bid in bids.values()]
        kept_out = {one.agent for one in auction.refused if one.code in _KEPT_OUT}
        found = []
        for spec in self._specs.values():
            profile = self._profile_of(spec, scene)
            tunables = {tunable.name: tunable.default for tunable in spec.tunables}
            if spec.name in kept_out or unmet(spec, space, scene, profile, tunables):
                continue
            known = bids.get(spec.name)
            found.append(
                replace(known, vector=profile)
                if known is not None
                else AcceptedBid(agent=spec.name, agent_id=0, host="", instance="", vector=profile)
            )
        return found

    def _vector(self, bid: AcceptedBid, scene: Scene) -> Vector:
        """Return what an agent would have bid: the profile that has become of the one it bid."""
        for layer in (*layers_of(scene).values(), EVERYBODY):
            key = (bid.agent, layer)
            if self._was.get(key) == bid.vector:
                return self._now[key]
        if not any(agent == bid.agent for agent, _ in self._was):
            self._was[bid.agent, ""] = self._now[bid.agent, ""] = bid.vector
        return bid.vector

    def _profile_of(self, spec: AgentSpec, scene: Scene) -> Vector:
        for kind, layer in layers_of(scene).items():
            if kind in spec.learning.layers and (spec.name, layer) in self._now:
                return self._now[spec.name, layer]
        return self._now.setdefault((spec.name, ""), spec.profile)

    def _learn(self, lesson: RecordedFeedback) -> None:
        feedback = lesson.feedback
        key = (feedback.agent, feedback.layer)
        before = self._was.get(key, tuple(feedback.before))
        self._was[key] = tuple(feedback.after)
        of_run = (feedback.epoch, feedback.round)
        if of_run in self._winners and self._winners[of_run] != feedback.agent:
            self._outlook.withheld += 1
            self._now.setdefault(key, before)
            return
        if self._changes.agents is not None and feedback.agent not in self._specs:
            self._outlook.withheld += 1
            return
        self._outlook.given += 1
        if lesson.making is not None and lesson.card is not None:
            self._now[key] = self._moved(lesson, lesson.making.space, before)

    def _moved(self, lesson: RecordedFeedback, space: SceneSpace, before: Vector) -> Vector:
        feedback, key = lesson.feedback, (lesson.feedback.agent, lesson.feedback.layer)
        spec = self._specs.get(feedback.agent)
        profile = self._now.get(key, spec.profile if spec is not None else before)
        kind, target = FeedbackKind(feedback.kind), tuple(feedback.target)
        rule, rate = self._learning(lesson, spec)
        taught = self._asked.setdefault(key, [])
        authored = spec.profile if spec is not None else tuple(lesson.card.profile)
        again = step(
            kind,
            profile,
            target,
            rate=rate,
            space=space,
            rule=rule,
            weight=feedback.weight,
            evidence=Evidence(recent=tuple(taught), changes=len(taught), authored=authored),
        )
        if kind is not FeedbackKind.SET:
            taught.append(requested(kind, profile, target))
        return again.after

    def _learning(
        self, lesson: RecordedFeedback, spec: AgentSpec | None
    ) -> tuple[LearningRule, float]:
        if spec is not None:
            rule, rate = spec.learning, spec.learning_rate
        else:
            rule = rule_of(lesson.card, lesson.parameters)
            rate = lesson.feedback.learning_rate
        if (
            self._changes.rate is not None
            and FeedbackKind(lesson.feedback.kind) is not FeedbackKind.SET
        ):
            rate = self._changes.rate
        if self._changes.update is not None:
            rule = replace(rule, update=self._changes.update)
        return rule, rate


_KEPT_OUT = ("EXCLUDED", "VETOED", "NOT_PINNED", "NOT_AWARDED")
"""Codes of refusals that do not depend on what an agent bids."""


def _in_order(story: RecordingIndex) -> list[Round | RecordedFeedback]:
    """Return what was decided and learned in the order in which it happened."""
    events: list[tuple[int, int, Round | RecordedFeedback]] = []
    for number, one in enumerate(story.rounds):
        events.append((_ns(one.auction.stamp), number, one))
    for number, lesson in enumerate(story.lessons, len(story.rounds)):
        events.append((_ns(lesson.feedback.stamp), number, lesson))
    return [event for _, _, event in sorted(events, key=lambda event: event[:2])]


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
