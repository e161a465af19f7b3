# SPDX-License-Identifier: Apache-2.0
"""Feedback controller: turns fired mood rules, given and simulated feedback into changes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import MOOD_RULE, FeedbackKind
from bt_agents_core.liveness import LIVE_LEASE_S
from bt_agents_core.mood import Addressee
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.run_key import RunKey
from bt_agents_core.scene import Scene, Vector
from bt_agents_language.model.mood_rule import MoodAction
from feedback_node.announced_runs import AnnouncedRun, AnnouncedRuns
from feedback_node.learning.cards import LearningCard
from feedback_node.learning.profiles import Delivery, ProfileChange, Profiles
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import FORGOTTEN
from feedback_node.mood_trace import LeafMood, MoodTrace
from feedback_node.rules import Fired, Watch
from feedback_node.simulated_feedback import SimulatedFeedback

SETTLE_S = 0.5
"""How long the rules of a run replayed from history wait, because its end may follow [s]."""

MOST_PENDING = 100
"""Most feedbacks of rules that wait for space on the disk; beyond it, the oldest are dropped."""

MOST_TAUGHT = 100
"""Most changes of the last run that are kept."""


@dataclass(frozen=True, kw_only=True)
class FeedbackRequest:
    """Unchecked feedback from outside; see ``GiveFeedback.srv``."""

    feedback_id: str = ""
    agent: str = ""
    kind: int
    values: tuple[float, ...] = ()
    expected: tuple[float, ...] = ()
    source: str = ""
    reason: str = ""
    leaf: str = ""
    scene: Scene | None = None


@dataclass(frozen=True, kw_only=True)
class RuleStop:
    """Request to the market to stop a run and ask again for the current scene."""

    run: AnnouncedRun
    reason: str
    live: Scene


@dataclass(frozen=True, kw_only=True)
class RuleOutcome:
    """Outcome of a rule that fired or could not be decided.

    Attributes:
        change: The recorded change; None if it was refused or the rule could not be decided.
        stop: Set when the rule also stops the run, whether or not the profile could move.
    """

    change: ProfileChange | None = None
    problem: str = ""
    stop: RuleStop | None = None


@dataclass(frozen=True, kw_only=True)
class _Pending:
    run: AnnouncedRun
    fired: Fired
    leaf: str


class FeedbackController:
    """Turns events of runs, live scenes and given feedback into changes of profiles.

    Args:
        clock: Steady time [s].
        new_id: Returns a unique id for feedback that has none.
        lease_s: How long a live scene counts after its arrival [s].

    Attributes:
        undecided: Rules that could not be decided in the current or last run, each with the name
            of its agent.
    """

    def __init__(
        self,
        profiles: Profiles,
        *,
        clock: Callable[[], float],
        new_id: Callable[[], str],
        simulated: SimulatedFeedback | None = None,
        lease_s: float = LIVE_LEASE_S,
    ) -> None:
        self.profiles = profiles
        self.undecided: tuple[tuple[str, str], ...] = ()
        self._lease_s = lease_s
        self._clock = clock
        self._new_id = new_id
        self._simulated = simulated
        self._resumed = False
        self._runs = AnnouncedRuns()
        self._watch: Watch | None = None
        self._trace: MoodTrace | None = None
        self._leaf_of_run: tuple[RunKey, str] | None = None
        self._settle_s = 0.0
        self._card_awaited = False
        self._pending: deque[_Pending] = deque(maxlen=MOST_PENDING)
        self._taught_run: RunKey | None = None
        self._taught: deque[ProfileChange] = deque(maxlen=MOST_TAUGHT)

    def set_lease(self, seconds: float) -> None:
        """Set how long a live scene counts after its arrival [s]."""
        self._lease_s = seconds
        if self._watch is not None:
            self._watch.lease_s = seconds
        if self._trace is not None:
            self._trace.lease_s = seconds

    def is_running(self, run: AnnouncedRun) -> bool:
        """Return True while a run is active."""
        return self._runs.current is not None and self._runs.current.key == run.key

    @property
    def watching(self) -> bool:
        """True while a rule can fire because time passes."""
        return self._watch is not None and not self._watch.over

    @property
    def due(self) -> float:
        """Steady time when a rule acts if nothing arrives [s]; infinite for never."""
        return math.inf if self._watch is None else self._watch.due

    def wants(self, scene_id: str) -> bool:
        """Return True while live scenes with this id count."""
        run = self._runs.current
        return self._trace is not None and run is not None and run.scene.scene_id == scene_id

    def register_card(self, card: LearningCard) -> tuple[tuple[Delivery, ...], tuple[str, ...]]:
        """Register the card of a host; see :meth:`Profiles.register_card`."""
        result = self.profiles.register_card(card)
        self._begin()
        return result

    def on_run_started(self, run: AnnouncedRun, *, replayed: bool = False) -> None:
        """Evaluate the rules of a run from now on, unless it is known to be over.

        An event older than this node is ``replayed``.
        """
        if self._runs.started(run):
            self._watch = None
            self.undecided = ()
            self._settle_s = SETTLE_S if replayed else 0.0
            self._trace = MoodTrace(run.scene, self.profiles.scenes, self._clock, self._lease_s)
            self._update_leaf()
            self._card_awaited = True
            self._begin()

    def on_run_cancelling(self, run: AnnouncedRun) -> None:
        """Stop evaluating rules: moods during the stop of a run teach nothing."""
        if self.is_running(run):
            self._stop_watching()

    @property
    def collecting(self) -> bool:
        """True until the market has asked for feedback on the current or last run."""
        return self._runs.collecting

    def on_run_ended(self, run: AnnouncedRun, *, collects: bool = False) -> tuple[LeafMood, ...]:
        """Handle the end of a run, even one whose start this node has not received.

        With ``collects``, the market will ask for feedback on it next.

        Returns:
            Its mood trace; empty if it was not traced or none of its nodes is known.
        """
        if not self._runs.ended(run):
            return ()
        if collects:
            self._runs.expect(run)
        self._stop_watching()
        trace, self._trace = self._trace, None
        return trace.so_far() if trace is not None else ()

    def on_leaf(self, key: RunKey, leaf: str) -> None:
        """Set the path of the active node of a run.

        It may arrive before the start of the run, which another node publishes.
        """
        self._leaf_of_run = (key, leaf)
        self._update_leaf()

    def receive(self, live: Scene) -> tuple[RuleOutcome, ...]:
        """Handle a live scene; one that does not belong to the run is ignored."""
        run = self._runs.current
        if run is None or live.scene_id != run.scene.scene_id:
            return ()
        self._runs.told(Addressee(run.scene).mask(live))
        run = self._runs.current or run
        if self._trace is not None:
            self._trace.receive(live)
        if self._watch is None:
            return ()
        return self._outcomes(run, self._watch, self._watch.receive(live))

    def tick(self) -> tuple[RuleOutcome, ...]:
        """Return the outcomes of rules that act because time has passed."""
        run = self._runs.current
        if run is None or self._watch is None:
            return ()
        return self._outcomes(run, self._watch, self._watch.tick())

    def retry(self) -> tuple[RuleOutcome, ...]:
        """Retry recording feedback of rules that failed because the disk was full."""
        outcomes = []
        while self._pending:
            one = self._pending[0]
            try:
                outcomes.append(RuleOutcome(change=self._record(one)))
            except Refused as refusal:
                if refusal.code == RefusalCode.STORAGE_FULL:
                    break
                outcomes.append(
                    RuleOutcome(problem=f"{one.run.agent}: {one.fired.reason}: {refusal}")
                )
            self._pending.popleft()
        return tuple(outcomes)

    def give(self, given: FeedbackRequest) -> ProfileChange:
        """Apply feedback from a person, a button or a program.

        Feedback may be late, so it counts for the scene that it names, else for the scene of the
        agent's last run.

        Raises:
            Refused: ``NO_AGENT``, ``UNKNOWN_AGENT``, ``UNKNOWN_KIND``, ``NO_SCENE``,
                ``WRONG_LENGTH``, ``CHANGED_MEANWHILE``, ``FEEDBACK_ID_TAKEN``, or as in
                :meth:`Profiles.apply`; nothing has changed.
        """
        if given.feedback_id and (known := self.profiles.recorded(given.feedback_id)) is not None:
            return _same(given, known)
        agent = given.agent or self._agent()
        self.profiles.agent(agent)
        try:
            kind = FeedbackKind(given.kind)
        except ValueError:
            raise Refused(
                RefusalCode.UNKNOWN_KIND,
                f"feedback: kind {given.kind}, expected 0 (direct), 1 (positive), 2 (negative) "
                f"or 3 (set)",
            ) from None
        self.profiles.check_expected(agent, "", given.expected)
        run = self._runs.last(agent)
        if given.scene is not None and (run is None or run.scene.scene_id != given.scene.scene_id):
            run = AnnouncedRun(epoch="", round=0, agent=agent, scene=given.scene)
        names_profile = kind in (FeedbackKind.DIRECT, FeedbackKind.SET)
        change = self.profiles.apply(
            agent,
            kind,
            given.values if names_profile else self._scene(given, agent, run),
            feedback_id=given.feedback_id or self._new_id(),
            source=given.source,
            reason=given.reason,
            run=run,
            leaf=given.leaf or self._leaf(run),
        )
        return self._kept(change, run)

    def taught(self, run: AnnouncedRun) -> tuple[ProfileChange, ...]:
        """Return what rules, people and the tree have taught in a run, if it is the last one.

        It contains at most the latest :data:`MOST_TAUGHT` changes.
        """
        return tuple(self._taught) if run.key == self._taught_run else ()

    def collect(self, run: AnnouncedRun) -> ProfileChange | None:
        """Apply the simulated feedback for an ended run; return None if there is none.

        Raises:
            Refused: ``NO_RUN``, or as in :meth:`Profiles.apply`; nothing has changed.
        """
        if not run.epoch or not run.round:
            raise Refused(
                RefusalCode.NO_RUN,
                f"feedback: epoch '{run.epoch}' and round {run.round} name no run; "
                f"both come from the award",
            )
        self._runs.collected(run)
        self.profiles.agent(run.agent)
        of_market = f"simulated/{run.epoch}/"
        feedback_id = f"{of_market}{run.round}/{run.agent}"
        if (known := self.profiles.recorded(feedback_id)) is not None:
            return known
        if self._simulated is None:
            return None
        if not self._resumed:
            self._resumed = True
            self._simulated.resume(self.profiles.recorded_of(of_market))
        wanted = self._simulated.next(run.agent)
        if wanted is None:
            return None
        try:
            return self.profiles.apply(
                run.agent,
                FeedbackKind.DIRECT,
                wanted,
                feedback_id=feedback_id,
                source="simulated",
                reason=f"prepared feedback for round {run.round}",
                run=run,
            )
        except LedgerError:
            # Feedback that was not recorded is not used up.
            self._resumed = False
            raise

    def _update_leaf(self) -> None:
        run = self._runs.current
        if self._trace is not None and run is not None and self._leaf_of_run is not None:
            key, leaf = self._leaf_of_run
            if key == run.key:
                self._trace.on_leaf(leaf)

    def _begin(self) -> None:
        run = self._runs.current
        if run is not None and self._card_awaited and self.profiles.knows(run.agent):
            self._card_awaited = False
            self._watch = Watch(
                self.profiles.agent(run.agent).entry.rules,
                run.scene,
                self.profiles.scenes,
                self._clock,
                self._settle_s,
                self._lease_s,
            )

    def _stop_watching(self) -> None:
        self._watch = None
        self._card_awaited = False

    def _outcomes(
        self, run: AnnouncedRun, watch: Watch, fired: Iterable[Fired]
    ) -> tuple[RuleOutcome, ...]:
        undecided = [(run.agent, reason) for reason in watch.take_undecided()]
        self.undecided += tuple(undecided)
        return (
            *(RuleOutcome(problem=f"{agent}: {reason}") for agent, reason in undecided),
            *(self._outcome(run, one) for one in fired),
        )

    def _outcome(self, run: AnnouncedRun, fired: Fired) -> RuleOutcome:
        cancels = fired.rule.action is MoodAction.CANCEL
        stop = RuleStop(run=run, reason=fired.reason, live=fired.live) if cancels else None
        leaf = self._trace.leaf_at(fired.since) if self._trace is not None else ""
        pending = _Pending(run=run, fired=fired, leaf=leaf)
        try:
            return RuleOutcome(change=self._record(pending), stop=stop)
        except Refused as refusal:
            problem = f"{run.agent}: {fired.reason}, but {refusal}"
            if refusal.code == RefusalCode.STORAGE_FULL:
                problem += "; it is tried again until there is room"
                if len(self._pending) == MOST_PENDING:
                    lost = self._pending[0]
                    problem += (
                        f"; the feedback on {lost.run.agent} in round {lost.run.round} is lost"
                    )
                self._pending.append(pending)
            return RuleOutcome(problem=problem, stop=stop)

    def _record(self, one: _Pending) -> ProfileChange:
        rule = one.fired.rule
        change = self.profiles.apply(
            one.run.agent,
            rule.give,
            self.profiles.space.compared(one.run.scene).observed,
            feedback_id=_rule_id(one.run, one.fired),
            source=MOOD_RULE,
            reason=one.fired.reason,
            run=one.run,
            cancels=rule.action is MoodAction.CANCEL,
            leaf=one.leaf,
        )
        return self._kept(change, one.run)

    def _kept(self, change: ProfileChange, run: AnnouncedRun | None) -> ProfileChange:
        """Return a change, and keep it for :meth:`taught` if it is new and of the last run."""
        last = self._runs.last()
        if change.fresh and run is not None and last is not None and run.key == last.key:
            if run.key != self._taught_run:
                self._taught_run = run.key
                self._taught.clear()
            self._taught.append(change)
        return change

    def _scene(self, given: FeedbackRequest, agent: str, run: AnnouncedRun | None) -> Vector:
        if given.values:
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"feedback: {len(given.values)} values, expected none: positive and negative "
                f"feedback take those of the scene; use DIRECT or SET to name a profile",
            )
        if run is None:
            raise Refused(
                RefusalCode.NO_SCENE,
                f"feedback: '{agent}' has not run yet, so there is no scene to move towards or "
                f"away from; give DIRECT feedback",
            )
        return self.profiles.space.compared(run.scene).observed

    def _leaf(self, run: AnnouncedRun | None) -> str:
        """Return the active node of a run; empty if the run is over."""
        if run is None or self._trace is None or not self.is_running(run):
            return ""
        return self._trace.leaf_at(self._clock())

    def _agent(self) -> str:
        run = self._runs.last()
        if run is None:
            raise Refused(
                RefusalCode.NO_AGENT,
                "feedback: no agent is named and none has run yet; name the agent",
            )
        return run.agent


def _rule_id(run: AnnouncedRun, fired: Fired) -> str:
    """Return the feedback id of a firing, which is the same after a restart of this node."""
    again = f"/{fired.count}" if fired.count else ""
    return f"rule/{run.epoch}/{run.round}/{run.agent}/{fired.index}{again}"


def _same(given: FeedbackRequest, known: ProfileChange) -> ProfileChange:
    agent, kind = known.revision.agent, known.revision.cause.kind
    # Forgotten feedback no longer has its kind.
    other_kind = known.revision.cause.cause != FORGOTTEN and given.kind != kind
    if (given.agent and given.agent != agent) or other_kind:
        raise Refused(
            RefusalCode.FEEDBACK_ID_TAKEN,
            f"feedback: the id '{given.feedback_id}' belongs to other feedback (kind {kind} for "
            f"{agent}); every feedback needs its own id, or none",
        )
    return known
