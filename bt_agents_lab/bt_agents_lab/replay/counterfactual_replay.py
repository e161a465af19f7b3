# SPDX-License-Identifier: Apache-2.0
"""Counterfactual replay of a journal with another strategy, other learning or other agents."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

from bt_agents.host.agent_registry import decline_of
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.local_time import local_time
from bt_agents_core.profile_layers import EVERYBODY, layers_of
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, SceneSpace, Vector, scene_name
from bt_agents_lab.replay.recording_index import (
    NO_TEXTS,
    RecordedFeedback,
    RecordedProfile,
    RecordingIndex,
    Round,
)
from bt_agents_lab.replay.replay_learning import ProfileHistory, is_managed, rule_of, with_newest
from bt_agents_lab.replay.scenes import bids_of, external_of, scene_of, terms_of
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.model.specs import AgentSpec
from feedback_node.learning.learning_step import parameter_rules, requested, step
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import AcceptedBid, ClosedBy, Terms
from marketplace_node.round.ranking import decide
from marketplace_node.settings import EXTERNAL
from marketplace_node.strategies import STRATEGIES

ASSUMED = (
    "The same scenes come in the same order, also those that follow a stopped run.",
    "The chosen agent runs; how people react to another agent is unknown.",
    "Feedback about a run is given only where the same agent runs; all other feedback is.",
)
"""Assumptions, for people."""

OTHERS_ASSUMED = (
    "Every agent of the folder bids in each round, also one that the host was told to leave out "
    "by its tags; --tags leaves it out here, too."
)
"""Further assumption if other agents bid, for people."""

_Key = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Changes:
    """Changes to the recorded system.

    Attributes:
        strategy: Strategy for ranking bids; empty keeps the strategy of each round.
        rate: Learning rate of every agent; None keeps its own.
        update: How profiles follow feedback; None keeps the rule of each agent.
        agents: Agents that bid, with the profile, learning and requirement of their files; None
            keeps the recorded bidders.
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
            raise BtAgentsError("the answer of an external program to another round is unknown")
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
class RoundComparison:
    """A round as it was and as it would have been.

    Attributes:
        label: Name of the scene, for people.
        was: The winner; empty for none.
        now: The winner with the changes; empty for none.
        margin_was: Score of the runner-up minus the winner's score; NaN without a runner-up.
        margin_now: The same with the changes.
        problem: Why the round could not be decided; empty if it could.
    """

    epoch: str
    round: int
    label: str
    was: str
    now: str
    margin_was: float
    margin_now: float
    problem: str = ""


@dataclass(kw_only=True)
class CounterfactualResult:
    """Outcome of a counterfactual replay.

    Attributes:
        bidders: Agents that bid at least once.
        given: Number of feedbacks that would still have been given.
        withheld: Number of those that would not, because another agent would have run.
        profiles: Final profile of each agent, for everybody.
    """

    rounds: list[RoundComparison] = field(default_factory=list)
    bidders: set[str] = field(default_factory=set)
    given: int = 0
    withheld: int = 0
    profiles: dict[str, Vector] = field(default_factory=dict)

    @property
    def chosen(self) -> Counter[str]:
        """Agent → number of rounds that it would have won."""
        return Counter(case.now for case in self.rounds if case.now)

    @property
    def never(self) -> tuple[str, ...]:
        """Agents that bid and would never have won."""
        return tuple(sorted(self.bidders - self.chosen.keys()))

    @property
    def other_winners(self) -> int:
        """Number of rounds that would have had another winner."""
        return sum(case.was != case.now for case in self.rounds if not case.problem)


def replay_with(recording: RecordingIndex, changes: Changes) -> CounterfactualResult:
    """Repeat the decisions and the learning in a journal with some changes, or none."""
    changes.check()
    return _Counterfactual(changes).replay(recording)


class _Counterfactual:
    def __init__(self, changes: Changes) -> None:
        self._changes = changes
        self._specs = {spec.name: spec for spec in changes.agents or ()}
        self._outlook = CounterfactualResult()
        self._was: dict[_Key, Vector] = {}
        self._now: dict[_Key, _Taught] = {}
        self._revisions: defaultdict[_Key, dict[int, _Taught]] = defaultdict(dict)
        self._histories: defaultdict[_Key, ProfileHistory] = defaultdict(ProfileHistory)
        self._counts = _RunCounts()
        self._ran: dict[tuple[str, int], Collection[str] | None] = {}

    def replay(self, recording: RecordingIndex) -> CounterfactualResult:
        for event in recording.events:
            match event:
                case Round():
                    self._decide(event)
                case RecordedFeedback():
                    self._learn(event)
                case RecordedProfile():
                    self._set(event)
        self._outlook.profiles = {
            agent: taught.profile for (agent, layer), taught in self._now.items() if not layer
        }
        return self._outlook

    def _decide(self, one: Round) -> None:
        auction = one.auction
        now, margin, problem = "", math.nan, ""
        try:
            if one.space is None:
                raise BtAgentsError(NO_TEXTS)
            now, margin = self._winner(one, one.space)
        except BtAgentsError as error:
            problem = error.reason if isinstance(error, Refused) else str(error)
        self._outlook.rounds.append(
            RoundComparison(
                epoch=auction.epoch,
                round=auction.round,
                label=scene_name(auction.scene),
                was=auction.winner,
                now=now,
                margin_was=auction.margin,
                margin_now=margin,
                problem=problem,
            )
        )
        if auction.outcome == AuctionOutcome.AWARDED:
            as_it_was = now == auction.winner
            ran = one.ran if as_it_was else [now] if now else []
            self._counts.add(auction.epoch, one.ran, ran)
            self._ran[auction.epoch, auction.round] = None if as_it_was else ran

    def _winner(self, one: Round, space: SceneSpace) -> tuple[str, float]:
        auction = one.auction
        if auction.closed_by == ClosedBy.STOPPED:
            return "", math.nan
        scene = scene_of(auction.scene, space)
        bids = self._bids(one, scene)
        self._outlook.bidders |= {bid.agent for bid in bids}
        terms = self._terms(one, scene)
        external = external_of(auction) if terms.strategy == EXTERNAL else None
        decided = decide(space.profiles, terms, bids, external=external)
        if self._changes.strategy and decided.fallback:
            raise Refused(RefusalCode.STRATEGY_FAILED, decided.fallback)
        ranked = decided.bids
        if not ranked:
            return "", math.nan
        margin = ranked[1].score - ranked[0].score if len(ranked) > 1 else math.nan
        return ranked[0].agent, margin

    def _terms(self, one: Round, scene: Scene) -> Terms:
        auction, epoch = one.auction, one.auction.epoch
        counts = self._counts.updated(one)
        terms = replace(
            terms_of(one, scene, counts.total),
            runs=dict(counts.runs),
            last_run=dict(counts.last),
            rounds_run=counts.total,
            seed=auction.seed or f"{epoch}/{auction.round}",
            shadow="",
        )
        if self._changes.strategy:
            options = dict(self._changes.options)
            terms = replace(terms, strategy=self._changes.strategy, options=options)
        return terms

    def _bids(self, one: Round, scene: Scene) -> list[AcceptedBid]:
        auction = one.auction
        bids = {bid.agent: bid for bid in bids_of(auction.ranking)}
        if self._changes.agents is None:
            return [replace(bid, vector=self._vector(bid, scene)) for bid in bids.values()]
        found = []
        for spec in self._specs.values():
            profile = self._profile_of(spec, scene)
            if _left_out(one, spec.name) or decline_of(
                spec.requires, scene, lambda: local_time(auction.header.stamp.sec)
            ):
                continue
            unknown = AcceptedBid(
                agent=spec.name, agent_id=0, host="", instance="", vector=profile
            )
            found.append(replace(bids.get(spec.name, unknown), vector=profile))
        return found

    def _vector(self, bid: AcceptedBid, scene: Scene) -> Vector:
        """Return the vector that an agent would have bid instead of the recorded one."""
        for layer in (*layers_of(scene).values(), EVERYBODY):
            key = (bid.agent, layer)
            if self._was.get(key) == bid.vector:
                return self._now[key].profile
        if not any(agent == bid.agent for agent, _ in self._was):
            self._begin((bid.agent, EVERYBODY), bid.vector)
        return bid.vector

    def _profile_of(self, spec: AgentSpec, scene: Scene) -> Vector:
        for kind, layer in layers_of(scene).items():
            if kind in spec.learning.layers and (spec.name, layer) in self._now:
                return self._now[spec.name, layer].profile
        own = _Taught(profile=spec.profile)
        return self._now.setdefault((spec.name, EVERYBODY), own).profile

    def _begin(self, key: _Key, profile: Vector) -> None:
        """Take a profile that does not result from anything recorded."""
        agent, layer = key
        taught = _Taught(profile=profile)
        if layer and self._was.get((agent, EVERYBODY)) == profile:
            taught = replace(self._now[agent, EVERYBODY], recent=(), changes=0)
        self._was[key] = profile
        if layer or agent not in self._specs:
            self._now[key] = taught

    def _set(self, recorded: RecordedProfile) -> None:
        key = (recorded.agent, recorded.layer)
        if recorded.profile:
            self._begin(key, recorded.profile)
        else:
            self._was.pop(key, None)
            self._now.pop(key, None)

    def _learn(self, recorded: RecordedFeedback) -> None:
        feedback = recorded.feedback
        key = (feedback.agent, feedback.layer)
        if self._changes.agents is not None and feedback.agent not in self._specs:
            self._outlook.withheld += 1
            return
        if recorded.space is None or recorded.card is None:
            self._was[key] = tuple(feedback.after)
            return
        if self._was.get(key) != tuple(feedback.before):
            self._begin(key, tuple(feedback.before))
        before = self._histories[key].before(feedback, recorded.card.profile)
        taught_by = rule_of(recorded.card, recorded.parameters)
        after = self._histories[key].add(feedback, before, recorded.space.profiles, taught_by)
        spec = self._specs.get(feedback.agent)
        own = spec.profile if spec is not None else tuple(feedback.before)
        now = self._now.setdefault(key, _Taught(profile=own))
        revisions = self._revisions[key]
        revisions.setdefault(before.revision, now)
        self._was[key] = tuple(feedback.after)
        ran = self._ran.get((feedback.epoch, feedback.round))
        if ran is not None and feedback.agent not in ran:
            self._outlook.withheld += 1
        else:
            self._outlook.given += 1
            if after.revision != feedback.revision and after.revision in revisions:
                now = revisions[after.revision]
            else:
                now = self._taught(recorded, recorded.space.profiles, now)
        self._now[key] = revisions[feedback.revision] = now

    def _taught(self, recorded: RecordedFeedback, space: SceneSpace, now: _Taught) -> _Taught:
        """Return the profile after a feedback, not after an undo."""
        feedback, spec = recorded.feedback, self._specs.get(recorded.feedback.agent)
        if is_managed(feedback):
            is_import = bool(feedback.feedback_id)
            own = None if is_import or spec is None else spec.profile
            return _Taught(profile=own or tuple(feedback.after))
        kind, target = FeedbackKind(feedback.kind), tuple(feedback.target)
        profile = tuple(feedback.after)
        rule, rate = self._learning(recorded, spec)
        if not self._learns_as_it_did or now.profile != tuple(feedback.before):
            profile = step(
                kind,
                now.profile,
                target,
                rate=rate,
                space=space,
                rule=rule,
                weight=feedback.weight,
                recent=now.recent,
                changes=now.changes,
                authored=spec.profile if spec is not None else tuple(recorded.card.profile),
            ).after
        if kind is FeedbackKind.SET:
            return replace(now, profile=profile)
        asked = requested(parameter_rules(rule, space), kind, now.profile, target)
        recent = with_newest(now.recent, asked)
        return _Taught(profile=profile, recent=recent, changes=now.changes + 1)

    @property
    def _learns_as_it_did(self) -> bool:
        changes = self._changes
        return changes.rate is None and changes.update is None and changes.agents is None

    def _learning(
        self, recorded: RecordedFeedback, spec: AgentSpec | None
    ) -> tuple[LearningRule, float]:
        if spec is not None:
            rule, rate = spec.learning, spec.learning_rate
        else:
            rule = rule_of(recorded.card, recorded.parameters)
            rate = recorded.feedback.learning_rate
        if self._changes.rate is not None and recorded.feedback.kind != FeedbackKind.SET:
            rate = self._changes.rate
        if self._changes.update is not None:
            rule = replace(rule, update=self._changes.update)
        return rule, rate


@dataclass(frozen=True, kw_only=True)
class _Taught:
    """Profile as it would have been, with its feedback as in :func:`learning_step.step`."""

    profile: Vector
    recent: tuple[Vector, ...] = ()
    changes: int = 0


@dataclass(kw_only=True)
class _Runs:
    """Runs of one market, with the number of the last run of each agent."""

    runs: Counter[str] = field(default_factory=Counter)
    last: dict[str, int] = field(default_factory=dict)
    total: int = 0

    def add(self, agents: Iterable[str]) -> None:
        for agent in agents:
            self.total += 1
            self.runs[agent] += 1
            self.last[agent] = self.total


class _RunCounts:
    """Counts of each agent's runs as they would have been, along with the recorded ones.

    Bids state how often their agents had run. Runs that a journal has not seen, because it begins
    later or has lost messages, are included; so without changes, counts stay as recorded.
    """

    def __init__(self) -> None:
        self._was: defaultdict[str, _Runs] = defaultdict(_Runs)
        self._now: defaultdict[str, _Runs] = defaultdict(_Runs)

    def updated(self, one: Round) -> _Runs:
        """Take the counts in the bids of a round; return them as they would have been.

        If the journal does not begin with the market, the total number of runs is at least that of
        the bidders, which is exact if all agents bid.
        """
        auction = one.auction
        was, now = self._was[auction.epoch], self._now[auction.epoch]
        before = max(one.least, was.total) if one.runs is None else one.earlier + one.runs
        now.total = max(0, now.total + before - was.total)
        was.total = before
        for bid in auction.ranking:
            now.runs[bid.agent] = max(0, now.runs[bid.agent] + bid.runs - was.runs[bid.agent])
            was.runs[bid.agent] = bid.runs
            if bid.last_run != was.last.get(bid.agent, 0):
                now.last[bid.agent] = was.last[bid.agent] = bid.last_run
        return now

    def add(self, epoch: str, was: Iterable[str], now: Iterable[str]) -> None:
        """Count the agent that ran after a round, and the one that would have."""
        self._was[epoch].add(was)
        self._now[epoch].add(now)


def _left_out(one: Round, agent: str) -> bool:
    """Return whether an agent could not bid in a round, whatever its properties."""
    refused = {bid.agent: bid.code for bid in one.auction.refused}
    bidders = {bid.agent for bid in one.auction.ranking}
    if agent in (*one.vetoed, *(one.excluded or ())) or refused.get(agent) in _EXCLUDED:
        return True
    if one.pinned:
        return agent != one.pinned
    # If an operator awarded the run, absent agents could not bid either.
    return RefusalCode.NOT_AWARDED in refused.values() and agent not in bidders | refused.keys()


_EXCLUDED = (
    RefusalCode.EXCLUDED,
    RefusalCode.VETOED,
    RefusalCode.NOT_PINNED,
    RefusalCode.NOT_AWARDED,
)
"""Codes of refusals that do not depend on what an agent bids."""
